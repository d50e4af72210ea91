/*
 * {{ title }}
 * Written by minorloop {{ version }}; see {{ name }}.h for what it does and how to use it.
 *
 * Plays: Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, chapter 2.
{%- if inverse %}
 * Inverse: Krejci and Kuhnen, IEE Proc. Control Theory and Applications 148 (2001) 185.
{%- endif %}
{%- if bent %}
 * Bent: Kuhnen, European Journal of Control 9 (2003) 407.
{%- endif %}
 */
#include "{{ name }}.h"

#include <math.h>

typedef {{ name }}_real real;

#define PLAYS {{ guard }}_PLAYS
#define OFFSET ((real){{ offset }})
{%- if bent %}
#define SHIFT ((real){{ shift }})
#define CORNERS {{ corners }}
#define ORIGIN {{ origin }}
{%- endif %}

/* Slack of each play on either side, and slope of the output while the plays up to it move. */
static const real radii[PLAYS] = {
{{ tables.radii }}
};
static const real slopes[PLAYS] = {
{{ tables.slopes }}
};

{%- if bent %}

/* The curve that bends the plays: its corners, the origin among them, and the slopes of the pieces
 * before, between and after them. Each piece starts from its corner nearer to the origin. */
static const real corners[CORNERS] = {
{{ tables.corners }}
};
static const real heights[CORNERS] = {
{{ tables.heights }}
};
static const real gains[CORNERS + 1] = {
{{ tables.gains }}
};

/* The piece that x is on, given where the pieces begin. */
static int32_t piece_of(const real begins[CORNERS], real x)
{
    int32_t k = 0;

    while ((k < CORNERS) && (begins[k] < x)) {
        k += 1;
    }
    return k;
}

static real bent(real x)
{
    const int32_t piece = piece_of(corners, x);
    const int32_t corner = (piece > ORIGIN) ? (piece - 1) : piece;

    return heights[corner] + gains[piece] * (x - corners[corner]);
}
{%- if inverse %}

static real straightened(real y)
{
    const int32_t piece = piece_of(heights, y);
    const int32_t corner = (piece > ORIGIN) ? (piece - 1) : piece;

    return corners[corner] + (y - heights[corner]) / gains[piece];
}
{%- endif %}
{%- endif %}

/* Weighted sum of the places. Weights of either sign cancel; running sums and gaps do not. */
static real weighed(const real place[PLAYS])
{
    real total = slopes[PLAYS - 1] * place[PLAYS - 1];
    int32_t k;

    for (k = 0; k < (PLAYS - 1); ++k) {
        total += slopes[k] * (place[k] - place[k + 1]);
    }
    return total;
}

void {{ name }}_reset({{ name }}_state *state)
{
    int32_t k;

    for (k = 0; k < PLAYS; ++k) {
        state->place[k] = (real)0;
    }
    state->y = {% if bent %}SHIFT + bent(OFFSET){% else %}OFFSET{% endif %};
}

{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u)
{
    int32_t k;

    if (isfinite(u)) {
        for (k = 0; k < PLAYS; ++k) {
            const real low = u - radii[k];
            const real high = u + radii[k];
            real place = state->place[k];
            place = (place < low) ? low : place;
            state->place[k] = (place > high) ? high : place;
        }
        state->y = {% if bent %}SHIFT + bent(OFFSET + weighed(state->place)){% else %}OFFSET + weighed(state->place){% endif %};
    }
    return state->y;
}

{{ name }}_real {{ name }}_output(const {{ name }}_state *state)
{
    return state->y;
}
{%- if inverse %}

/* Plays are picked up in the order of their radii: each has a corner, where the next one moves. */
{{ name }}_real {{ name }}_aim(const {{ name }}_state *state, {{ name }}_real y)
{
{%- if bent %}
    real rest = (straightened(isfinite(y) ? (y - SHIFT) : (real)0) - OFFSET) - weighed(state->place);
{%- else %}
    real rest = (y - OFFSET) - weighed(state->place);
{%- endif %}
    const real side = (rest > (real)0) ? (real)1 : (real)-1;
    real u = state->place[0];
    int32_t k = 0;

    if (isfinite(y)) {
        while (k < (PLAYS - 1)) {
            const real corner = state->place[k + 1] + side * radii[k + 1];
            const real gain = slopes[k] * (corner - u);
            if ((side * rest) <= (side * gain)) {
                break;
            }
            rest -= gain;
            u = corner;
            k += 1;
        }
        u += rest / slopes[k];
    }
    return u;
}
{%- endif %}
