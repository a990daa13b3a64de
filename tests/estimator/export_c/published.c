/* The published window, for comparison: recursive least squares that takes a new row in and the oldest one out of the
 * solution itself. S. Wang, Mathematical Problems in Engineering, 2013, doi 10.1155/2013/131268; R_s, L_d, L_q. */
#include <stdint.h>
#include <string.h>

#ifndef LENGTH
#define LENGTH 400u /* samples, of two rows each */
#endif
#ifndef REAL
#define REAL float
#endif

typedef REAL real;

typedef struct {
    real P[3][3], beta[3];
    real rows[LENGTH][2][4]; /* regressors and voltage, d and q axis */
    uint32_t at, samples;
} published;

const uint32_t size_of_published = (uint32_t)sizeof(published);

void published_init(published *p, real P_0);
void published_update(published *p, real z[2][4]);
void published_take(published *p, uint32_t n, real *z, real *out);

/* sign 1: a row comes, and P loses; -1: it goes, and P gains. */
static void taken(published *p, const real row[4], real sign)
{
    real Pa[3], e = -row[3], inner = (real)1, share;
    int i, j;
    for (i = 0; i < 3; i++) {
        Pa[i] = p->P[i][0] * row[0] + p->P[i][1] * row[1] + p->P[i][2] * row[2];
        e += row[i] * p->beta[i];
    }
    for (i = 0; i < 3; i++)
        inner += sign * row[i] * Pa[i];
    share = sign / inner;
    for (i = 0; i < 3; i++) {
        p->beta[i] -= share * Pa[i] * e;
        for (j = 0; j < 3; j++)
            p->P[i][j] -= share * Pa[i] * Pa[j];
    }
}

void published_init(published *p, real P_0)
{
    int i;
    memset(p, 0, sizeof *p);
    for (i = 0; i < 3; i++)
        p->P[i][i] = P_0;
}

void published_update(published *p, real z[2][4])
{
    int axis;
    for (axis = 0; axis < 2; axis++)
        taken(p, z[axis], (real)1);
    if (p->samples == LENGTH)
        for (axis = 0; axis < 2; axis++)
            taken(p, p->rows[p->at][axis], (real)-1);
    else
        p->samples++;
    memcpy(p->rows[p->at], z, sizeof p->rows[0]);
    if (++p->at == LENGTH)
        p->at = 0;
}

/* Of n samples, rows (n, 2, 4); the solution after the last one. */
void published_take(published *p, uint32_t n, real *z, real *out)
{
    uint32_t k;
    for (k = 0; k < n; k++)
        published_update(p, (real(*)[4])(z + 8u * k));
    memcpy(out, p->beta, sizeof p->beta);
}
