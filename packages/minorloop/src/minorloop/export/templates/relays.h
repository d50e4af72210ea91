/*
 * {{ title }}
 *
 * Input {{ input }}, output {{ output }}.
 * {{ levels }} levels.
 * Written by minorloop {{ version }}; change the model and export again rather than this file.
 *
 * Nothing here allocates, blocks, recurses or keeps anything outside the state that it is given.
 * What is remembered is how far up each column of relays is on, so memory never overflows.
 *
 *     {{ name }}_state state;
 *     {{ name }}_reset(&state);
 *     y = {{ name }}_step(&state, u);       what the output is then
 */
#ifndef {{ guard }}_H
#define {{ guard }}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef {{ real }} {{ name }}_real;

#define {{ guard }}_LEVELS {{ levels }}
/* The least and the greatest threshold. */
#define {{ guard }}_INPUT_LOW {{ low }}
#define {{ guard }}_INPUT_HIGH {{ high }}

/* All that the past left behind. Only the functions below should touch it. */
typedef struct {
    int16_t on[{{ guard }}_LEVELS]; /* relays of each column that are on, counted from below */
    int16_t level;                  /* thresholds at or below the present input */
    {{ name }}_real y;
} {{ name }}_state;

/* Negative saturation: every relay off. Call this once before anything else. */
void {{ name }}_reset({{ name }}_state *state);

/* Output after the next input, which is remembered.
 * An input that is not finite is ignored: the state stays and the last output is given again. */
{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u);

/* Output after the last input. */
{{ name }}_real {{ name }}_output(const {{ name }}_state *state);

#ifdef __cplusplus
}
#endif

#endif
