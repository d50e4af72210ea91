/*
 * What the firmware needs of a board; mps2.c has it for the Arm MPS2 boards and their emulator.
 * Written by minorloop {{ version }}.
 */
#ifndef HAL_H
#define HAL_H

#include <stdint.h>

void hal_begin(void);                            /* clocks, pins and ports; inputs at rest */
uint32_t hal_milliseconds(void);                 /* a clock that may wrap around */
int32_t hal_receive(void);                       /* the next character of the host, or -1 */
void hal_send(const char *text);                 /* characters to the host */
void hal_set(uint32_t input, double value);      /* put an input on, in its unit */
int hal_get(uint32_t output, double *value);     /* read a sensor; 0 if there is no reading */
void hal_switch(uint32_t line, int on);          /* switch a digital line */
void hal_alive(void);                            /* once a millisecond: feed the watchdog timer */
void hal_wait(void);                             /* sleep until something may have happened */

#endif
