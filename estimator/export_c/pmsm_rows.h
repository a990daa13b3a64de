/* A row's numbers, and their products added to sums; the module's own.
 *
 * Over one control period the flux linkage changes by the voltage-time area less the resistive drop. In the rotor frame
 * at the middle of the period, with D the angle turned in it,
 *
 *     u_d = R_s i_d + L_d x_d - L_q y_q - R_s psi_f/L_d h        x = cos(D/2) (i[k+1] - i[k]) / T_s
 *     u_q = R_s i_q + L_q x_q + L_d y_d + psi_f s                y = s i_mean,  s = (2/T_s) sin(D/2),  h = D^2/12
 *
 * A row is z = (i_d, x_d, -y_q, e_d, h) and (i_q, y_d, x_q, e_q, s), e the voltage less what the known parameters make
 * of it: the estimate is a correction of these, and single precision is spent on what is not known. */
#ifndef PMSM_ROWS_H
#define PMSM_ROWS_H

#include "pmsm_window.h"

#include <math.h>

#define R(x) ((pmsm_real)(x))
#if PMSM_DOUBLE
#define ROOT sqrt
#else
#define ROOT sqrtf
#endif

#define Z 5 /* numbers of a row and axis; */
#define E 3 /* place of the voltage, */
#define H 4 /* and of h (d axis) and s (q axis) */

static inline void row_of(const pmsm_window *w, const pmsm_row *row, pmsm_real z[2][Z])
{
    const pmsm_real *known = w->settings.known;
    const pmsm_real sine = row->half_sine, sine_2 = sine * sine, per_T_s = w->per_T_s;
    const pmsm_real series =
        R(1) + sine_2 * (R(1.0 / 6.0) + sine_2 * (R(3.0 / 40.0) + sine_2 * (R(15.0 / 336.0) + sine_2 * R(0.035))));
    const pmsm_real quarter = R(0.5) * sine * series; /* D/4 */
    const pmsm_real q_2 = quarter * quarter, kept = R(1) - R(2) * q_2, h = R(4.0 / 3.0) * q_2;
    const pmsm_real slope = ROOT(R(1) - sine_2) * per_T_s, s = R(2) * per_T_s * sine;
    const pmsm_real i_d = kept * row->i_d - quarter * row->di_q, i_q = kept * row->i_q + quarter * row->di_d;
    const pmsm_real x_d = slope * row->di_d, x_q = slope * row->di_q;
    const pmsm_real y_d = s * row->i_d, y_q = s * row->i_q;
    z[0][0] = i_d;
    z[0][1] = x_d;
    z[0][2] = -y_q;
    z[0][E] = row->u_d - known[PMSM_R_S] * i_d - known[PMSM_L_D] * x_d + known[PMSM_L_Q] * y_q - w->known_h * h;
    z[0][H] = h;
    z[1][0] = i_q;
    z[1][1] = y_d;
    z[1][2] = x_q;
    z[1][E] = row->u_q - known[PMSM_R_S] * i_q - known[PMSM_L_D] * y_d - known[PMSM_L_Q] * x_q - known[PMSM_PSI_F] * s;
    z[1][H] = s;
}

/* The triangle of products, line by line: those of a number with itself and with the ones after it. */
#define TRIANGLE(add) add(0, 0) add(0, 1) add(0, 2) add(0, 3) add(1, 1) add(1, 2) add(1, 3) add(2, 2) add(2, 3) add(3, 3)
#define LAST(add) add(0, 4) add(1, 4) add(2, 4) add(3, 4) add(4, 4)
#define PRODUCT(i, j) *sum++ += a[i] * a[j];
#define NEIGHBOURS(i, j) \
    *sum += a[i] * b[j]; \
    if (i != j) \
        *sum += b[i] * a[j]; \
    sum++;

/* Add a row's products with itself and, where it joins it, with the row before. */
static inline void add_row(pmsm_sums *sums, pmsm_real z[2][Z], pmsm_real before[2][Z], int joins)
{
    {
        const pmsm_real a[4] = {z[0][0], z[0][1], z[0][2], z[0][3]};
        pmsm_real *sum = sums->lag0_d;
        TRIANGLE(PRODUCT)
        if (joins) {
            const pmsm_real b[4] = {before[0][0], before[0][1], before[0][2], before[0][3]};
            sum = sums->lag1_d;
            TRIANGLE(NEIGHBOURS)
        }
    }
    {
        const pmsm_real a[Z] = {z[1][0], z[1][1], z[1][2], z[1][3], z[1][4]};
        pmsm_real *sum = sums->lag0_q;
        TRIANGLE(PRODUCT)
#if PMSM_WITH_FLUX
        LAST(PRODUCT)
#endif
        if (joins) {
            const pmsm_real b[Z] = {before[1][0], before[1][1], before[1][2], before[1][3], before[1][4]};
            sum = sums->lag1_q;
            TRIANGLE(NEIGHBOURS)
#if PMSM_WITH_FLUX
            LAST(NEIGHBOURS)
#endif
        }
    }
}

#endif
