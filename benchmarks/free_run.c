/* Free runs of h' = NN(h, u) by RK4 under a held input, NN a 2-10-1 tanh network, written for speed.
 *
 * B trajectories side by side; tanh vectorised by the compiler (-O3 -march=native -ffast-math). */
#include <math.h>

#define H 10

static double rate(const double *th, double x, double u)
{
    double s = th[40];
    for (int h = 0; h < H; h++)
        s += th[30 + h] * tanh(th[2 * h] * x + th[2 * h + 1] * u + th[20 + h]);
    return s;
}

/* `steps` steps of dt from x[0]: u and x of one trajectory. */
void free_run(int steps, double dt, const double *th, const double *u, double *x)
{
    for (int k = 0; k + 1 < steps; k++) {
        double a = rate(th, x[k], u[k]);
        double b = rate(th, x[k] + dt / 2 * a, u[k]);
        double c = rate(th, x[k] + dt / 2 * b, u[k]);
        double d = rate(th, x[k] + dt * c, u[k]);
        x[k + 1] = x[k] + dt / 6 * (a + 2 * b + 2 * c + d);
    }
}

static void rates(int n, const double *th, const double *x, double u, double *out)
{
    for (int i = 0; i < n; i++) out[i] = th[40];
    for (int h = 0; h < H; h++) {
        double w = th[2 * h], b = th[2 * h + 1] * u + th[20 + h], v = th[30 + h];
        for (int i = 0; i < n; i++) out[i] += v * tanh(w * x[i] + b);
    }
}

/* The same for n <= 1024 trajectories under one input; x holds their states, n to a sample. */
void free_runs(int n, int steps, double dt, const double *th, const double *u, double *x)
{
    double a[1024], b[1024], c[1024], d[1024], y[1024];
    for (int k = 0; k + 1 < steps; k++, x += n) {
        rates(n, th, x, u[k], a);
        for (int i = 0; i < n; i++) y[i] = x[i] + dt / 2 * a[i];
        rates(n, th, y, u[k], b);
        for (int i = 0; i < n; i++) y[i] = x[i] + dt / 2 * b[i];
        rates(n, th, y, u[k], c);
        for (int i = 0; i < n; i++) y[i] = x[i] + dt * c[i];
        rates(n, th, y, u[k], d);
        for (int i = 0; i < n; i++) x[n + i] = x[i] + dt / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
}
