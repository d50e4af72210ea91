/* Bare Cortex-M4F: vectors, floating point on, and words to the host by semihosting. */
#include "start.h"

extern uint32_t stack_top;

void begin(void);
static void stuck(void);

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &stack_top, (const void *)begin, (const void *)stuck, (const void *)stuck,
    (const void *)stuck, (const void *)stuck, (const void *)stuck,
};

static uint32_t host(uint32_t operation, uintptr_t argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void say(const char *text)
{
    (void)host(0x04u, (uintptr_t)text);
}

void say_number(uint32_t number)
{
    char digits[12];
    char *next = &digits[11];

    *next = '\0';
    do {
        next -= 1;
        *next = (char)('0' + (int)(number % 10u));
        number /= 10u;
    } while (number != 0u);
    say(next);
    say(" ");
}

void stop(int failed)
{
    (void)host(0x18u, failed ? 0x20023u : 0x20026u);
    for (;;) {
    }
}

static void stuck(void)
{
    say("fault\n");
    stop(1);
}

void begin(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: the floating-point unit */
    __asm__ volatile("dsb\n\tisb");
    work();
    stop(0);
}
