/*
 * {{ title }}
 * Written by minorloop {{ version }}; see {{ name }}.h for what it does and how to use it.
 *
 * Reduced memory sequence: Mayergoyz, Mathematical Models of Hysteresis, 1991, chapter 1.
{%- if thermal %}
 * Fluctuation field: Neel, Annales de Geophysique 5 (1949).
{%- endif %}
{%- if inverse %}
 * Roots: Chandrupatla, Advances in Engineering Software 28 (1997).
{%- endif %}
 */
#include "{{ name }}.h"

#include <math.h>

typedef {{ name }}_real real;
typedef {{ name }}_extremum extremum;
typedef {{ name }}_state state_t;

#define BANDS {{ bands }}
#define PLANES {{ guard }}_PLANES
#define SLOPE ((real){{ slope }})
{%- if thermal %}
/* Share of the relaxation of the effective input that happens in one interval. */
#define LOST ((real){{ lost }})
{%- endif %}
{%- if inverse %}
/* Most steps of a search, and the width over the input at which it ends. */
#define STEPS 200
#define LEAST ((real){{ least }})
{%- endif %}

/* Thresholds{% if thermal %}, and the same over the fluctuation field{% endif %}. */
static const real levels[BANDS + 1] = {
{{ tables.levels }}
};
{%- if thermal %}
static const real marks[BANDS + 1] = {
{{ tables.marks }}
};
{%- else %}
#define marks levels
{%- endif %}
/* Everett values at the nodes of each plane times the swing of a relay; row a holds a + 1. */
#define NODES (((BANDS + 1) * (BANDS + 2)) / 2)
static const real nodes[PLANES * NODES] = {
{{ tables.nodes }}
};
{%- if bowed %}
/* What makes the Everett surface curve inside a band of the diagonal. */
static const real bow[PLANES * BANDS] = {
{{ tables.bow }}
};
{%- else %}
/* What follows the input itself, at the levels. */
static const real reversible[PLANES * (BANDS + 1)] = {
{{ tables.reversible }}
};
{%- endif %}
/* Outputs of the planes with all relays off, and what each gains in one interval. */
static const real saturation[PLANES] = {
{{ tables.saturation }}
};
static const real gained[PLANES] = {
{{ tables.gained }}
};

static real absolute(real x)
{
    return (x < (real)0) ? -x : x;
}

static real clamped(real x, real low, real high)
{
    real inside = (x < low) ? low : x;

    return (inside > high) ? high : inside;
}

/* Band of increasing numbers that holds x, which is inside them. */
static int32_t band_of(const real begins[BANDS + 1], real x)
{
    int32_t low = 0;
    int32_t high = BANDS - 1;

    while (low < high) {
        const int32_t middle = (low + high + 1) / 2;
        if (begins[middle] <= x) {
            low = middle;
        } else {
            high = middle - 1;
        }
    }
    return low;
}
{%- if thermal %}

/* Effective input after the share `lost` of its relaxation; nothing cancels far from the target. */
static real relaxed(real x, real target, real lost)
{
    const real w = x - target;
    const real far = {{ exp }}(-absolute(w));
    const real rest = ((real)2 * far + ((real)1 - far) * lost) / ((real)1 + far);
    const real left = {{ log }}(((real)2 - rest) / rest);

    return (w > (real)0) ? (target + left) : (target - left);
}
{%- endif %}

/* Weight of the relays of a plane between two extrema, times their swing. */
static real everett(int32_t plane, const extremum *high, const extremum *low)
{
    const int32_t i = high->band;
    const int32_t j = low->band;
    const real s = high->fraction;
    const real f = low->fraction;
    const real *const row = &nodes[plane * NODES + (i * (i + 1)) / 2];
    const real *const above = &row[i + 1];
    real value;

    if (i == j) {
        const real x = s - f;
        value = above[i] * x;
{%- if bowed %}
        value -= bow[plane * BANDS + i] * x * ((real)1 - x);
{%- endif %}
    } else {
        const real lower = row[j] + f * (row[j + 1] - row[j]);
        const real upper = above[j] + f * (above[j + 1] - above[j]);
        value = lower + s * (upper - lower);
{%- if bowed %}
        value -= bow[plane * BANDS + i] * s * ((real)1 - s);
        value -= bow[plane * BANDS + j] * f * ((real)1 - f);
{%- endif %}
    }
    return value;
}

/* Output of a plane at `to` on the branch that leaves `from`. */
static real on_branch(int32_t plane, const extremum *from, const extremum *to)
{
    const int rising = to->value > from->value;
    const real weight = rising ? everett(plane, to, from) : everett(plane, from, to);

    return from->output[plane] + (rising ? weight : -weight);
}

/* The place of an effective input among the extrema, from that before. */
static int32_t place_of(const state_t *state, int32_t place, real x, int rising)
{
    int32_t top = place;

    while ((top >= (rising ? 3 : 2))
           && (rising ? (x >= state->past[top - 2].value) : (x <= state->past[top - 2].value))) {
        top -= 2;
    }
    return top;
}

/* The extremum at an effective input, which would have that place. */
static extremum extremum_at(const state_t *state, int32_t place, real x)
{
    extremum now;
    int32_t k;

    now.value = x;
    now.band = band_of(marks, x);
    now.fraction = (x - marks[now.band]) / (marks[now.band + 1] - marks[now.band]);
    for (k = 0; k < PLANES; ++k) {
        now.output[k] = (place == 0) ? saturation[k] : on_branch(k, &state->past[place - 1], &now);
    }
    return now;
}

/* Output after an interval with an input; fills the extremum that it becomes, its place among
 * those of the past, and what each plane gives then, with what is reversible. */
static real look(const state_t *state, real u, extremum *now, int32_t *place, real after[PLANES])
{
    const extremum *const last = &state->past[state->count];
    const real inside = clamped(u, levels[0], levels[BANDS]);
{%- if thermal or not bowed %}
    const int32_t at = band_of(levels, inside);
    const real part = (inside - levels[at]) / (levels[at + 1] - levels[at]);
{%- endif %}
    int32_t top = state->count;
    int32_t k;
    real x = inside;
    real y = SLOPE * u;
{%- if thermal %}
    const real target = marks[at] + part * (marks[at + 1] - marks[at]);

    x = clamped(relaxed(last->value, target, LOST), marks[0], marks[BANDS]);
{%- endif %}

    *now = *last;
    if (x != last->value) {
        const int rising = x > last->value;
        if (rising == ((top % 2) == 0)) {
            top += 1;
        }
        top = place_of(state, top, x, rising);
        *now = extremum_at(state, top, x);
    }
    *place = top;
    for (k = 0; k < PLANES; ++k) {
        real whole = now->output[k];
{%- if not bowed %}
        const real *const row = &reversible[k * (BANDS + 1) + at];
        whole += row[0] + part * (row[1] - row[0]);
{%- endif %}
        after[k] = state->creep[k] + gained[k] * (whole - state->creep[k]);
        y += after[k];
    }
    return y;
}

/* What dropping places k and k + 1 would change, in all planes. */
static real loss_of(const state_t *state, int32_t k)
{
    real loss = (real)0;
    int32_t p;

    for (p = 0; p < PLANES; ++p) {
        const extremum *const after = &state->past[k + 2];
        loss += absolute(after->output[p] - on_branch(p, &state->past[k - 1], after));
    }
    return loss;
}

/* Forget the pair of extrema that matters least. */
static void drop_smallest(state_t *state)
{
    extremum *const past = state->past;
    int32_t least = 1;
    int32_t k;
    int32_t p;
    real smallest = loss_of(state, 1);
    real change[PLANES];

    for (k = 2; (k + 2) <= state->count; ++k) {
        const real loss = loss_of(state, k);
        if (loss < smallest) {
            smallest = loss;
            least = k;
        }
    }
    for (p = 0; p < PLANES; ++p) {
        change[p] = past[least + 2].output[p] - on_branch(p, &past[least - 1], &past[least + 2]);
    }
    state->count -= 2;
    for (k = least; k <= state->count; ++k) {
        past[k] = past[k + 2];
        for (p = 0; p < PLANES; ++p) {
            past[k].output[p] -= change[p];
        }
    }
}

void {{ name }}_reset({{ name }}_state *state)
{
    int32_t k;

    state->count = 0;
    state->past[0].value = marks[0];
    state->past[0].fraction = (real)0;
    state->past[0].band = 0;
    state->u = levels[0];
    state->y = SLOPE * levels[0];
    for (k = 0; k < PLANES; ++k) {
        state->past[0].output[k] = saturation[k];
        state->creep[k] = saturation[k];
        state->y += saturation[k];
    }
}

{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u)
{
    extremum now;
    real after[PLANES];
    int32_t place;
    int32_t k;

    if (isfinite(u)) {
        state->u = u;
    }
    state->y = look(state, state->u, &now, &place, after);
    state->count = place;
    state->past[place] = now;
    for (k = 0; k < PLANES; ++k) {
        state->creep[k] = after[k];
    }
    if (state->count >= {{ guard }}_MEMORY) {
        drop_smallest(state);
    }
    return state->y;
}

{{ name }}_real {{ name }}_output(const {{ name }}_state *state)
{
    return state->y;
}
{%- if inverse %}

/* Output after an interval, less the target. */
static real missed(const state_t *state, real u, real target)
{
    extremum now;
    real after[PLANES];
    int32_t place;

    return look(state, u, &now, &place, after) - target;
}

{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y)
{
    real a = clamped(state->u, levels[0], levels[BANDS]);
    real fa = missed(state, a, y);
    real b = (fa > (real)0) ? levels[0] : levels[BANDS];
    real fb = missed(state, b, y);
    real c = a;
    real fc = fa;
    real share = (real)0.5;
    int32_t k;

    if (!isfinite(y) || (fa == (real)0)) {
        b = a;
        fb = fa;
    }
    if ((fb != (real)0) && ((fa > (real)0) != (fb > (real)0))) {
        for (k = 0; k < STEPS; ++k) {
            const real x = a + share * (b - a);
            const real fx = missed(state, x, y);
            real wide;
            real size;
            real xi;
            real phi;
            real least;
            if ((fx > (real)0) == (fa > (real)0)) {
                c = a;
                fc = fa;
            } else {
                c = b;
                fc = fb;
                b = a;
                fb = fa;
            }
            a = x;
            fa = fx;
            wide = absolute(b - a);
            size = (absolute(a) > absolute(b)) ? absolute(a) : absolute(b);
            if ((fa == (real)0) || (wide <= (LEAST * size))) {
                break;
            }
            xi = (a - b) / (c - b);
            phi = (fa - fb) / (fc - fb);
            share = (real)0.5;
            if (((phi * phi) < xi) && ((((real)1 - phi) * ((real)1 - phi)) < ((real)1 - xi))) {
                share = fa / (fb - fa) * fc / (fb - fc);
                share += (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb);
            }
            least = (real)0.5 * LEAST * size / wide;
            share = clamped(share, least, (real)1 - least);
        }
        b = (absolute(fa) < absolute(fb)) ? a : b;
    }
    return b;
}
{%- endif %}
