/* Windowed least squares for a PMSM's R_s, L_d, L_q, psi_f: see README.md. C99, no heap, of libm only sqrt.
 *
 * Amplitude-invariant (peak) dq quantities, d axis on the magnet flux, motor sign convention, electrical angles, SI.
 * Do not compile it with -ffast-math: it tells by arithmetic which values are no numbers. */
#ifndef PMSM_WINDOW_H
#define PMSM_WINDOW_H

#include <stdint.h>

#define PMSM_WINDOW $window       /* samples */
#define PMSM_ESTIMATED $estimated /* parameters that are estimated, */
#define PMSM_PLACES $places /* and their places among all four */
#define PMSM_WITH_FLUX $flux    /* 1: psi_f is one of them */
#define PMSM_DOUBLE $double       /* 1: in double precision */

#if PMSM_DOUBLE
typedef double pmsm_real;
#else
typedef float pmsm_real;
#endif

enum { PMSM_R_S, PMSM_L_D, PMSM_L_Q, PMSM_PSI_F, PMSM_PARAMETERS }; /* ohm, H, H, Vs */

typedef enum {
    PMSM_OK,       /* estimated from the window */
    PMSM_DOUBTFUL, /* estimated, but a parameter comes out as no motor has it: the equations do not fit */
    PMSM_STALE,    /* estimated from rows that are too old to be taken for what is now */
    PMSM_HELD,     /* not estimated: held at the given value */
    PMSM_NOT_TOLD, /* the window cannot tell it; the value is the known one */
    PMSM_NO_DATA   /* fewer rows than parameters */
} pmsm_status;

typedef struct {
    pmsm_real sin_theta, cos_theta; /* of the rotor's angle at the start of the control period */
    pmsm_real i_d, i_q;             /* A, sampled there */
    pmsm_real u_d, u_q;             /* V, applied over the period, in the rotor frame at its middle */
} pmsm_sample;

typedef struct {
    pmsm_real T_s;                    /* s, control period */
    pmsm_real known[PMSM_PARAMETERS]; /* values of those held; of the others nominal ones, or 0 */
    pmsm_real step_i, step_u;         /* A and V: resolution of currents and voltages; 0: not known */
    pmsm_real step_theta;             /* rad, electrical, of the angle's sensor; 0: not known */
    uint32_t stale_after;             /* ticks after which rows are too old */
} pmsm_settings;

typedef struct {
    pmsm_real value[PMSM_PARAMETERS]; /* SI */
    pmsm_real std[PMSM_PARAMETERS];   /* standard errors; 0 unless ok, doubtful or stale. 1.96 of them: 95 % */
    pmsm_status status[PMSM_PARAMETERS];
    pmsm_real residual_rms; /* V */
    uint32_t samples, gaps; /* rows in the window, and breaks between them */
} pmsm_estimates;

/* What follows is the module's own. */

#define PMSM_BLOCK 32 /* rows */
#define PMSM_BLOCKS (PMSM_WINDOW / PMSM_BLOCK + 1)
#define PMSM_TRIANGLE 10 /* products of four numbers with each other, */
#define PMSM_LAST (PMSM_WITH_FLUX ? 5 : 0) /* and of a fifth with all */

typedef struct {
    pmsm_real half_sine;            /* sin(D/2), D the angle turned in the period */
    pmsm_real i_d, i_q, di_d, di_q; /* A: mean of the two ends, and difference */
    pmsm_real u_d, u_q;             /* V */
} pmsm_row;

typedef struct { /* of rows with themselves, and with the row before; d and q axis */
    pmsm_real lag0_d[PMSM_TRIANGLE], lag1_d[PMSM_TRIANGLE];
    pmsm_real lag0_q[PMSM_TRIANGLE + PMSM_LAST], lag1_q[PMSM_TRIANGLE + PMSM_LAST];
} pmsm_sums;

typedef struct {
    pmsm_settings settings;
    pmsm_real known_h;      /* V, what the known parameters make of h */
    pmsm_real per_T_s;      /* 1/s */
    pmsm_real before[2][5]; /* the newest row */
    pmsm_sample last;       /* the newest sample, whose row waits for its end */
    uint32_t tick;          /* its tick */
    uint32_t run;           /* 0: there is none, 1: it begins a run, 2: it joins one */
    uint32_t number;        /* rows so far, which wraps */
    uint32_t samples;       /* rows in the window */
    uint32_t at, block;     /* where the next row and its sums go */
    uint32_t left_out;      /* samples with a value that is no number */
    uint32_t starts[(PMSM_WINDOW + 31) / 32]; /* a bit a row: it does not join the one before */
    pmsm_row rows[PMSM_WINDOW];
    pmsm_sums blocks[PMSM_BLOCKS];
} pmsm_window;

/* Begin with an empty window. */
void pmsm_window_init(pmsm_window *w, const pmsm_settings *settings);

/* Take in a sample, in the control interrupt. A tick that does not follow the one before begins a new run. */
void pmsm_window_update(pmsm_window *w, uint32_t tick, const pmsm_sample *sample);

/* What the window says, as of a tick; in the background, on a window that does not change meanwhile. */
void pmsm_window_solve(const pmsm_window *w, uint32_t tick, pmsm_estimates *out);

#endif
