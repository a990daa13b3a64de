/* Samples to rows, rows to a ring, and their products to sums by block. */
#include "pmsm_rows.h"

#include <string.h>

void pmsm_window_init(pmsm_window *w, const pmsm_settings *settings)
{
    const pmsm_real *known = settings->known;
    memset(w, 0, sizeof *w);
    w->settings = *settings;
    w->per_T_s = R(1) / settings->T_s;
    if (known[PMSM_L_D] > R(0))
        w->known_h = -known[PMSM_R_S] * known[PMSM_PSI_F] / known[PMSM_L_D];
}

/* Infinity and what is no number are still none times zero. */
static int finite_sample(const pmsm_sample *s)
{
    return (s->sin_theta + s->cos_theta + s->i_d + s->i_q + s->u_d + s->u_q) * R(0) == R(0);
}

void pmsm_window_update(pmsm_window *w, uint32_t tick, const pmsm_sample *sample)
{
    if (tick != w->tick + 1u)
        w->run = 0;
    if (!finite_sample(sample)) {
        w->run = 0;
        w->left_out++;
        return;
    }
    w->tick = tick;
    if (w->run > 0) {
        const pmsm_sample *last = &w->last;
        const pmsm_real sin_D = sample->sin_theta * last->cos_theta - sample->cos_theta * last->sin_theta;
        const pmsm_real cos_D = sample->cos_theta * last->cos_theta + sample->sin_theta * last->sin_theta;
        const int joins = w->run > 1;
        const uint32_t bit = 1u << (w->at % 32u);
        pmsm_row *row = &w->rows[w->at];
        pmsm_sums *sums = &w->blocks[w->block];
        pmsm_real z[2][Z];
        row->half_sine = cos_D > R(-0.999) ? sin_D / ROOT(R(2) + R(2) * cos_D) : R(1);
        row->i_d = R(0.5) * (sample->i_d + last->i_d);
        row->i_q = R(0.5) * (sample->i_q + last->i_q);
        row->di_d = sample->i_d - last->i_d;
        row->di_q = sample->i_q - last->i_q;
        row->u_d = last->u_d;
        row->u_q = last->u_q;
        row_of(w, row, z);
        add_row(sums, z, w->before, joins);
        memcpy(w->before, z, sizeof z);
        w->starts[w->at / 32u] = joins ? w->starts[w->at / 32u] & ~bit : w->starts[w->at / 32u] | bit;
        if (++w->at == PMSM_WINDOW)
            w->at = 0;
        if (w->samples < PMSM_WINDOW)
            w->samples++;
        if (++w->number % PMSM_BLOCK == 0) {
            if (++w->block == PMSM_BLOCKS)
                w->block = 0;
            memset(&w->blocks[w->block], 0, sizeof(pmsm_sums));
        }
    }
    w->run = w->run > 0 ? 2u : 1u;
    w->last = *sample;
}
