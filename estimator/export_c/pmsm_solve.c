/* The window's sums to values, standard errors and statuses: least squares whose bias by current noise is taken out.
 *
 * The sums are those of whole blocks, and at the window's old edge of single rows, taken from the ring: nothing is ever
 * subtracted, so nothing drifts. Batches of up to 32 rows, half over each other and weighted by sin^2, tell how the
 * residual behaves over more than two rows.
 *
 * Coefficients c of an axis are differences from the known parameters, so that c' z is minus the residual of a row. */
#include "pmsm_rows.h"

#include <string.h>

#define P PMSM_ESTIMATED
#if PMSM_DOUBLE
#define MAGNITUDE fabs
#define EPSILON R(2.2e-16)
#define ARITHMETIC R(1e-10) /* relative energy below which a direction is arithmetic, not excitation */
#define ROUNDS 4            /* of the small terms; each gains three digits */
#else
#define MAGNITUDE fabsf
#define EPSILON R(1.2e-7)
#define ARITHMETIC R(1e-6)
#define ROUNDS 3
#endif

#define CHUNK 256u /* rows, across whose ends no batch goes */
#define BATCH 32u
#define SHORTEST_BATCH 4u
#define TINY R(1e-30)
#define Z_95 R(1.96) /* standard errors that hold the truth 95 times in 100 */
#define NOISE_SHARE R(0.1)
#define NOISE_DOUBT R(0.1)
#define OPEN_COLOUR R(48) /* pairs, that tell as much of the residual's colour as is known before */
#define NOISE_ECHO R(10)
#define PRIOR_SHARE R(0.05)
#define PRIOR_LEAST R(1e-5)
#define FAINT_I R(1e-9)     /* A */
#define FAINT_SPEED R(1e-6) /* rad/s */
#define MODEL R(1e-6)
#define MODEL_MOVING R(3e-5)
#define MODEL_TURN R(8e-4)
#define FEWEST_FREEDOM R(4)
#define FEWEST_BATCHES R(8)

typedef struct {
    pmsm_real lag0[2][Z][Z], lag1[2][Z][Z], batch[2][Z][Z];
    pmsm_real centre[2][Z]; /* coefficients about which those of batches are counted */
    pmsm_real u2[2];        /* V^2 */
    pmsm_real rows, pairs, batches, w_w, w_next;
    uint32_t gaps;
} totals;

typedef struct {
    pmsm_real scale[P], inverse[P][P], plain[P][P];
    pmsm_real told[P][P]; /* onto the directions that are told */
    pmsm_real weak[P][P]; /* by rows: orthonormal directions that are not told, */
    int n_weak;           /* so many */
} excitation;

static const int PLACES[P] = PMSM_PLACES;
static const pmsm_real STUDENT[] = {
    /* quantiles of Student's distribution over the normal one's, by 32 / freedom */
$student
};
static const pmsm_real TURNS[][2] = {
    /* cos(pi/n), sin(pi/n) of batches of n = 4 to 32 rows */
$turns
};

static pmsm_real larger(pmsm_real a, pmsm_real b) { return a > b ? a : b; }
static pmsm_real smaller(pmsm_real a, pmsm_real b) { return a < b ? a : b; }
static pmsm_real quotient(pmsm_real a, pmsm_real b) { return b > R(0) ? a / b : R(0); }
static pmsm_real square(pmsm_real a) { return a * a; }

/* exp(-x), x >= 0. */
static pmsm_real decay(pmsm_real x)
{
    pmsm_real part = x * R(1.0 / 64.0), sum = R(1), term = R(1);
    int k;
    if (x > R(40))
        return R(0);
    for (k = 1; k < 8; k++) {
        term *= part / R(k);
        sum += term;
    }
    for (k = 0; k < 6; k++)
        sum *= sum;
    return R(1) / sum;
}

/* Quantile of Student's distribution over that of the normal, for 95 %. */
static pmsm_real student(pmsm_real freedom)
{
    const pmsm_real place = R(32) / larger(freedom, R(1));
    const int k = place < R(31) ? (int)place : 31;
    return STUDENT[k] + (place - R(k)) * (STUDENT[k + 1] - STUDENT[k]);
}

static pmsm_real form(pmsm_real c[Z], pmsm_real S[Z][Z])
{
    pmsm_real sum = R(0);
    int i, j;
    for (i = 0; i < Z; i++) {
        pmsm_real line = R(0);
        for (j = 0; j < Z; j++)
            line += S[i][j] * c[j];
        sum += c[i] * line;
    }
    return sum;
}

static void times(pmsm_real A[P][P], const pmsm_real x[P], pmsm_real out[P])
{
    int i, j;
    for (i = 0; i < P; i++) {
        out[i] = R(0);
        for (j = 0; j < P; j++)
            out[i] += A[i][j] * x[j];
    }
}

/* ---- sums of the window ---- */

static uint32_t ring_place(const pmsm_window *w, uint32_t k)
{
    const uint32_t place = w->at + (PMSM_WINDOW - w->samples) + k;
    return place < PMSM_WINDOW ? place : place - PMSM_WINDOW;
}

static int begins(const pmsm_window *w, uint32_t k)
{
    const uint32_t place = ring_place(w, k);
    return (int)(w->starts[place / 32u] >> (place % 32u) & 1u);
}

/* A symmetric matrix of its triangle, and the fifth number's products where they are there. */
static void unpack(const pmsm_real *triangle, int last, pmsm_real S[Z][Z])
{
    int i, j;
    for (i = 0; i < 4; i++)
        for (j = i; j < 4; j++)
            S[i][j] = S[j][i] = *triangle++;
    for (i = 0; i < Z && last; i++)
        S[i][H] = S[H][i] = triangle[i];
}

/* Those of neighbouring rows, whose diagonal is kept once. h hardly changes from row to row, and neither does s. */
static void unpack_neighbours(const totals *t, const pmsm_real *triangle, int axis, pmsm_real S[Z][Z])
{
    const int last = axis == 1 && PMSM_WITH_FLUX;
    int i;
    unpack(triangle, last, S);
    for (i = 0; i < Z && !last; i++)
        S[i][H] = S[H][i] = t->lag0[axis][i][H] * t->pairs / t->rows * (i == H ? R(1) : R(2));
    for (i = 0; i < Z; i++)
        S[i][i] *= R(2);
}

static void add_block(pmsm_sums *sum, const pmsm_sums *block)
{
    pmsm_real *to = sum->lag0_d;
    const pmsm_real *of = block->lag0_d;
    uint32_t k;
    for (k = 0; k < sizeof *sum / sizeof *to; k++)
        to[k] += of[k];
}

/* Add rows with themselves and with the row before; those of whole blocks at once. Where the window begins with a whole
 * chunk, the chunk's pair with the row before it counts. */
static void add_rows(const pmsm_window *w, pmsm_sums *sum, totals *t)
{
    const uint32_t first = w->number - w->samples;
    const int with_before = first % CHUNK == 0u && w->samples >= CHUNK;
    pmsm_real z[2][Z], before[2][Z] = {{R(0)}};
    uint32_t k = 0;
    while (k < w->samples) {
        const uint32_t number = first + k, left = w->samples - k;
        if (number % PMSM_BLOCK == 0u && (k > 0u || with_before || begins(w, 0u))) {
            const uint32_t age = (w->number - number) / PMSM_BLOCK;
            const uint32_t block = w->block >= age ? w->block - age : w->block + PMSM_BLOCKS - age;
            add_block(sum, &w->blocks[block]);
            k += left < PMSM_BLOCK ? left : PMSM_BLOCK;
        } else {
            const pmsm_row *row = &w->rows[ring_place(w, k)];
            row_of(w, row, z);
            add_row(sum, z, before, k > 0u && !begins(w, k));
            memcpy(before, z, sizeof z);
            k++;
        }
    }
    for (k = 1; k < w->samples; k++)
        t->gaps += (uint32_t)begins(w, k);
    t->rows = R(w->samples);
    t->pairs = R(w->samples - 1u - t->gaps + (with_before && !begins(w, 0u) ? 1u : 0u));
}

typedef struct {
    pmsm_real sum[2][Z], weighted[2][Z];
} weighed;

/* Sums of rows [k, k + n), the first ones of a batch of `length`, plain and weighted by sin^2(pi (row + 1/2)/length);
 * voltages there are what the centre leaves of them. What h and s do in them, and the voltages, goes into the totals
 * where they are not yet `counted`. */
static void weigh(const pmsm_window *w, uint32_t k, uint32_t n, uint32_t length, int counted, totals *t, weighed *out)
{
    const pmsm_real *turn = TURNS[length < SHORTEST_BATCH ? 0 : length - SHORTEST_BATCH];
    const pmsm_real c_2 = R(1) - R(2) * turn[1] * turn[1], s_2 = R(2) * turn[0] * turn[1];
    pmsm_real cosine = turn[0], sine = turn[1]; /* of pi/length in the middle of the first row */
    uint32_t end;
    int axis, i;
    memset(out, 0, sizeof *out);
    for (end = k + n; k < end; k++) {
        const pmsm_row *row = &w->rows[ring_place(w, k)];
        const pmsm_real weight = R(0.5) - R(0.5) * cosine, turned = cosine * c_2 - sine * s_2;
        pmsm_real z[2][Z];
        sine = sine * c_2 + cosine * s_2;
        cosine = turned;
        row_of(w, row, z);
        for (axis = 0; axis < 2; axis++) {
            const pmsm_real *c = t->centre[axis];
            for (i = 0; i < Z && !counted; i++)
                t->lag0[axis][i][H] += z[axis][i] * z[axis][H];
            z[axis][E] -= c[0] * z[axis][0] + c[1] * z[axis][1] + c[2] * z[axis][2] + c[H] * z[axis][H];
            for (i = 0; i < Z; i++) {
                out->sum[axis][i] += z[axis][i];
                out->weighted[axis][i] += weight * z[axis][i];
            }
        }
        if (!counted) {
            t->u2[0] += row->u_d * row->u_d;
            t->u2[1] += row->u_q * row->u_q;
        }
    }
}

/* Add the products of a batch's weighted sum b with itself. */
static void add_batch(pmsm_real b[2][Z], uint32_t length, totals *t)
{
    const pmsm_real *turn = TURNS[length - SHORTEST_BATCH], n = R(length);
    const pmsm_real ends = R(0.5) - R(0.5) * turn[0];
    int axis, i, j;
    for (axis = 0; axis < 2; axis++)
        for (i = 0; i < Z; i++)
            for (j = 0; j < Z; j++)
                t->batch[axis][i][j] += b[axis][i] * b[axis][j];
    t->batches += R(1);
    t->w_w += R(0.375) * n;
    t->w_next += R(0.25) * n + R(0.125) * n * (R(1) - R(2) * turn[1] * turn[1]) - ends * ends;
}

/* Batches of a stretch without a break: each half over the next, the last one as long as is left. */
static void add_batches(const pmsm_window *w, uint32_t k, uint32_t stop, totals *t)
{
    const uint32_t half = BATCH / 2u;
    weighed rising, next;
    int axis, i;
    if (k + BATCH < stop)
        weigh(w, k, half, BATCH, 0, t, &rising);
    for (; k + BATCH < stop; k += half) {
        const int counted = k + half + BATCH >= stop; /* the last batch has these rows, too */
        weigh(w, k + half, half, BATCH, counted, t, &next);
        for (axis = 0; axis < 2; axis++) /* falling weights are what rising ones leave of 1 */
            for (i = 0; i < Z; i++)
                rising.weighted[axis][i] += next.sum[axis][i] - next.weighted[axis][i];
        add_batch(rising.weighted, BATCH, t);
        rising = next;
    }
    weigh(w, k, stop - k, stop - k, 0, t, &rising);
    if (stop - k >= SHORTEST_BATCH)
        add_batch(rising.weighted, stop - k, t);
}

static void add_stretches(const pmsm_window *w, totals *t)
{
    const uint32_t first = w->number - w->samples;
    uint32_t k = 0, stop;
    while (k < w->samples) {
        for (stop = k + 1u; stop < w->samples && (first + stop) % CHUNK != 0u && !begins(w, stop); stop++) {
        }
        add_batches(w, k, stop, t);
        k = stop;
    }
}

/* Sums over rows, but for what h and s do in them. */
static void total_rows(const pmsm_window *w, pmsm_sums *sum, totals *t)
{
    memset(t, 0, sizeof *t);
    memset(sum, 0, sizeof *sum);
    add_rows(w, sum, t);
    unpack(sum->lag0_d, 0, t->lag0[0]);
    unpack(sum->lag0_q, PMSM_WITH_FLUX, t->lag0[1]);
}

/* And those of batches, and all that is left. */
static void total_rest(const pmsm_window *w, const pmsm_sums *sum, totals *t)
{
    int axis, i;
    for (axis = 0; axis < 2; axis++)
        for (i = 0; i < Z; i++)
            t->lag0[axis][i][H] = R(0);
    add_stretches(w, t);
    for (axis = 0; axis < 2; axis++)
        for (i = 0; i < H; i++)
            t->lag0[axis][H][i] = t->lag0[axis][i][H];
    unpack_neighbours(t, sum->lag1_d, 0, t->lag1[0]);
    unpack_neighbours(t, sum->lag1_q, 1, t->lag1[1]);
}

/* A parameter's place in z. */
static int column(int p) { return p == PMSM_PSI_F ? H : p; }

/* Of two parameters; psi_f is in no row of the d axis. */
static pmsm_real of_axis(pmsm_real S[2][Z][Z], int axis, int p, int q)
{
    return axis == 0 && (p == PMSM_PSI_F || q == PMSM_PSI_F) ? R(0) : S[axis][column(p)][column(q)];
}

static void normal_matrix(pmsm_real S[2][Z][Z], pmsm_real G[P][P])
{
    int i, j;
    for (i = 0; i < P; i++)
        for (j = 0; j < P; j++)
            G[i][j] = of_axis(S, 0, PLACES[i], PLACES[j]) + of_axis(S, 1, PLACES[i], PLACES[j]);
}

/* ---- what the window can tell ---- */

/* Eigenvalues on the diagonal of A, eigenvectors as columns of V: Jacobi's rotations, exact also where sizes differ. */
static void eigen(pmsm_real A[P][P], pmsm_real V[P][P])
{
    int i, j, k, sweep, turned = 1;
    for (i = 0; i < P; i++)
        for (j = 0; j < P; j++)
            V[i][j] = i == j ? R(1) : R(0);
    for (sweep = 0; sweep < 12 && turned; sweep++) {
        turned = 0;
        for (i = 0; i + 1 < P; i++)
            for (j = i + 1; j < P; j++) {
                const pmsm_real a = A[i][j];
                pmsm_real half, t, c, s;
                if (MAGNITUDE(a) <= EPSILON * ROOT(MAGNITUDE(A[i][i] * A[j][j])) || MAGNITUDE(a) < TINY)
                    continue;
                turned = 1;
                half = (A[j][j] - A[i][i]) / (R(2) * a);
                t = R(1) / (MAGNITUDE(half) + ROOT(R(1) + half * half));
                t = half < R(0) ? -t : t;
                c = R(1) / ROOT(R(1) + t * t);
                s = t * c;
                A[i][i] -= t * a;
                A[j][j] += t * a;
                A[i][j] = A[j][i] = R(0);
                for (k = 0; k < P; k++) {
                    const pmsm_real v_i = V[k][i], v_j = V[k][j];
                    V[k][i] = c * v_i - s * v_j;
                    V[k][j] = s * v_i + c * v_j;
                    if (k != i && k != j) {
                        const pmsm_real a_i = A[k][i], a_j = A[k][j];
                        A[k][i] = A[i][k] = c * a_i - s * a_j;
                        A[k][j] = A[j][k] = s * a_i + c * a_j;
                    }
                }
            }
    }
}

/* Inverse of a matrix that is nearly the unit matrix, or symmetric and positive: Gauss-Jordan without pivots. */
static void inverted(pmsm_real A[P][P], int n)
{
    int i, j, k;
    for (k = 0; k < n; k++) {
        const pmsm_real pivot = R(1) / A[k][k];
        A[k][k] = R(1);
        for (j = 0; j < n; j++)
            A[k][j] *= pivot;
        for (i = 0; i < n; i++)
            if (i != k) {
                const pmsm_real factor = A[i][k];
                A[i][k] = R(0);
                for (j = 0; j < n; j++)
                    A[i][j] -= factor * A[k][j];
            }
    }
}

/* Make rows orthonormal, each twice; what is left of a row that depends on others is dropped. Returns how many stay. */
static int orthonormal(pmsm_real rows[P][P], int n)
{
    int i, j, k, pass, kept = 0;
    for (k = 0; k < n; k++) {
        pmsm_real norm = R(0), left = R(0);
        for (i = 0; i < P; i++)
            norm += square(rows[k][i]);
        for (pass = 0; pass < 2; pass++)
            for (j = 0; j < kept; j++) {
                pmsm_real along = R(0);
                for (i = 0; i < P; i++)
                    along += rows[j][i] * rows[k][i];
                for (i = 0; i < P; i++)
                    rows[k][i] -= along * rows[j][i];
            }
        for (i = 0; i < P; i++)
            left += square(rows[k][i]);
        if (!(left > R(100) * square(EPSILON) * norm) || left < TINY)
            continue;
        for (i = 0; i < P; i++)
            rows[kept][i] = rows[k][i] / ROOT(left);
        kept++;
    }
    return kept;
}

/* Judge a normal matrix against what noise N contributes to its diagonal. */
static void judge(pmsm_real G[P][P], pmsm_real N[P], excitation *x)
{
    pmsm_real A[P][P], v[P][P], inner[P][P], V[P][P], noise[P], whitening[P];
    int strong[P], n_strong = 0, i, j, k, l;
    for (i = 0; i < P; i++) {
        x->scale[i] = G[i][i] > R(0) ? R(1) / ROOT(G[i][i]) : R(0);
        noise[i] = N[i] * square(x->scale[i]);
        whitening[i] = R(1) / ROOT(noise[i] / NOISE_SHARE + ARITHMETIC);
    }
    for (i = 0; i < P; i++)
        for (j = 0; j < P; j++)
            A[i][j] = G[i][j] * x->scale[i] * x->scale[j] * whitening[i] * whitening[j];
    eigen(A, v);
    memset(V, 0, sizeof V);
    memset(x->plain, 0, sizeof x->plain);
    memset(x->told, 0, sizeof x->told);
    x->n_weak = 0;
    for (k = 0; k < P; k++) {
        const pmsm_real strength = A[k][k];
        pmsm_real size2 = R(0), largest = R(0);
        strong[k] = strength > R(1);
        for (i = 0; i < P && strong[k]; i++)
            for (j = 0; j < P; j++)
                x->told[i][j] += v[i][k] * v[j][k] * x->scale[i] * whitening[i] *
                                 quotient(R(1), x->scale[j] * whitening[j]);
        for (i = 0; i < P; i++) {
            v[i][k] *= whitening[i];
            size2 += square(v[i][k]);
            largest = larger(largest, MAGNITUDE(v[i][k]));
        }
        if (strong[k]) {
            for (i = 0; i < P; i++)
                V[i][n_strong] = v[i][k] / ROOT(strength);
            n_strong++;
            continue;
        }
        for (i = 0; i < P; i++)
            x->weak[x->n_weak][i] = v[i][k] / largest;
        x->n_weak++;
        if (strength > ARITHMETIC * size2)
            for (i = 0; i < P; i++)
                for (j = 0; j < P; j++)
                    x->plain[i][j] += v[i][k] * v[j][k] / strength * x->scale[i] * x->scale[j];
    }
    for (k = 0; k < n_strong; k++)
        for (l = 0; l < n_strong; l++) {
            inner[k][l] = k == l ? R(1) : R(0);
            for (i = 0; i < P; i++)
                inner[k][l] -= V[i][k] * noise[i] * V[i][l];
        }
    inverted(inner, n_strong);
    for (i = 0; i < P; i++)
        for (j = 0; j < P; j++) {
            pmsm_real sum = R(0);
            for (k = 0; k < n_strong; k++)
                for (l = 0; l < n_strong; l++)
                    sum += V[i][k] * inner[k][l] * V[j][l];
            x->inverse[i][j] = sum * x->scale[i] * x->scale[j];
        }
    x->n_weak = orthonormal(x->weak, x->n_weak);
}

/* ---- noise, small terms ---- */

typedef struct {
    const pmsm_window *w;
    totals t;
    pmsm_real G[P][P], G_calm[P][P];
    excitation plain, plain_calm;
    pmsm_real centre[4]; /* parameters about which batches are counted */
    int enough, calm;    /* more equations than parameters; batches enough */
} task;

/* Coefficients of both axes, for parameters and small terms (of h, b_d, b_q). */
static void coefficients(const task *k, const pmsm_real beta[4], const pmsm_real small[3], pmsm_real c[2][Z])
{
    const pmsm_real *known = k->w->settings.known;
    int axis;
    for (axis = 0; axis < 2; axis++) {
        c[axis][0] = beta[0] - known[0];
        c[axis][1] = beta[1] - known[1] + small[1 + axis];
        c[axis][2] = beta[2] - known[2] + small[1 + axis];
        c[axis][E] = R(-1);
    }
    c[0][H] = small[0] - k->w->known_h;
    c[1][H] = beta[3] - known[3];
}

/* Parameters where told or held; the other axis' inductance stands in for one that is neither. */
static void known_parameters(const task *k, const pmsm_real beta[4], const int told[4], pmsm_real out[4])
{
    pmsm_real L_d, L_q;
    int i;
    for (i = 0; i < 4; i++)
        out[i] = told[i] ? beta[i] : k->w->settings.known[i];
    L_d = out[1];
    L_q = out[2];
    out[1] = L_d > R(0) ? L_d : L_q;
    out[2] = L_q > R(0) ? L_q : L_d;
}

static void second_order(const task *k, const pmsm_real beta[4], const int told[4], pmsm_real small[3])
{
    const pmsm_real T_s = k->w->settings.T_s;
    pmsm_real known[4];
    int axis;
    known_parameters(k, beta, told, known);
    small[0] = -quotient(known[0] * known[3], known[1]);
    for (axis = 0; axis < 2; axis++) {
        const pmsm_real L = known[1 + axis];
        small[1 + axis] = MAGNITUDE(known[0]) * T_s < R(3) * L ? square(known[0] * T_s) / (R(12) * L) : R(0);
    }
}

/* Variance of a sampled current by axis, by the residual that parameters leave; where gaps leave no rows that follow
   each other, the middle of what its colour may be. */
static void current_noise(task *k, const pmsm_real beta[4], pmsm_real c[2][Z], pmsm_real sigma2[2])
{
    totals *t = &k->t;
    const pmsm_real n = larger(t->rows, R(1)), pairs = larger(t->pairs, R(1)), T_s = k->w->settings.T_s;
    const pmsm_real open = smaller(larger(R(1) - t->pairs / larger(t->rows - R(1), R(1)), R(0)), R(1));
    const pmsm_real alone = OPEN_COLOUR * open;
    int axis;
    for (axis = 0; axis < 2; axis++) {
        const int x = 1 + axis;
        const pmsm_real L2 = larger(square(beta[x]), R(1e-18));
        const pmsm_real gamma0 = larger(R(0), form(c[axis], t->lag0[axis])) / n;
        const pmsm_real gamma1 = (R(0.5) * form(c[axis], t->lag1[axis]) - R(0.25) * alone * gamma0) /
                                 larger(t->pairs + alone, R(1));
        const pmsm_real by_residual =
            smaller(larger(R(0), -gamma1) / L2, t->lag0[axis][x][x] / (R(2) * n));
        const pmsm_real by_signal =
            smaller(larger(R(0), -t->lag1[axis][x][x] / (R(2) * pairs)), gamma0 / (R(2) * L2));
        sigma2[axis] = square(FAINT_I) + square(k->w->settings.step_i) / R(12) +
                       square(T_s) * larger(by_residual, by_signal);
    }
}

/* Energy that noise in the sampled currents gives to each regressor. */
static void regressor_noise(const task *k, const pmsm_real sigma2[2], pmsm_real N[P])
{
    const pmsm_real n = k->t.rows, per_T = k->w->per_T_s;
    int i;
    for (i = 0; i < P; i++) {
        const int p = PLACES[i];
        if (p == PMSM_R_S)
            N[i] = n * (sigma2[0] + sigma2[1]);
        else if (p == PMSM_PSI_F)
            N[i] = n * square(FAINT_SPEED);
        else
            N[i] = (R(2) * n * square(per_T) + k->t.lag0[1][H][H]) * sigma2[p - 1];
    }
}

/* ---- a round ---- */

typedef struct {
    pmsm_real beta[4], full[4]; /* full: with directions that are not told as plain least squares has them */
    int sure[4];                /* hardly rests on priors */
    pmsm_real doubt[P];         /* standard error by priors */
    excitation x;
    pmsm_real sigma2[2], apart, noise[P];
} solved;

/* A' e, e the voltages less what held parameters, small terms and the known ones make of them. */
static void right_side(pmsm_real S[2][Z][Z], pmsm_real c_0[2][Z], pmsm_real out[P])
{
    int i, j, axis;
    for (i = 0; i < P; i++) {
        out[i] = R(0);
        for (axis = 0; axis < 2; axis++)
            if (!(axis == 0 && PLACES[i] == PMSM_PSI_F))
                for (j = 0; j < Z; j++)
                    out[i] -= S[axis][column(PLACES[i])][j] * c_0[axis][j];
    }
}

/* Least squares over the directions that are told: their part of an origin, and its correction by what it leaves. */
static void corrected(excitation *x, const pmsm_real N[P], const pmsm_real right[P], const pmsm_real origin[4],
                      pmsm_real out[P])
{
    pmsm_real known[P], part[P], side[P];
    int i;
    for (i = 0; i < P; i++)
        known[i] = origin[PLACES[i]];
    times(x->told, known, part);
    for (i = 0; i < P; i++)
        side[i] = right[i] + N[i] * part[i];
    times(x->inverse, side, out);
    for (i = 0; i < P; i++)
        out[i] += part[i];
}

/* Plain least squares. */
static void reference(excitation *x, const pmsm_real right[P], const pmsm_real origin[4], pmsm_real beta[4])
{
    static const pmsm_real NONE[P];
    pmsm_real found[P];
    int i;
    corrected(x, NONE, right, origin, found);
    memcpy(beta, origin, 4 * sizeof *beta);
    for (i = 0; i < P; i++)
        beta[PLACES[i]] = found[i];
}

/* Coefficients as batches have them: differences from the centre's. */
static void about_centre(const task *k, pmsm_real c[2][Z], pmsm_real out[2][Z])
{
    int axis, i;
    for (axis = 0; axis < 2; axis++)
        for (i = 0; i < Z; i++)
            out[axis][i] = i == E ? c[axis][E] : c[axis][i] - k->t.centre[axis][i];
}

static int estimated_place(int p)
{
    int i;
    for (i = 0; i < P; i++)
        if (PLACES[i] == p)
            return i;
    return -1;
}

/* Fill directions that are not told from what is plausible: held values, the other axis' inductance, no more voltage
 * than there is; and the standard errors of that. */
static void filled_by_prior(task *k, solved *s, pmsm_real strong[P])
{
    const pmsm_real *known = k->w->settings.known;
    excitation *x = &s->x;
    pmsm_real share[P], value[P], b[P], prior[P], weight[P], M[P][P], by[P][P], least, u;
    const int n = x->n_weak < P ? x->n_weak : P;
    int i, j, l;
    memset(s->doubt, 0, sizeof s->doubt);
    for (i = 0; i < P; i++)
        s->beta[PLACES[i]] = strong[i];
    if (n == 0)
        return;
    u = ROOT(k->t.u2[0] + k->t.u2[1]);
    least = larger(PRIOR_LEAST * u, TINY);
    for (i = 0; i < P; i++) {
        share[i] = R(0);
        for (j = 0; j < n; j++)
            share[i] += square(x->weak[j][i]);
        value[i] = known[PLACES[i]];
    }
    for (l = PMSM_L_D; l <= PMSM_L_Q; l++) {
        const int other = l == PMSM_L_D ? PMSM_L_Q : PMSM_L_D;
        const int at = estimated_place(l), at_other = estimated_place(other);
        if (at >= 0 && !(value[at] > R(0))) {
            const pmsm_real its =
                at_other < 0 ? known[other] : share[at_other] < R(0.5) ? s->full[other] : R(0);
            value[at] = larger(its, R(0));
        }
    }
    for (i = 0; i < P; i++) {
        const pmsm_real norm = quotient(R(1), x->scale[i]);
        b[i] = strong[i] * norm;
        prior[i] = value[i] * norm;
        weight[i] = ROOT(share[i]) / larger(value[i] > R(0) ? smaller(prior[i], u) : u, least);
    }
    /* by = B pinv(weight B): orthonormal rows M of (weight B)', and triangular T with (weight B)' = T M */
    {
        pmsm_real T[P][P];
        for (j = 0; j < n; j++) {
            pmsm_real norm = R(0);
            for (i = 0; i < P; i++)
                M[j][i] = weight[i] * x->weak[j][i];
            for (l = 0; l < j; l++) {
                T[j][l] = R(0);
                for (i = 0; i < P; i++)
                    T[j][l] += M[l][i] * M[j][i];
                for (i = 0; i < P; i++)
                    M[j][i] -= T[j][l] * M[l][i];
            }
            for (i = 0; i < P; i++)
                norm += square(M[j][i]);
            T[j][j] = ROOT(norm);
            for (i = 0; i < P; i++)
                M[j][i] = quotient(M[j][i], T[j][j]);
        }
        for (l = 0; l < P; l++) { /* of column l: y with T' y = M[.][l], then B y */
            pmsm_real y[P];
            for (j = n - 1; j >= 0; j--) {
                y[j] = M[j][l];
                for (i = j + 1; i < n; i++)
                    y[j] -= T[i][j] * y[i];
                y[j] = quotient(y[j], T[j][j]);
            }
            for (i = 0; i < P; i++) {
                by[i][l] = R(0);
                for (j = 0; j < n; j++)
                    by[i][l] += x->weak[j][i] * y[j];
            }
        }
    }
    for (i = 0; i < P; i++) {
        pmsm_real sum = b[i], doubt2 = R(0);
        for (l = 0; l < P; l++) {
            sum += by[i][l] * weight[l] * (prior[l] - b[l]);
            doubt2 += square(by[i][l]);
        }
        s->beta[PLACES[i]] = sum * x->scale[i];
        s->doubt[i] = ROOT(doubt2) * x->scale[i];
    }
}

static void solve_round(task *k, const pmsm_real small[3], solved *s)
{
    const pmsm_real *known = k->w->settings.known;
    pmsm_real c_0[2][Z], c[2][Z], right[P], side[P], strong[P], correction[P];
    pmsm_real by_rows[4], by_batches[4], one[2], other[2];
    int i, j, axis;
    coefficients(k, known, small, c_0);
    right_side(k->t.lag0, c_0, right);
    reference(&k->plain, right, known, by_rows);
    memcpy(by_batches, by_rows, sizeof by_batches);
    if (k->calm) {
        coefficients(k, k->centre, small, c);
        about_centre(k, c, c);
        right_side(k->t.batch, c, side);
        reference(&k->plain_calm, side, k->centre, by_batches);
    }
    coefficients(k, by_rows, small, c);
    current_noise(k, by_rows, c, one);
    coefficients(k, by_batches, small, c);
    current_noise(k, by_batches, c, other);
    s->apart = R(0);
    for (axis = 0; axis < 2; axis++) {
        s->sigma2[axis] = larger(one[axis], other[axis]);
        s->apart = larger(s->apart, MAGNITUDE(one[axis] - other[axis]) / s->sigma2[axis]);
    }
    regressor_noise(k, s->sigma2, s->noise);
    judge(k->G, s->noise, &s->x);
    memcpy(s->full, known, sizeof s->full);
    memcpy(s->beta, known, sizeof s->beta);
    corrected(&s->x, s->noise, right, known, strong);
    for (i = 0; i < P; i++) {
        side[i] = right[i];
        for (j = 0; j < P; j++)
            side[i] += k->G[i][j] * (known[PLACES[j]] - strong[j]);
    }
    times(s->x.plain, side, correction);
    for (i = 0; i < P; i++)
        s->full[PLACES[i]] = strong[i] + correction[i];
    filled_by_prior(k, s, strong);
    memset(s->sure, 0, sizeof s->sure);
    for (i = 0; i < P; i++)
        s->sure[PLACES[i]] = s->doubt[i] < PRIOR_SHARE * MAGNITUDE(s->beta[PLACES[i]]);
}

/* ---- standard errors ---- */

/* Level of an axis' residual spectrum at frequency zero over gamma0, and the variances of both estimates. */
static void colour(const totals *t, pmsm_real squares, pmsm_real neighbours, pmsm_real batch, pmsm_real out[4])
{
    const pmsm_real n = larger(t->rows, R(1)), mean_square = larger(squares / n, TINY);
    const pmsm_real by_pairs = R(1) + neighbours / larger(t->pairs, R(1)) / mean_square;
    const int there = t->batches >= R(1);
    const pmsm_real batches = there ? t->batches : R(1), w_next = there ? t->w_next : R(1);
    const pmsm_real leak = (t->w_w - w_next) / w_next;
    const pmsm_real by_batches = there ? batch / mean_square / w_next - leak : by_pairs;
    const pmsm_real rho = R(0.5) * (smaller(larger(by_batches, R(0)), R(2)) - R(1));
    const pmsm_real of_gamma0 = R(2) * (R(1) + R(2) * rho * rho) / n;
    const pmsm_real of_pairs = of_gamma0 + (R(4) * (R(1) + R(3) * rho * rho) + R(16) * rho) / n;
    const pmsm_real of_batches = R(2) / batches * square(R(1) + R(2) * rho + leak);
    const pmsm_real share = there ? of_pairs / (of_pairs + of_batches) : R(0);
    const pmsm_real f = smaller(larger((R(1) - share) * by_pairs + share * by_batches, R(0)), R(2));
    out[0] = f;
    out[1] = of_gamma0;
    out[2] = (R(1) - share) * of_pairs;
    out[3] = (R(1) - share) * (of_gamma0 + R(8) * rho / n) + share * R(2) * f * f / n;
}

/* Variance of what a resolution leaves, where noise dithers it. */
static pmsm_real undithered(pmsm_real step, pmsm_real noise)
{
    return step > R(0) ? step * step / R(12) * decay(R(39.4784176) * noise / (step * step)) : R(0);
}

/* Variances of voltage errors that may last for the whole window, by axis; D: rms angle a period. */
static void constant_errors(task *k, const pmsm_real beta[4], const pmsm_real gamma0[2], const pmsm_real sigma2[2],
                            pmsm_real out[2])
{
    const pmsm_settings *set = &k->w->settings;
    totals *t = &k->t;
    const pmsm_real n = larger(t->rows, R(1)), s2 = t->lag0[1][H][H] / n;
    const pmsm_real sine = smaller(R(1), R(0.5) * set->T_s * ROOT(larger(s2, R(0))));
    const pmsm_real D = R(2) * sine * (R(1) + sine * sine * (R(1.0 / 6.0) + sine * sine * R(0.075)));
    const pmsm_real h_2 = t->lag0[0][H][H] / n;
    const pmsm_real moving = smaller(R(1), larger(R(0), quotient(h_2, square(D * D / R(12))) - R(1)));
    const pmsm_real model2 = square(MODEL) + square(MODEL_TURN * D * D * D) + square(MODEL_MOVING) * moving;
    const pmsm_real delta2 = square(set->step_theta) / R(3);
    const pmsm_real L_d = beta[1], L_q = beta[2];
    const pmsm_real Z2 = square(beta[0]) + s2 * larger(L_d * L_d, L_q * L_q);
    const pmsm_real u2 = (t->u2[0] + t->u2[1]) / n;
    int axis;
    for (axis = 0; axis < 2; axis++) {
        const pmsm_real flux2 = square(L_d - L_q) * t->lag0[axis][0][0] / n + (axis == 0 ? square(beta[3]) : R(0));
        out[axis] = model2 * u2 + undithered(set->step_u, gamma0[axis]) +
                    Z2 * undithered(set->step_i, sigma2[axis]) + delta2 * s2 * flux2;
    }
}

/* Standard error of the coefficient of h: from its value to its largest likely one. */
static pmsm_real doubt_of_h(task *k, const pmsm_real beta[4], const pmsm_real std[4], const int told[4])
{
    const pmsm_real *stand_in = k->w->settings.known;
    totals *t = &k->t;
    pmsm_real size[4], known[4], off[4], i_q, s, u_q, share, R_s, psi_f, L, smallest;
    int i;
    for (i = 0; i < 4; i++) {
        size[i] = MAGNITUDE(beta[i]);
        off[i] = told[i] ? Z_95 * std[i] : R(0);
    }
    known_parameters(k, size, told, known);
    i_q = ROOT(t->lag0[1][0][0]);
    s = ROOT(t->lag0[1][H][H]);
    u_q = ROOT(t->u2[1]);
    share = known[0] > R(0) || known[3] > R(0) ? R(1) : R(0.5);
    R_s = known[0] > R(0) ? known[0] + off[0] : quotient(share * u_q, i_q);
    psi_f = known[3] > R(0) ? known[3] + off[3] : quotient(share * u_q, s);
    L = known[1] > R(0) ? known[1] : larger(size[1], size[2]);
    smallest = told[1] || stand_in[1] > R(0) ? larger(L - off[1], R(0.1) * L) : R(0.5) * L;
    return (quotient(R_s * psi_f, smallest) - quotient(known[0] * known[3], L)) / Z_95;
}

/* Variances with a residual of first-order moving average, and of constant errors; returns the sum of squares. */
static pmsm_real variances(task *k, const solved *s, pmsm_real c[2][Z], pmsm_real variance[P], pmsm_real constant[P])
{
    totals *t = &k->t;
    const pmsm_real n = larger(t->rows, R(1)), own = larger(n - R(0.5) * R(P), R(0.5));
    pmsm_real of_variance[P], squares[2], gamma0[2], lasting[2], c_batch[2][Z];
    int axis, i, j, l;
    about_centre(k, c, c_batch);
    memset(variance, 0, P * sizeof *variance);
    memset(constant, 0, P * sizeof *constant);
    memset(of_variance, 0, sizeof of_variance);
    for (axis = 0; axis < 2; axis++) {
        squares[axis] = larger(R(0), form(c[axis], t->lag0[axis]));
        gamma0[axis] = squares[axis] / n;
    }
    constant_errors(k, s->full, gamma0, s->sigma2, lasting);
    for (axis = 0; axis < 2; axis++) {
        pmsm_real known[4];
        colour(t, squares[axis], form(c[axis], t->lag1[axis]), form(c_batch[axis], t->batch[axis]), known);
        for (i = 0; i < P; i++) {
            pmsm_real S0 = R(0), S1 = R(0), A, B;
            for (j = 0; j < P; j++)
                for (l = 0; l < P; l++) {
                    const pmsm_real by = s->x.inverse[i][j] * s->x.inverse[i][l];
                    S0 += by * of_axis(t->lag0, axis, PLACES[j], PLACES[l]);
                    S1 += by * of_axis(t->lag1, axis, PLACES[j], PLACES[l]);
                }
            A = squares[axis] / own * (S0 - R(0.5) * S1);
            B = squares[axis] / own * R(0.5) * S1;
            variance[i] += A + known[0] * B;
            of_variance[i] += known[1] * A * A + known[2] * B * B + R(2) * known[3] * A * B;
            constant[i] += n * lasting[axis] * S0;
        }
    }
    for (i = 0; i < P; i++) {
        pmsm_real freedom = larger(own, R(1));
        variance[i] = larger(variance[i], R(0));
        if (of_variance[i] > R(0))
            freedom = smaller(freedom, larger(R(2) * square(variance[i]) / of_variance[i], FEWEST_FREEDOM));
        variance[i] *= square(student(freedom));
    }
    return squares[0] + squares[1];
}

/* ---- the whole ---- */

static void prepare(const pmsm_window *w, task *k)
{
    const pmsm_real at_known[3] = {w->known_h, R(0), R(0)};
    pmsm_sums sum;
    pmsm_real none[P], right[P], c[2][Z];
    memset(none, 0, sizeof none);
    k->w = w;
    total_rows(w, &sum, &k->t);
    k->enough = 2u * w->samples > P;
    normal_matrix(k->t.lag0, k->G);
    judge(k->G, none, &k->plain);
    coefficients(k, w->settings.known, at_known, c);
    right_side(k->t.lag0, c, right);
    reference(&k->plain, right, w->settings.known, k->centre);
    coefficients(k, k->centre, at_known, k->t.centre);
    total_rest(w, &sum, &k->t);
    k->calm = k->t.batches >= FEWEST_BATCHES;
    normal_matrix(k->t.batch, k->G_calm);
    judge(k->G_calm, none, &k->plain_calm);
}

static int plausible(int p, pmsm_real value)
{
    static const pmsm_real LOW[] = {R(1e-4), R(1e-7), R(1e-7), R(1e-5)}, HIGH[] = {R(1e3), R(1), R(1), R(100)};
    return value >= LOW[p] && value <= HIGH[p];
}

static void nothing_told(const pmsm_window *w, pmsm_estimates *out)
{
    int p;
    memset(out, 0, sizeof *out);
    for (p = 0; p < PMSM_PARAMETERS; p++) {
        out->value[p] = w->settings.known[p];
        out->status[p] = estimated_place(p) < 0 ? PMSM_HELD : PMSM_NO_DATA;
    }
    out->samples = w->samples;
}

void pmsm_window_solve(const pmsm_window *w, uint32_t tick, pmsm_estimates *out)
{
    task k;
    solved s;
    pmsm_real small[3] = {R(0), R(0), R(0)}, c[2][Z], variance[P], constant[P], bias[P], of_h[P], std[4], share, h;
    int round, i, impossible = 0;
    nothing_told(w, out);
    if (2u * w->samples <= P)
        return;
    prepare(w, &k);
    out->gaps = k.t.gaps;
    solve_round(&k, small, &s);
    for (round = 1; round < ROUNDS; round++) {
        second_order(&k, s.beta, s.sure, small);
        solve_round(&k, small, &s);
    }
    coefficients(&k, s.full, small, c);
    out->residual_rms = ROOT(variances(&k, &s, c, variance, constant) / (R(2) * larger(k.t.rows, R(1))));
    for (i = 0; i < P; i++)
        of_h[i] = s.noise[i] * s.beta[PLACES[i]];
    times(s.x.inverse, of_h, bias);
    memset(std, 0, sizeof std);
    for (i = 0; i < P; i++) {
        const int p = PLACES[i];
        share = larger(NOISE_DOUBT, R(3) / ROOT(larger(smaller(k.t.rows, k.t.pairs + R(1)), R(1)))) + s.apart +
                NOISE_ECHO * quotient(MAGNITUDE(bias[i]), MAGNITUDE(s.beta[p]));
        bias[i] *= smaller(R(1), share);
        std[p] = ROOT(variance[i] + constant[i] + square(s.doubt[i]) + square(bias[i]));
        s.sure[p] = s.sure[p] && Z_95 * std[p] < MAGNITUDE(s.beta[p]);
    }
    h = doubt_of_h(&k, s.beta, std, s.sure);
    for (i = 0; i < P; i++)
        bias[i] = PLACES[i] == PMSM_PSI_F ? R(0) : k.t.lag0[0][PLACES[i]][H] * h;
    times(s.x.inverse, bias, of_h);
    for (i = 0; i < P; i++) {
        const int p = PLACES[i];
        std[p] = ROOT(square(std[p]) + square(of_h[i]));
        if (!(s.sure[p] && Z_95 * std[p] < MAGNITUDE(s.beta[p]) && k.enough)) {
            out->status[p] = PMSM_NOT_TOLD;
            continue;
        }
        impossible = impossible || !plausible(p, s.beta[p]);
        out->status[p] = s.beta[p] > R(0) ? PMSM_OK : PMSM_NOT_TOLD;
        if (out->status[p] == PMSM_OK) {
            out->value[p] = s.beta[p];
            out->std[p] = std[p];
        }
    }
    for (i = 0; i < P; i++) {
        pmsm_status *status = &out->status[PLACES[i]];
        if (*status == PMSM_OK && impossible)
            *status = PMSM_DOUBTFUL;
        if (*status == PMSM_OK || *status == PMSM_DOUBTFUL)
            *status = tick - w->tick > w->settings.stale_after ? PMSM_STALE : *status;
    }
}
