/*
 * Self-test of {{ name }}.c: does it give on this machine what minorloop gave in Python?
 * Compile it together with {{ name }}.c and run it; it prints the worst error and exits with 0
 * if that is within {{ tolerance }} of the range of the output.
 * Written by minorloop {{ version }}.
 */
#include "{{ name }}.h"

#include <stdio.h>

#define COUNT {{ count }}

static const {{ name }}_real inputs[COUNT] = {
{{ tables.inputs }}
};
static const double outputs[COUNT] = {
{{ tables.outputs }}
};
{%- if both_ways %}
static const {{ name }}_real targets[COUNT] = {
{{ tables.targets }}
};
{%- endif %}
{%- if asked %}
/* What brings the output to a target once all has settled, asked after the input of this index. */
#define ASKED {{ asked.count }}
static const int asked_after[ASKED] = {
{{ tables.asked_after }}
};
static const {{ name }}_real asked_targets[ASKED] = {
{{ tables.asked_targets }}
};
static const {{ name }}_real asked_inputs[ASKED] = {
{{ tables.asked_inputs }}
};
{%- endif %}

static double distance({{ name }}_real found, double wanted)
{
    const double error = (double)found - wanted;

    return (error < 0.0) ? -error : error;
}

int main(void)
{
    {{ name }}_state state;
    double forward = 0.0;
{%- if both_ways or asked %}
    double inverse = 0.0;
{%- endif %}
{%- if asked %}
    int next = 0;
{%- endif %}
    int k;

    {{ name }}_reset(&state);
    for (k = 0; k < COUNT; ++k) {
        const double error = distance({{ name }}_step(&state, inputs[k]), outputs[k]);
        forward = (error > forward) ? error : forward;
{%- if asked %}
        if ((next < ASKED) && (asked_after[next] == k)) {
            const double missed =
                distance({{ name }}_aim(&state, asked_targets[next]), (double)asked_inputs[next]);
            inverse = (missed > inverse) ? missed : inverse;
            next += 1;
        }
{%- endif %}
    }
{%- if both_ways %}
    {{ name }}_reset(&state);
    for (k = 0; k < COUNT; ++k) {
        const {{ name }}_real u = {{ name }}_aim(&state, targets[k]);
        const double error = distance({{ name }}_step(&state, u), (double)targets[k]);
        inverse = (error > inverse) ? error : inverse;
    }
{%- endif %}
{%- if both_ways %}
    (void)printf("worst error, of range: forward %.3g, inverse %.3g\n", forward / {{ width }},
                 inverse / {{ width }});
    forward = (inverse > forward) ? inverse : forward;
{%- elif asked %}
    (void)printf("worst error, of range: forward %.3g, inverse %.3g\n", forward / {{ width }},
                 inverse / {{ asked.span }});
    if (inverse > {{ asked_tolerance }} * {{ asked.span }}) {
        return 1;
    }
{%- else %}
    (void)printf("worst error, of range: forward %.3g\n", forward / {{ width }});
{%- endif %}
    return (forward <= {{ tolerance }} * {{ width }}) ? 0 : 1;
}
