/*
 * Count instructions. The emulator runs one instruction in 64 ns of its own time, and SysTick counts
 * the 25 MHz clock of the board, 40 ns: so an instruction is 1.6 ticks, and the count is exact to one
 * instruction.
 */
#ifndef SYSTICK_H
#define SYSTICK_H

#include <stdint.h>

#include "start.h"

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)

typedef struct {
    uint32_t worst;
    uint64_t sum;
    uint32_t times;
} tally;

static uint32_t instructions(uint32_t before, uint32_t after)
{
    return ((((before - after) & 0xFFFFFFu) * 5u) + 4u) / 8u;
}

static void add(tally *all, uint32_t before, uint32_t after, uint32_t overhead)
{
    uint32_t count = instructions(before, after);

    count = (count > overhead) ? (count - overhead) : 0u;
    all->sum += count;
    all->times += 1u;
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

static uint32_t mean_of(const tally *all)
{
    return (uint32_t)(all->sum / all->times);
}

/* Begin to count; return the instructions that reading the clock takes. */
static uint32_t begin_count(void)
{
    uint32_t overhead;

    SYSTICK_RELOAD = 0xFFFFFFu;
    SYSTICK_VALUE = 0u;
    SYSTICK_CONTROL = 5u;
    overhead = own_cost();
    check_count(overhead);
    return overhead;
}

#endif
