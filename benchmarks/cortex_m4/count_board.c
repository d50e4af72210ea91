/*
 * The firmware of a board without its ports: lines of a host, a tick after every second of them.
 * Prints the answers, then instructions of a tick and of a question, worst and mean, and their stack.
 */
#include "control.h"
#include "hal.h"
#include "protocol.h"
#include "start.h"
#include "systick.h"

#define UNUSED_STACK 0x5A5A5A5Au
#define STACK_WORDS 2048

__asm__(".section .rodata\n"
        "host_lines: .incbin \"lines.txt\"\n"
        ".byte 0\n"
        ".previous");
extern const char host_lines[];
extern uint32_t stack_top;

static uint32_t *painted; /* below the frame of work */

uint32_t hal_milliseconds(void)
{
    return 0u;
}

int32_t hal_receive(void)
{
    return -1;
}

void hal_send(const char *text)
{
    say(text);
}

void hal_set(uint32_t input, double value)
{
    (void)input;
    (void)value;
}

int hal_get(uint32_t output, double *value)
{
    *value = (double)output;
    return 1;
}

void hal_switch(uint32_t line, int on)
{
    (void)line;
    (void)on;
}

__attribute__((noinline)) static void paint(void)
{
    uint32_t here;
    uint32_t *next;

    painted = &here - 8;
    for (next = painted - STACK_WORDS; next < painted; ++next) {
        *(volatile uint32_t *)next = UNUSED_STACK;
    }
}

static uint32_t stack_bytes(void)
{
    const volatile uint32_t *next = painted - STACK_WORDS;

    while ((next < painted) && (*next == UNUSED_STACK)) {
        ++next;
    }
    return 4u * (uint32_t)(painted - next);
}

/* Give the protocol a line; return what comes after it. */
static const char *hear(const char *line)
{
    while (*line != '\n') {
        protocol_hear(*line);
        ++line;
    }
    protocol_hear('\n');
    return &line[1];
}

static void run(uint32_t overhead, tally *tick, tally *question)
{
    const char *next = hear(host_lines); /* HELLO */
    uint32_t k;

    for (k = 1u; k < CONTROL_TICK; ++k) {
        control_millisecond();
    }
    while (*next != '\0') {
        const uint32_t before = SYSTICK_VALUE;

        next = hear(next);
        add(question, before, SYSTICK_VALUE, overhead);
        for (k = 0u; k < CONTROL_TICK; ++k) {
            const uint32_t began = SYSTICK_VALUE;
            control_millisecond();
            if (k == 0u) { /* the models follow in this one */
                add(tick, began, SYSTICK_VALUE, overhead);
            }
        }
        next = hear(next);
    }
}

void work(void)
{
    tally tick = {0u, 0u, 0u};
    tally question = {0u, 0u, 0u};
    const uint32_t overhead = begin_count();

    control_begin();
    protocol_begin();
    paint();
    run(overhead, &tick, &question);
    say("counted ");
    say_number(tick.worst);
    say_number(mean_of(&tick));
    say_number(question.worst);
    say_number(mean_of(&question));
    say_number(stack_bytes());
    say("\n");
}
