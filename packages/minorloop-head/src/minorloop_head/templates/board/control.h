/*
 * Inputs, their limits, and feedforward by the exact inverse of the models.
 * Written by minorloop {{ version }}.
 *
 * Every millisecond each input moves towards its goal, at most at its rate limit. Every {{ tick }} ms the
 * models follow the inputs that were on; where targets are followed, their inverses set new goals.
 * A model begins cold: in negative saturation{% if heated %}, at no power{% endif %}.
 */
#ifndef CONTROL_H
#define CONTROL_H

#include <stdint.h>

#define AXES {{ count }}u
#define CONTROL_TICK {{ tick }}u /* milliseconds */

void control_begin(void);                        /* models at their beginning, inputs at rest */
void control_millisecond(void);                  /* call this once a millisecond */
void control_safe(void);                         /* safe inputs, at once */
int control_set(const double inputs[AXES]);      /* goals; 0 and nothing done if one is beyond limits */
int control_follow(const double outputs[AXES]);  /* targets; 0 and nothing done if out of reach */
void control_wanted(double values[AXES]);        /* goals that were set, or targets */
void control_on(double inputs[AXES]);            /* inputs that are on */

#endif
