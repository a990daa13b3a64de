/* The published recursion as a C loop: a window by rank-one update and downdate of P and beta, an estimate at every row.
   Two equations a row (d, q axis). `a` is (2 n, p), `b` is (2 n); `out` is (n, p). */
static void step(int p, double *P, double *beta, const double *a, double b, double sign)
{
    double Pa[4], aPa = 0.0, e = b;
    for (int i = 0; i < p; i++) {
        Pa[i] = 0.0;
        for (int j = 0; j < p; j++) Pa[i] += P[i * p + j] * a[j];
        aPa += a[i] * Pa[i];
        e -= a[i] * beta[i];
    }
    double k = sign / (1.0 + sign * aPa);
    for (int i = 0; i < p; i++) {
        beta[i] += k * Pa[i] * e;
        for (int j = 0; j < p; j++) P[i * p + j] -= k * Pa[i] * Pa[j];
    }
}

#define WINDOW(p) \
    void window_##p(long n, long length, const double *a, const double *b, double *P, double *beta, double *out) \
    { \
        for (long k = 0; k < n; k++) { \
            for (long row = 2 * k; row < 2 * k + 2; row++) { \
                step(p, P, beta, a + row * p, b[row], 1.0); \
                if (k >= length) step(p, P, beta, a + (row - 2 * length) * p, b[row - 2 * length], -1.0); \
            } \
            for (int i = 0; i < p; i++) out[k * p + i] = beta[i]; \
        } \
    }

WINDOW(3)
WINDOW(4)
