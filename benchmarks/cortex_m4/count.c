/*
 * Instructions of each step and each aim, worst and mean, and the sum of all outputs.
 * The emulator runs one instruction in 64 ns of its own time, and SysTick counts the 25 MHz clock of
 * the board, 40 ns: so an instruction is 1.6 ticks, and the count is exact to one instruction.
 */
#include "minorloop.h"
#include "inputs.h"
#include "start.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)

typedef struct {
    uint32_t worst;
    uint32_t sum;
} tally;

static minorloop_state state;
static volatile minorloop_real kept;

static uint32_t instructions(uint32_t before, uint32_t after)
{
    return ((((before - after) & 0xFFFFFFu) * 5u) + 4u) / 8u;
}

static void add(tally *all, uint32_t before, uint32_t after, uint32_t overhead)
{
    uint32_t count = instructions(before, after);

    count = (count > overhead) ? (count - overhead) : 0u;
    all->sum += count;
    all->worst = (count > all->worst) ? count : all->worst;
}

static uint32_t own_cost(void)
{
    const uint32_t before = SYSTICK_VALUE;

    return instructions(before, SYSTICK_VALUE);
}

/* Does the counting count? A thousand instructions and the reading of the clock. */
static void check_count(uint32_t overhead)
{
    const uint32_t before = SYSTICK_VALUE;
    uint32_t counted;

    __asm__ volatile(".rept 1000\n\tnop\n\t.endr");
    counted = instructions(before, SYSTICK_VALUE) - overhead;
    if ((counted < 1000u) || (counted > 1010u)) {
        say("a thousand instructions counted as ");
        say_number(counted);
        stop(1);
    }
}

void work(void)
{
    tally forward = {0u, 0u};
    tally inverse = {0u, 0u};
    uint32_t overhead;
    int k;

    SYSTICK_RELOAD = 0xFFFFFFu;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 5u;
    overhead = own_cost();
    check_count(overhead);
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
    say_number(forward.sum / COUNT);
    say_number(inverse.worst);
    say_number(inverse.sum / COUNT);
    say_number((uint32_t)sizeof state);
    say("\n");
}
