/* Many samples at once, for callers to whom a call is dear. */
#include "pmsm_window.h"

const uint32_t size_of_window = (uint32_t)sizeof(pmsm_window);

void take(pmsm_window *w, uint32_t tick, uint32_t n, const pmsm_sample *samples);
void count_from(pmsm_window *w, uint32_t number);

void take(pmsm_window *w, uint32_t tick, uint32_t n, const pmsm_sample *samples)
{
    uint32_t k;
    for (k = 0; k < n; k++)
        pmsm_window_update(w, tick + k, &samples[k]);
}

/* As if an empty window had seen so many rows. */
void count_from(pmsm_window *w, uint32_t number)
{
    w->number = number;
}
