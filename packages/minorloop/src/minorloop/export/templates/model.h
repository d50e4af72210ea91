/*
 * {{ title }}
 *
 * Input {{ input }}, output {{ output }}.
 * {{ about }}
 * Written by minorloop {{ version }}; change the model and export again rather than this file.
 *
 * Nothing here allocates, blocks, recurses or keeps anything outside the state that it is given,
 * so each state may belong to a thread or an interrupt of its own.
 *
 *     {{ name }}_state state;
 *     {{ name }}_reset(&state);
{%- if inverse and not linear %}
 *     u = {{ name }}_aim(&state, target);   the input that leads to the target
{%- elif inverse %}
 *     u = {{ name }}_aim(&state, target);   the input that leads to the target, when held
{%- endif %}
{%- if linear %}
 *     y = {{ name }}_step(&state, u);       the output one interval later
{%- if inverse %}
 *
 * Hold the input by further steps: the output comes to the target as the linear part settles.
{%- if linear.lag %}
 * Nothing of it is seen for the first {{ linear.lag }} steps.
{%- endif %}
{%- if linear.first == "linear" %}
 * What the linear part overshoots by, the operator remembers; ask again then.
{%- endif %}
{%- endif %}
{%- else %}
 *     y = {{ name }}_step(&state, u);       what the output is then
{%- endif %}
 *
 * Memory is bounded. At most {{ memory }} extrema of the input are remembered; when a history reaches
 * that many, the two next to each other whose loss changes the output least are dropped after the
 * step, as if that loop had never been run. A drop changes the output by the weight of the relays
 * between those two and their neighbours. The {{ memory - 3 }} pairs to choose from have separate relays, so
 * it is never more than 1/{{ memory - 3 }} of the swing of all, {{ single }} in the unit of the output; it heals as
 * soon as the input passes the wider extrema of the pair. {{ name }}_error_bound gives
 * what the drops that have not healed may amount to.
 *
 * Inputs are of the type {{ real }}: its last digit is worth up to {{ input_error }} of the range of the output,
 * where the output is steepest. An offset that is large beside the range of the input costs
 * digits; subtract it before the model is identified.
 */
#ifndef {{ guard }}_H
#define {{ guard }}_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef {{ real }} {{ name }}_real;

/* Extrema of the input that are remembered. */
#define {{ guard }}_MEMORY {{ memory }}
/* Ends of the plane: the relays see inputs beyond them as if they were at the end. */
#define {{ guard }}_INPUT_LOW {{ low }}
#define {{ guard }}_INPUT_HIGH {{ high }}
/* Outputs that the operator reaches with inputs between these ends. */
#define {{ guard }}_OUTPUT_LOW {{ reach_low }}
#define {{ guard }}_OUTPUT_HIGH {{ reach_high }}
{%- if linear %}
/* Seconds between steps; the input is held in between. */
#define {{ guard }}_INTERVAL {{ linear.interval }}
{%- endif %}

/* An extremum: the input, what dropping it with the next one would change, how far it is into its
 * band of the plane, the band, and the output of the relays. What is stored at different times is
 * apart, so that no compiler makes one store of two and lets the input wait for the output. */
typedef struct {
    {{ name }}_real value;
    {{ name }}_real loss;
    {{ name }}_real fraction;
    int32_t band;
    {{ name }}_real output;
} {{ name }}_extremum;

/* All that the past left behind. Only the functions below should touch it. */
typedef struct {
    {{ name }}_extremum past[{{ guard }}_MEMORY + 1]; /* oldest first; place `count` is the present */
    int32_t count;
    int32_t weighed;
    {{ name }}_real error_bound;
    {{ name }}_real error_low;
    {{ name }}_real error_high;
{%- if linear %}
{%- if linear.order %}
    {{ name }}_real x[{{ linear.order }}];
{%- endif %}
{%- if linear.lag %}
    {{ name }}_real queue[{{ linear.lag }}];
    int32_t next;
{%- endif %}
{%- endif %}
    {{ name }}_real y;
} {{ name }}_state;

/* Negative saturation: as after an input at or below {{ guard }}_INPUT_LOW
{%- if linear %}, held until all settled{% endif %}.
 * For positive saturation step {{ guard }}_INPUT_HIGH next; to demagnetise, step a decaying
 * alternation. Call this once before anything else. */
void {{ name }}_reset({{ name }}_state *state);

/* Output after the next input, which is remembered.
 * An input that is not finite is ignored: the state stays and the last output is given again. */
{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u);

/* Output after the last input. */
{{ name }}_real {{ name }}_output(const {{ name }}_state *state);
{% if inverse %}
/* Input nearest to the present one that brings the output to y; nothing is remembered.
{%- if linear %}
 * It leads there when the linear part has settled.
{%- endif %}
 * Beyond what the operator reaches it is the end of the plane that comes nearest; for a y that is
 * not a number it is the present input. */
{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y);
{% endif %}
/* How far the output of the operator can be from that of one which never forgets, in the unit of
 * its output. Zero until the memory overflows for the first time. */
{{ name }}_real {{ name }}_error_bound(const {{ name }}_state *state);

#ifdef __cplusplus
}
#endif

#endif
