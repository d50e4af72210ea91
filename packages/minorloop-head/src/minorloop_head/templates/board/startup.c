/* From reset to main: vectors, initial data, floating-point unit. Written by minorloop {{ version }}. */
#include <stdint.h>

extern uint32_t stack_top, data_begin, data_end, data_stored, bss_begin, bss_end;

int main(void);
void reset(void);
void stuck(void);
void systick_interrupt(void);
void host_interrupt(void);
void sensor_interrupt(void);

/* Until the watchdog timer resets the board, which puts the inputs at rest. */
void stuck(void)
{
    for (;;) {
    }
}

typedef void (*vector)(void);

__attribute__((section(".vectors"), used)) static const vector vectors[16 + 3] = {
    (vector)(uintptr_t)&stack_top, reset, stuck, stuck, stuck, stuck, stuck, 0, 0, 0, 0,
    stuck, stuck, 0, stuck, systick_interrupt,
    host_interrupt, stuck, sensor_interrupt, /* UART 0 receives, UART 0 sends, UART 1 receives */
};

void reset(void)
{
    const uint32_t *from = &data_stored;
    uint32_t *to;

    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: the floating-point unit */
    __asm__ volatile("dsb\n\tisb");
    for (to = &data_begin; to < &data_end; ++to) {
        *to = *from;
        ++from;
    }
    for (to = &bss_begin; to < &bss_end; ++to) {
        *to = 0u;
    }
    (void)main();
    stuck();
}
