/*
 * {{ title }}
 *
 * Input {{ input }}, output {{ output }}.
 * {{ about }}
 * Written by minorloop {{ version }}; change the model and export again rather than this file.
 *
 * Nothing here allocates, blocks, recurses or keeps anything outside the state that it is given.
 * Each call is one interval of {{ seconds }} s, during which the input is held.
 *
 *     {{ name }}_state state;
 *     {{ name }}_reset(&state);
{%- if inverse %}
 *     u = {{ name }}_aim(&state, target);   the input that leads to the target after one interval
{%- endif %}
 *     y = {{ name }}_step(&state, u);       what the output is then
 */
#ifndef {{ guard }}_H
#define {{ guard }}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef {{ real }} {{ name }}_real;

/* Extrema that a state remembers, and planes that share them: one at once, the others late. */
#define {{ guard }}_MEMORY {{ memory }}
#define {{ guard }}_PLANES {{ planes }}

typedef struct {
    {{ name }}_real value;
    {{ name }}_real fraction;
    {{ name }}_real output[{{ guard }}_PLANES];
    int32_t band;
} {{ name }}_extremum;

/* All that the past left behind. Only the functions below should touch it. */
typedef struct {
    {{ name }}_extremum past[{{ guard }}_MEMORY + 1];
    {{ name }}_real creep[{{ guard }}_PLANES];
    {{ name }}_real u;
    {{ name }}_real y;
    int32_t count;
} {{ name }}_state;

/* Negative saturation, settled. Call this once before anything else. */
void {{ name }}_reset({{ name }}_state *state);

/* Output after an interval with this input, which is remembered.
 * An input that is not finite counts as the one before. */
{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u);

/* Output after the last interval. */
{{ name }}_real {{ name }}_output(const {{ name }}_state *state);
{% if inverse %}
/* Input that brings the output to y after one interval; nothing is remembered. For a y that is not
 * finite it is the input before, and for one out of reach an end of the levels. */
{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y);
{% endif %}
#ifdef __cplusplus
}
#endif

#endif
