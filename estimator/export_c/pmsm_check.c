/* Runs the test vectors through the module and says how far it is from what pmsm-bench says: 0 where all is well. */
#include "pmsm_vectors.h"

#include <stdio.h>

#if PMSM_DOUBLE
#define CLOSE 1e-5
#else
#define CLOSE 1e-4 /* of a value */
#endif
#define NEAR 0.03 /* of a standard error */

static pmsm_window window;

static double off(pmsm_real is, pmsm_real should_be)
{
    const double apart = fabs((double)is - (double)should_be);
    return apart > 0.0 ? apart / fabs((double)should_be) : 0.0;
}

int main(void)
{
    static const char *const NAMES[] = {"ok", "doubtful", "stale", "held", "not told", "no data"};
    const uint32_t moments = (uint32_t)(sizeof MOMENTS / sizeof MOMENTS[0]);
    uint32_t done = 0, moment;
    int failed = 0, p;
    pmsm_window_init(&window, &SETTINGS);
    for (moment = 0; moment < moments; moment++) {
        const pmsm_estimates *said = &MOMENTS[moment].said;
        pmsm_estimates found;
        for (; done < MOMENTS[moment].samples; done++)
            pmsm_window_update(&window, SAMPLES[done].tick, &SAMPLES[done].sample);
        pmsm_window_solve(&window, MOMENTS[moment].tick, &found);
        printf("%5u samples, %u gaps:", (unsigned)found.samples, (unsigned)found.gaps);
        if (found.samples != said->samples || found.gaps != said->gaps)
            failed++;
        for (p = 0; p < PMSM_PARAMETERS; p++) {
            const double value = off(found.value[p], said->value[p]), std = off(found.std[p], said->std[p]);
            printf("  %s %.7g", NAMES[found.status[p]], (double)found.value[p]);
            if (found.status[p] != said->status[p] || !(value < CLOSE) || !(std < NEAR)) {
                printf(" (%s %.7g)", NAMES[said->status[p]], (double)said->value[p]);
                failed++;
            }
        }
        printf("\n");
    }
    printf(failed ? "%d differ\n" : "all as expected\n", failed);
    return failed != 0;
}
