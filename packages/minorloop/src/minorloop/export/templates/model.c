/*
 * {{ title }}
 * Written by minorloop {{ version }}; see {{ name }}.h for what it does and how to use it.
 *
 * Reduced memory sequence: Mayergoyz, Mathematical Models of Hysteresis, 1991, chapter 1.
{%- if inverse %}
 * Inverse: Tan, Venkataraman and Krishnaprasad, Proc. IEEE CDC 2001.
{%- endif %}
 */
#include "{{ name }}.h"

#include <math.h>

typedef {{ name }}_real real;
typedef {{ name }}_extremum extremum;
typedef {{ name }}_state state_t;

#define BANDS {{ bands }}
#define SLICES {{ slices }}
#define SATURATION ((real){{ saturation }})
{%- if sloped %}
#define SLOPE ((real){{ slope }})
{%- endif %}
/* Output of the operator when it begins. */
#define BEGIN ((real){{ begin }})
#define PER_UNIT ((real){{ per_unit }})
{%- if linear %}
{%- if linear.order %}
#define ORDER {{ linear.order }}
{%- endif %}
{%- if linear.lag %}
#define LAG {{ linear.lag }}
{%- endif %}
#define FEEDTHROUGH ((real){{ linear.feedthrough }})
/* Settled output per input{% if linear.order %}, and state per input{% endif %}. */
#define GAIN ((real){{ linear.gain }})
{%- if linear.order %}
#define REST ((real){{ linear.rest }})
{%- endif %}
{%- endif %}

/* Thresholds, and one over the height of each band. */
static const real levels[BANDS + 1] = {
{{ tables.levels }}
};
static const real per_band[BANDS] = {
{{ tables.per_band }}
};
/* For equal slices of the input range, the last band that begins before the slice. */
static const {{ slice_type }} begun[SLICES] = {
{{ tables.begun }}
};
/* Everett values at the nodes of the plane times the swing of a relay; row a holds a + 1. */
static const real nodes[((BANDS + 1) * (BANDS + 2)) / 2] = {
{{ tables.nodes }}
};
{%- if bowed %}
/* What makes the Everett surface curve inside a band of the diagonal. */
static const real bow[BANDS] = {
{{ tables.bow }}
};
{%- endif %}
{%- if signed %}
/* The same for the weights without their signs: no loss can be more than these say. */
static const real nodes_unsigned[((BANDS + 1) * (BANDS + 2)) / 2] = {
{{ tables.nodes_unsigned }}
};
{%- if bowed %}
static const real bow_unsigned[BANDS] = {
{{ tables.bow_unsigned }}
};
{%- endif %}
{%- endif %}
{%- if linear and linear.order %}
/* Transition row of the companion form, and how the output is made of the state. */
static const real transition[ORDER] = {
{{ tables.transition }}
};
static const real readout[ORDER] = {
{{ tables.readout }}
};
{%- endif %}
{#- The Everett surface, once for the weights and once for their absolute values. #}
{%- macro everett(function, nodes, bow) %}
static inline real {{ function }}_inside(int32_t i, real s, int32_t j, real f)
{
    const real *const row = &{{ nodes }}[(i * (i + 1)) / 2];
    const real *const above = &row[i + 1];
    real value;

    if (i == j) {
        const real x = s - f;
        value = above[i] * x{% if bowed %} - {{ bow }}[i] * x * ((real)1 - x){% endif %};
    } else {
        const real lower = row[j] + f * (row[j + 1] - row[j]);
        const real upper = above[j] + f * (above[j + 1] - above[j]);
        value = lower + s * (upper - lower);
{%- if bowed %}
        value = value - {{ bow }}[i] * s * ((real)1 - s) - {{ bow }}[j] * f * ((real)1 - f);
{%- endif %}
    }
    return value;
}

static real {{ function }}(const extremum *high, const extremum *low)
{
    return {{ function }}_inside(high->band, high->fraction, low->band, low->fraction);
}
{%- endmacro %}

/* Band of the plane that holds u, which is inside it. */
static int32_t band_of(real u)
{
    const real slice = (u - levels[0]) * PER_UNIT;
    const int32_t index = (int32_t)slice;
    int32_t low = (int32_t)begun[index];
{%- if narrow %}

    /* No slice holds more than one threshold. A sum, for no processor can guess which side u is. */
    low += (int32_t)((low < (int32_t)begun[index + 1]) & (levels[low + 1] <= u));
{%- else %}
    int32_t high = (int32_t)begun[index + 1];

    while (low < high) {
        const int32_t middle = (low + high + 1) / 2;
        if (levels[middle] <= u) {
            low = middle;
        } else {
            high = middle - 1;
        }
    }
{%- endif %}
    return low;
}

/* Weight of the relays between two extrema, times their swing. */
{{- everett("everett", "nodes", "bow") }}
{% if signed %}
{{- everett("everett_unsigned", "nodes_unsigned", "bow_unsigned") }}
{% endif %}
/* Even places hold minima, odd ones maxima. */
static int is_maximum(int32_t place)
{
    return (place % 2) != 0;
}

/* Output of the relays at `to` on the branch that leaves `from`. */
static real output_on_branch(const extremum *from, const extremum *to, int rising)
{
    const extremum *const high = rising ? to : from;
    const extremum *const low = rising ? from : to;
    const real weight = everett(high, low);

    return from->output + (rising ? weight : -weight);
}

/* What dropping places k and k + 1 would change: the weight between the extrema around them. */
static void weigh(state_t *state, int32_t k)
{
    if ((k >= 1) && ((k + 2) < state->count)) {
        const extremum *const before = &state->past[k - 1];
        const extremum *const after = &state->past[k + 2];
{%- if signed %}
        const extremum *const first = &state->past[k];
        const extremum *const second = &state->past[k + 1];
        real loss;
        if (is_maximum(k)) {
            loss = everett_unsigned(first, before) - everett_unsigned(first, second)
                - everett_unsigned(after, before) + everett_unsigned(after, second);
        } else {
            loss = everett_unsigned(before, first) - everett_unsigned(second, first)
                - everett_unsigned(before, after) + everett_unsigned(second, after);
        }
        state->past[k].loss = (loss < (real)0) ? -loss : loss;
{%- else %}
        const real change = after->output - output_on_branch(before, after, is_maximum(k));
        state->past[k].loss = (change < (real)0) ? -change : change;
{%- endif %}
    }
}

/* Forget the pair that matters least, and keep count of what it may amount to. */
static void drop_smallest(state_t *state)
{
    extremum *const past = state->past;
    int32_t least = 1;
    int32_t k;
    real change;
    real low;
    real high;

    for (k = 2; (k + 2) < state->count; ++k) {
        if (past[k].loss < past[least].loss) {
            least = k;
        }
    }
    low = is_maximum(least) ? past[least - 1].value : past[least].value;
    high = is_maximum(least) ? past[least].value : past[least - 1].value;
    state->error_low = (low < state->error_low) ? low : state->error_low;
    state->error_high = (high > state->error_high) ? high : state->error_high;
    state->error_bound += past[least].loss;
    change = past[least + 2].output
        - output_on_branch(&past[least - 1], &past[least + 2], is_maximum(least));
    state->count -= 2;
    state->weighed = state->count - 2;
    for (k = least; k <= state->count; ++k) {
        past[k] = past[k + 2];
        past[k].output -= change;
    }
    weigh(state, least - 2);
    weigh(state, least - 1);
    weigh(state, least);
}

/* The first place that has not been weighed, if what it takes is there. */
static void weigh_next(state_t *state)
{
    if ((state->weighed + 2) < state->count) {
        weigh(state, state->weighed);
        state->weighed += 1;
    }
}

/* The present input becomes an extremum of the past.
 * Most histories are short and are never weighed. From half the room on, two places are weighed
 * for each that is filled, so that all have been when there is no more room. */
static void remember(state_t *state)
{
    state->count += 1;
    if (state->count > ({{ guard }}_MEMORY / 2)) {
        weigh_next(state);
        weigh_next(state);
    }
}

/* Loops that an input passes are forgotten for good. */
static void wipe_out(state_t *state, real u, int rising)
{
    int32_t top = state->count;

    if (rising) {
        while ((top >= 3) && (u >= state->past[top - 2].value)) {
            top -= 2;
        }
    } else {
        while ((top >= 2) && (u <= state->past[top - 2].value)) {
            top -= 2;
        }
    }
    state->count = top;
    if ((state->weighed > 1) && (state->weighed > (top - 2))) {
        state->weighed = (top > 3) ? (top - 2) : 1;
    }
    if ((state->error_bound > (real)0) && ((u >= state->error_high) || (u <= state->error_low))) {
        state->error_bound = (real)0;
        state->error_low = levels[BANDS];
        state->error_high = levels[0];
    }
}

static void relays_begin(state_t *state)
{
    state->count = 0;
    state->past[0].value = levels[0];
    state->past[0].output = SATURATION;
    state->past[0].fraction = (real)0;
    state->past[0].loss = (real)0;
    state->past[0].band = 0;
    state->weighed = 1;
    state->error_bound = (real)0;
    state->error_low = levels[BANDS];
    state->error_high = levels[0];
}

/* Output of the relays after the next input. Room for another extremum is made afterwards, so that
 * an input that the inverse chose gives the output that it was chosen for.
 * What was just stored is not read back, for that would take longer than all the sums. */
static real relays_step(state_t *state, real u)
{
    const real before = state->past[state->count].value;
    real output = state->past[state->count].output;
    real x = u;

    if (x < levels[0]) {
        x = levels[0];
    } else if (x > levels[BANDS]) {
        x = levels[BANDS];
    } else {
        /* inside the plane */
    }
    if (x != before) {
        const int rising = x > before;
        const int32_t band = band_of(x);
        const real fraction = (x - levels[band]) * per_band[band];
        extremum *now;

        if (rising != is_maximum(state->count)) {
            remember(state);
        }
        wipe_out(state, x, rising);
        now = &state->past[state->count];
        output = SATURATION;
        if (state->count > 0) {
            const extremum *const from = now - 1;
            const int32_t i = rising ? band : from->band;
            const int32_t j = rising ? from->band : band;
            const real s = rising ? fraction : from->fraction;
            const real f = rising ? from->fraction : fraction;
            const real weight = everett_inside(i, s, j, f);
            output = from->output + (rising ? weight : -weight);
        }
        now->value = x;
        now->output = output;
        now->fraction = fraction;
        now->band = band;
        if (state->count >= {{ guard }}_MEMORY) {
            drop_smallest(state);
        }
    }
    return output;
}
{% if linear %}
/* The linear part settled under an input. */
static void linear_begin(state_t *state, real u)
{
{%- if linear.order or linear.lag %}
    int32_t k;
{% endif %}
{%- if linear.order %}
    for (k = 0; k < ORDER; ++k) {
        state->x[k] = u * REST;
    }
{%- endif %}
{%- if linear.lag %}
    for (k = 0; k < LAG; ++k) {
        state->queue[k] = u;
    }
    state->next = 0;
{%- endif %}
    state->y = u * GAIN;
}

/* Output of the linear part at the end of an interval over which u was held. */
static real linear_step(state_t *state, real u)
{
{%- if linear.lag %}
    const real felt = state->queue[state->next];
{%- else %}
    const real felt = u;
{%- endif %}
    real y = FEEDTHROUGH * felt;
{%- if not linear.order and not linear.lag %}

    (void)state;
{%- endif %}
{%- if linear.order %}
    real first = felt;
    int32_t k;

    for (k = 0; k < ORDER; ++k) {
        first += transition[k] * state->x[k];
    }
    for (k = ORDER - 1; k > 0; --k) {
        state->x[k] = state->x[k - 1];
    }
    state->x[0] = first;
    for (k = 0; k < ORDER; ++k) {
        y += readout[k] * state->x[k];
    }
{%- endif %}
{%- if linear.lag %}

    state->queue[state->next] = u;
    state->next = (state->next + 1) % LAG;
{%- endif %}
    return y;
}
{% endif %}
void {{ name }}_reset({{ name }}_state *state)
{
    relays_begin(state);
{%- if not linear %}
    state->y = BEGIN;
{%- elif linear.first == "operator" %}
    linear_begin(state, BEGIN);
{%- else %}
    linear_begin(state, levels[0] / GAIN);
    state->y = BEGIN;
{%- endif %}
}

{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u)
{
    if (isfinite(u)) {
{%- if not linear %}
        state->y = relays_step(state, u){% if sloped %} + SLOPE * u{% endif %};
{%- elif linear.first == "operator" %}
        state->y = linear_step(state, relays_step(state, u){% if sloped %} + SLOPE * u{% endif %});
{%- else %}
        const real felt = linear_step(state, u);
        state->y = relays_step(state, felt){% if sloped %} + SLOPE * felt{% endif %};
{%- endif %}
    }
    return state->y;
}

{{ name }}_real {{ name }}_output(const {{ name }}_state *state)
{
    return state->y;
}

{{ name }}_real {{ name }}_error_bound(const {{ name }}_state *state)
{
    return state->error_bound;
}
{%- if inverse %}

/* Output of the operator on the branch from the pivot, a fraction into a band. */
static real along(const extremum *pivot, int rising, int32_t band, real fraction)
{
    extremum there;

    there.value = levels[band] + fraction * (levels[band + 1] - levels[band]);
    there.output = (real)0;
    there.fraction = fraction;
    there.loss = (real)0;
    there.band = band;
    return output_on_branch(pivot, &there, rising){% if sloped %} + SLOPE * there.value{% endif %};
}

/* Smallest x in [0, 1] with c0 + c1 x + c2 x^2 = 0, given c0 <= 0 and a rise somewhere.
 * The root is c0 over the larger of two sums, so that nothing cancels. The coefficients are divided
 * by the largest, so that no square overflows or vanishes. */
static real smallest_root(real c0, real c1, real c2)
{
    real size = -c0;
    real square;
    real below;
    real x = (real)1;

    if (c0 >= (real)0) {
        x = (real)0;
    } else {
        size = (c1 > size) ? c1 : ((-c1 > size) ? -c1 : size);
        size = (c2 > size) ? c2 : ((-c2 > size) ? -c2 : size);
        c0 /= size;
        c1 /= size;
        c2 /= size;
        square = c1 * c1 - (real)4 * c2 * c0;
        below = c1 + {{ sqrt }}((square > (real)0) ? square : (real)0);
        if (below > (real)0) {
            x = ((real)-2 * c0) / below;
        }
    }
    return (x < (real)1) ? x : (real)1;
}

/* Input in a band where the branch from the pivot meets the target: three points of the branch
 * give the quadratic that it is there. */
static real branch_input(const extremum *pivot, int rising, int32_t band, real target)
{
    const real sign = rising ? (real)1 : (real)-1;
    const real end = rising ? (real)1 : (real)0;
    real start = rising ? (real)0 : (real)1;
    real fraction = end;
    real y0;
    real yh;
    real y1;

    if (band == pivot->band) {
        start = pivot->fraction;
    }
    y0 = sign * (along(pivot, rising, band, start) - target);
    yh = sign * (along(pivot, rising, band, (real)0.5 * (start + end)) - target);
    y1 = sign * (along(pivot, rising, band, end) - target);
    if (y1 >= (real)0) {
        fraction = start + (end - start)
            * smallest_root(y0, (real)4 * yh - (real)3 * y0 - y1, (real)2 * (y0 + y1 - (real)2 * yh));
    }
    /* The end of a band is its threshold to the last bit. */
    return (fraction < (real)1)
        ? (levels[band] + fraction * (levels[band + 1] - levels[band]))
        : levels[band + 1];
}

/* First band from `near` to `stop` at whose far end the target is reached. */
static int32_t branch_band(const extremum *pivot, int rising, int32_t near, int32_t stop, real target)
{
    int32_t low = rising ? near : stop;
    int32_t high = rising ? stop : near;

    while (low < high) {
        if (rising) {
            const int32_t middle = (low + high) / 2;
            if (along(pivot, 1, middle, (real)1) >= target) {
                high = middle;
            } else {
                low = middle + 1;
            }
        } else {
            const int32_t middle = (low + high + 1) / 2;
            if (along(pivot, 0, middle, (real)0) <= target) {
                low = middle;
            } else {
                high = middle - 1;
            }
        }
    }
    return low;
}

/* An extremum that a branch passes on its way wipes out the loop that it closed, so the branch
 * goes on from an older pivot. The target lies before the first extremum not passed. */
static real march(const state_t *state, real target, int rising)
{
    const extremum *const now = &state->past[state->count];
    const real sign = rising ? (real)1 : (real)-1;
    real limit = rising ? levels[BANDS] : levels[0];
    int32_t stop = rising ? (BANDS - 1) : 0;
    int32_t top = state->count;
    real u = levels[0];

    if (rising != is_maximum(top)) {
        top += 1;
    }
    while (top >= (rising ? 3 : 2)) {
        const extremum *const ahead = &state->past[top - 2];
        if (sign * (target - ahead->output{% if sloped %} - SLOPE * ahead->value{% endif %}) <= (real)0) {
            limit = ahead->value;
            stop = ahead->band;
            break;
        }
        top -= 2;
    }
    if (top > 0) {
        const extremum *const pivot = &state->past[top - 1];
        const int32_t band = branch_band(pivot, rising, now->band, stop, target);
        u = branch_input(pivot, rising, band, target);
        if (rising) {
            u = (u < now->value) ? now->value : u;
            u = (u > limit) ? limit : u;
        } else {
            u = (u > now->value) ? now->value : u;
            u = (u < limit) ? limit : u;
        }
    }
    return u;
}

{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y)
{
    const extremum *const now = &state->past[state->count];
    const real here = now->output{% if sloped %} + SLOPE * now->value{% endif %};
    real target = y{% if linear and linear.first == "operator" %} / GAIN{% endif %};
    real u = now->value;

    target = (target < (real){{ guard }}_OUTPUT_LOW) ? (real){{ guard }}_OUTPUT_LOW : target;
    target = (target > (real){{ guard }}_OUTPUT_HIGH) ? (real){{ guard }}_OUTPUT_HIGH : target;
    if (target > here) {
        u = march(state, target, 1);
    } else if (target < here) {
        u = march(state, target, 0);
    } else {
        /* there already, or not a number */
    }
    return u{% if linear and linear.first == "linear" %} / GAIN{% endif %};
}
{%- endif %}
