/* One step of an extended state observer over h' = NN1(h, u) + f, T = NN2(h', h), both 2-10-1 tanh
 * networks, for `units` units side by side: Runge-Kutta under a held input, outputs, correction.
 *
 * Blocks of 64 units; tanh vectorised by the compiler (-O3 -march=native -ffast-math). */
#include <math.h>
#include <string.h>

#define H 10
#define B 64

static void network(const double *th, const double *x, const double *u, double *out)
{
    for (int i = 0; i < B; i++) out[i] = th[40];
    for (int h = 0; h < H; h++) {
        double w = th[2 * h], g = th[2 * h + 1], b = th[20 + h], v = th[30 + h];
        for (int i = 0; i < B; i++) out[i] += v * tanh(w * x[i] + g * u[i] + b);
    }
}

static void rate(const double *th, const double *x, const double *u, const double *f, double *out)
{
    network(th, x, u, out);
    for (int i = 0; i < B; i++) out[i] += f[i];
}

/* `steps` steps of dt of units that are a multiple of 64. x, f, last: states, faults and the last
 * inputs of all units. u, hm, T: samples first, what was commanded and measured; told: the fault
 * after each, the two innovations. gain: of x and of f, by the momentum's innovation. */
void monitor(int units, int steps, double dt, const double *nn1, const double *nn2,
             const double *gain, const double *u, const double *hm, const double *T, double *x,
             double *f, double *last, double *told_f, double *told_h, double *told_T)
{
    double a[B], b[B], c[B], d[B], y[B], t[B], z[B];
    for (int first = 0; first < units; first += B) {
        double *xs = x + first, *fs = f + first, *us = last + first;
        for (int k = 0; k < steps; k++) {
            long at = (long)k * units + first;
            rate(nn1, xs, us, fs, a);
            for (int i = 0; i < B; i++) z[i] = xs[i] + dt / 2 * a[i];
            rate(nn1, z, us, fs, b);
            for (int i = 0; i < B; i++) z[i] = xs[i] + dt / 2 * b[i];
            rate(nn1, z, us, fs, c);
            for (int i = 0; i < B; i++) z[i] = xs[i] + dt * c[i];
            rate(nn1, z, us, fs, d);
            for (int i = 0; i < B; i++) xs[i] += dt / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
            memcpy(us, u + at, sizeof t);
            rate(nn1, xs, us, fs, y);
            network(nn2, y, xs, t);
            for (int i = 0; i < B; i++) {
                double e = xs[i] - hm[at + i];
                told_h[at + i] = -e;
                told_T[at + i] = T[at + i] - t[i];
                xs[i] -= gain[0] * e;
                fs[i] -= gain[1] * e;
                told_f[at + i] = fs[i];
            }
        }
    }
}

static double network_at(const double *th, double x, double u)
{
    double s = th[40];
    for (int h = 0; h < H; h++)
        s += th[30 + h] * tanh(th[2 * h] * x + th[2 * h + 1] * u + th[20 + h]);
    return s;
}

/* The same of one unit: the vectors run along the hidden layer. */
void observe(int steps, double dt, const double *nn1, const double *nn2, const double *gain,
             const double *u, const double *hm, const double *T, double *state, double *told_f,
             double *told_h, double *told_T)
{
    double x = state[0], f = state[1], last = state[2];
    for (int k = 0; k < steps; k++) {
        double a = network_at(nn1, x, last) + f;
        double b = network_at(nn1, x + dt / 2 * a, last) + f;
        double c = network_at(nn1, x + dt / 2 * b, last) + f;
        double d = network_at(nn1, x + dt * c, last) + f;
        x += dt / 6 * (a + 2 * b + 2 * c + d);
        last = u[k];
        double dx = network_at(nn1, x, last) + f, e = x - hm[k];
        told_h[k] = -e;
        told_T[k] = T[k] - network_at(nn2, dx, x);
        x -= gain[0] * e;
        f -= gain[1] * e;
        told_f[k] = f;
    }
    state[0] = x, state[1] = f, state[2] = last;
}
