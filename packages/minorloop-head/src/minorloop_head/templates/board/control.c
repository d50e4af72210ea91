/* Inputs, their limits, and feedforward. Written by minorloop {{ version }}. */
#include "control.h"

#include "hal.h"
{%- for axis in axes %}
#include "{{ axis.name }}.h"
{%- endfor %}

#include <math.h>

typedef {{ real }} real;

typedef struct {
    double low;
    double high;
    double rest;
    double step;     /* largest change in a millisecond; beyond the range if there is no limit */
    double reach_low;
    double reach_high;
} limits_t;

static const limits_t limits[AXES] = {
{%- for axis in axes %}
    { {{ axis.low }}, {{ axis.high }}, {{ axis.rest }}, {{ axis.step }}, {{ axis.reach_low }}, {{ axis.reach_high }} },
{%- endfor %}
};
{%- if coupled %}
/* Change of the sensor of an axis, a row, for one of the output of another, and its inverse. */
static const double mixing[AXES][AXES] = {
{%- for row in mixing %}
    { {{ row }} },
{%- endfor %}
};
static const double undo[AXES][AXES] = {
{%- for row in undo %}
    { {{ row }} },
{%- endfor %}
};
{%- endif %}

static double present[AXES];
static double goal[AXES];
static double target[AXES];
static int following;
static uint32_t elapsed;
{%- for axis in axes %}
static {{ axis.name }}_state {{ axis.name }};
{%- if axis.heated %}
static {{ axis.name }}_state {{ axis.name }}_ahead;
static real {{ axis.name }}_power; /* effective power, that holds the present temperature */
{%- endif %}
{%- endfor %}

static double between(double value, double low, double high)
{
    return (value < low) ? low : ((value > high) ? high : value);
}
{% for axis in axes %}
{%- set name = axis.name %}
{%- if axis.heated %}
/* Change of the output for a change of the effective power; nothing is remembered. */
static real {{ name }}_peek(real change)
{
    {{ name }}_ahead = {{ name }};
    return {{ name }}_step(&{{ name }}_ahead, {{ name }}_power + change) - {{ name }}_output(&{{ name }});
}

/* The heat lags and takes up the latent heat: lag dw/dt + latent dy/dt = u^2 - w. */
static void {{ name }}_follow(void)
{
    const real u = (real)present[{{ loop.index0 }}];
    const real gap = {{ axis.interval }} * (u * u - {{ name }}_power);
    const real stiff = {{ axis.lag }} + {{ axis.interval }};
    real change = gap / stiff;
{%- if axis.latent %}
    int k;
{%- endif %}

    if ({{ fabs }}(change) >= {{ axis.smallest }}) {
{%- if axis.latent %}
        for (k = 0; k < {{ axis.solves }}; ++k) {
            change = gap / (stiff + {{ axis.latent }} * {{ name }}_peek(change) / change);
        }
{%- endif %}
        {{ name }}_power += change;
        (void){{ name }}_step(&{{ name }}, {{ name }}_power);
    }
}

/* The inverse of the operator gives the effective power, that of the lag the power that leads there. */
static real {{ name }}_inverse(real wanted)
{
    const real change = {{ name }}_aim(&{{ name }}, wanted) - {{ name }}_power;
    real lag = {{ axis.lag }};
    real power;

{%- if axis.latent %}
    if ({{ fabs }}(change) > {{ axis.smallest }}) {
        lag += {{ axis.latent }} * {{ name }}_peek(change) / change;
    }
{%- endif %}
    power = {{ name }}_power + lag * change / {{ axis.response }};
    return (power > (real)0) ? {{ sqrt }}(power) : (real)0;
}
{% else %}
static void {{ name }}_follow(void)
{
    (void){{ name }}_step(&{{ name }}, (real)present[{{ loop.index0 }}]);
}

static real {{ name }}_inverse(real wanted)
{
    return {{ name }}_aim(&{{ name }}, wanted);
}
{% endif %}
{%- endfor %}
static void follow(void)
{
{%- for axis in axes %}
    {{ axis.name }}_follow();
{%- endfor %}
}

/* The inputs may turn back here, which models without a lag have to remember. */
static void remember_turns(void)
{
{%- for axis in axes if not axis.heated %}
    {{ axis.name }}_follow();
{%- endfor %}
}

/* A new goal is not farther than the rate limit allows until the next. */
static void aim_at(uint32_t k, double input)
{
    const double most = limits[k].step * (double)CONTROL_TICK;
    const double allowed = between(input, limits[k].low, limits[k].high);

    goal[k] = between(allowed, present[k] - most, present[k] + most);
}

static void tick(void)
{
{%- if coupled %}
    double own[AXES];
    uint32_t i;
    uint32_t k;

{% endif %}
    follow();
    if (following) {
{%- if coupled %}
        for (i = 0u; i < AXES; ++i) {
            own[i] = 0.0;
            for (k = 0u; k < AXES; ++k) {
                own[i] += undo[i][k] * target[k];
            }
            own[i] = between(own[i], limits[i].reach_low, limits[i].reach_high);
        }
{%- endif %}
{%- for axis in axes %}
{%- set i = loop.index0 %}
        aim_at({{ i }}u, (double){{ axis.name }}_inverse((real)(target[{{ i }}]
            {%- if coupled %}{% for other in axes %}{% if loop.index0 != i %} - mixing[{{ i }}][{{ loop.index0 }}] * own[{{ loop.index0 }}]{% endif %}{% endfor %}{% endif %})));
{%- endfor %}
    }
}

void control_begin(void)
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        present[k] = limits[k].rest;
    }
{%- for axis in axes %}
    {{ axis.name }}_reset(&{{ axis.name }});
{%- if axis.heated %}
    {{ axis.name }}_power = (real)0;
    (void){{ axis.name }}_step(&{{ axis.name }}, (real)0);
{%- endif %}
{%- endfor %}
    elapsed = 0u;
    control_safe();
}

void control_millisecond(void)
{
    uint32_t k;

    elapsed += 1u;
    if (elapsed >= CONTROL_TICK) {
        elapsed = 0u;
        tick();
    }
    for (k = 0u; k < AXES; ++k) {
        if (present[k] != goal[k]) {
            present[k] = between(goal[k], present[k] - limits[k].step, present[k] + limits[k].step);
            hal_set(k, present[k]);
        }
    }
}

void control_safe(void)
{
    uint32_t k;

    remember_turns();
    following = 0;
    for (k = 0u; k < AXES; ++k) {
        goal[k] = limits[k].rest;
        present[k] = limits[k].rest;
        hal_set(k, present[k]);
    }
}

int control_set(const double inputs[AXES])
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        if (!((inputs[k] >= limits[k].low) && (inputs[k] <= limits[k].high))) {
            return 0;
        }
    }
    remember_turns();
    following = 0;
    for (k = 0u; k < AXES; ++k) {
        goal[k] = inputs[k];
    }
    return 1;
}

int control_follow(const double outputs[AXES])
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        if (!((outputs[k] >= limits[k].reach_low) && (outputs[k] <= limits[k].reach_high))) {
            return 0;
        }
    }
    following = 1;
    for (k = 0u; k < AXES; ++k) {
        target[k] = outputs[k];
    }
    return 1;
}

void control_wanted(double values[AXES])
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        values[k] = following ? target[k] : goal[k];
    }
}

void control_on(double inputs[AXES])
{
    uint32_t k;

    for (k = 0u; k < AXES; ++k) {
        inputs[k] = present[k];
    }
}
