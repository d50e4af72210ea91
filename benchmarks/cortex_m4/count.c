/*
 * Instructions of each step and each aim, worst and mean.
 */
#include "minorloop.h"
#include "inputs.h"
#include "start.h"
#include "systick.h"

static minorloop_state state;
static volatile minorloop_real kept;

void work(void)
{
    tally forward = {0u, 0u, 0u};
    tally inverse = {0u, 0u, 0u};
    const uint32_t overhead = begin_count();
    int k;

    minorloop_reset(&state);
    for (k = 0; k < COUNT; ++k) {
        const uint32_t before = SYSTICK_VALUE;
        kept = minorloop_step(&state, inputs[k]);
        add(&forward, before, SYSTICK_VALUE, overhead);
    }
    minorloop_reset(&state);
    for (k = 0; k < COUNT; ++k) {
        const uint32_t before = SYSTICK_VALUE;
        kept = minorloop_aim(&state, targets[k]);
        add(&inverse, before, SYSTICK_VALUE, overhead);
        kept = minorloop_step(&state, kept);
        /* The same to the last digits that a float has? */
        if ((kept - targets[k] > WIDTH * 1e-5f) || (targets[k] - kept > WIDTH * 1e-5f)) {
            say("wrong\n");
            stop(1);
        }
    }
    say_number(forward.worst);
    say_number(mean_of(&forward));
    say_number(inverse.worst);
    say_number(mean_of(&inverse));
    say_number((uint32_t)sizeof state);
    say("\n");
}
