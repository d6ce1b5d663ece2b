/* One Levenberg-Marquardt trial of a 2-10-1 tanh network, written for speed.
 *
 * Blocks of 64 samples, the Jacobian as (parameters, block), the lower half of J J' only, tanh
 * vectorised by the compiler through libmvec (-O3 -march=native -ffast-math). */
#include <math.h>
#include <string.h>

#define H 10
#define P 41
#define B 64

static void normal_equations(int n, const double *x0, const double *x1, const double *y,
                             const double *th, double A[P][P], double g[P], double *cost)
{
    double J[P][B], r[B];
    memset(A, 0, sizeof(double) * P * P);
    memset(g, 0, sizeof(double) * P);
    *cost = 0;
    for (int k = 0; k < n; k += B) {
        int m = n - k < B ? n - k : B;
        for (int i = 0; i < m; i++) {
            r[i] = th[40] - y[k + i];
            J[40][i] = 1;
        }
        for (int h = 0; h < H; h++) {
            double w0 = th[2 * h], w1 = th[2 * h + 1], b = th[20 + h], v = th[30 + h];
            for (int i = 0; i < m; i++) {
                double a = tanh(w0 * x0[k + i] + w1 * x1[k + i] + b), d = v * (1 - a * a);
                r[i] += v * a;
                J[30 + h][i] = a;
                J[20 + h][i] = d;
                J[2 * h][i] = d * x0[k + i];
                J[2 * h + 1][i] = d * x1[k + i];
            }
        }
        for (int p = 0; p < P; p++) {
            double s = 0;
            for (int i = 0; i < m; i++) s += J[p][i] * r[i];
            g[p] += s;
            for (int q = 0; q <= p; q++) {
                double t = 0;
                for (int i = 0; i < m; i++) t += J[p][i] * J[q][i];
                A[p][q] += t;
            }
        }
        double s = 0;
        for (int i = 0; i < m; i++) s += r[i] * r[i];
        *cost += s;
    }
}

/* Cost at `th`, and in `next` the damped step from there (Cholesky). */
double lm_trial(int n, const double *x0, const double *x1, const double *y, const double *th,
                double mu, double *next)
{
    double A[P][P], g[P], cost;
    normal_equations(n, x0, x1, y, th, A, g, &cost);
    for (int p = 0; p < P; p++) {
        A[p][p] += mu;
        for (int q = 0; q <= p; q++) {
            double s = A[p][q];
            for (int i = 0; i < q; i++) s -= A[p][i] * A[q][i];
            A[p][q] = p == q ? sqrt(s) : s / A[q][q];
        }
        for (int i = 0; i < p; i++) g[p] -= A[p][i] * g[i];
        g[p] /= A[p][p];
    }
    for (int p = P - 1; p >= 0; p--) {
        for (int i = p + 1; i < P; i++) g[p] -= A[i][p] * g[i];
        g[p] /= A[p][p];
        next[p] = th[p] - g[p];
    }
    return cost;
}
