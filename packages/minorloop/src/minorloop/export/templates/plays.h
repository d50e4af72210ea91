/*
 * {{ title }}
 *
 * Input {{ input }}, output {{ output }}.
 * {{ plays }} plays.
 * Written by minorloop {{ version }}; change the model and export again rather than this file.
 *
 * Nothing here allocates, blocks, recurses or keeps anything outside the state that it is given.
 * What is remembered is where each play is, so memory never overflows.
 *
 *     {{ name }}_state state;
 *     {{ name }}_reset(&state);
{%- if inverse %}
 *     u = {{ name }}_aim(&state, target);   the input that leads to the target
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

#define {{ guard }}_PLAYS {{ plays }}

/* All that the past left behind. Only the functions below should touch it. */
typedef struct {
    {{ name }}_real place[{{ guard }}_PLAYS];
    {{ name }}_real y;
} {{ name }}_state;

/* Every play at zero: demagnetised. Call this once before anything else. */
void {{ name }}_reset({{ name }}_state *state);

/* Output after the next input, which is remembered.
 * An input that is not finite is ignored: the state stays and the last output is given again. */
{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u);

/* Output after the last input. */
{{ name }}_real {{ name }}_output(const {{ name }}_state *state);
{% if inverse %}
/* Input that brings the output to y; nothing is remembered. For a y that is not finite it is the
 * place of the first play, which is the present input. */
{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y);
{% endif %}
#ifdef __cplusplus
}
#endif

#endif
