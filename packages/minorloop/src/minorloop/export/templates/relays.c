/*
 * {{ title }}
 * Written by minorloop {{ version }}; see {{ name }}.h for what it does and how to use it.
 *
 * A relay of column b switches off when the input falls below threshold b, and on when it reaches
 * the threshold of its row: so those of a column that are on lie below one row.
 * Mayergoyz, Mathematical Models of Hysteresis, 1991, section 1.1.
 */
#include "{{ name }}.h"

#include <math.h>

typedef {{ name }}_real real;

#define LEVELS {{ guard }}_LEVELS
#define CELLS {{ cells }}
#define OFF ((real){{ off }})
#define SWING ((real){{ swing }})

static const real levels[LEVELS] = {
{{ tables.levels }}
};
/* Weight of each column up to each row, columns one after the other, and where each begins. */
static const real columns[CELLS] = {
{{ tables.columns }}
};
static const int32_t begins[LEVELS] = {
{{ tables.begins }}
};

/* Columns are added up anew, so that rounding does not pile up. */
static real output(const int16_t on[LEVELS])
{
    real total = (real)0;
    int32_t b;

    for (b = 0; b < LEVELS; ++b) {
        if (on[b] > 0) {
            total += columns[begins[b] + (int32_t)on[b] - 1];
        }
    }
    return OFF + SWING * total;
}

void {{ name }}_reset({{ name }}_state *state)
{
    int32_t b;

    for (b = 0; b < LEVELS; ++b) {
        state->on[b] = 0;
    }
    state->level = 0;
    state->y = OFF;
}

{{ name }}_real {{ name }}_step({{ name }}_state *state, {{ name }}_real u)
{
    int32_t level = (int32_t)state->level;
    int32_t b;

    if (isfinite(u)) {
        if ((level < LEVELS) && (u >= levels[level])) {
            while ((level < LEVELS) && (u >= levels[level])) {
                level += 1;
            }
            for (b = 0; b < level; ++b) {
                if ((int32_t)state->on[b] < (level - b)) {
                    state->on[b] = (int16_t)(level - b);
                }
            }
            state->y = output(state->on);
        } else if ((level > 0) && (u < levels[level - 1])) {
            while ((level > 0) && (u < levels[level - 1])) {
                level -= 1;
                state->on[level] = 0;
            }
            state->y = output(state->on);
        } else {
            /* between the same thresholds as before */
        }
        state->level = (int16_t)level;
    }
    return state->y;
}

{{ name }}_real {{ name }}_output(const {{ name }}_state *state)
{
    return state->y;
}
