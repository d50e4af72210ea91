import ctypes

import numpy as np
import pytest

from compiled import SANITIZED, Compiled, self_test
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export.c99 import source
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.preisach import Preisach

LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.05, 0.6, 1.0])
INTERVAL = 0.1
HARNESS = """
#include "minorloop.h"
void walk(const minorloop_real *u, minorloop_real *y, minorloop_real *bound, long count);
{chase_prototype}
void walk(const minorloop_real *u, minorloop_real *y, minorloop_real *bound, long count)
{{
    minorloop_state state;
    long k;
    minorloop_reset(&state);
    for (k = 0; k < count; ++k) {{
        y[k] = minorloop_step(&state, u[k]);
        bound[k] = minorloop_output(&state);
    }}
}}
{chase}
"""


def a_model(diagonal="reversible", field=0.03, creeps=True):
    weights = np.tril(np.random.default_rng(1000).uniform(0.1, 1, (6, 6)))
    plane = Preisach(LEVELS, weights, 0.4, "bipolar", diagonal, 0.2)
    later = 0.4 if field else -0.4  # with a field, creep that takes back is not monotone
    options = {"times": [0.3, 4.0], "creep": [0.3 * weights, later * weights]} if creeps else {}
    return AfterEffect(plane, field, 3.0 if field else 0.0, **options)


MODELS = {
    "both": a_model(),
    "uniform": a_model("uniform"),
    "field": a_model(creeps=False),
    "creep": a_model(field=0.0),
    "none": a_model(field=0.0, creeps=False),
}


def a_walk(seed, size):
    u = np.random.default_rng(seed).uniform(-0.9, 0.9, size)
    return INTERVAL * np.arange(size), np.repeat(u[: -(-size // 3)], 3)[:size]


@pytest.mark.parametrize("kind", MODELS)
def test_c_gives_what_python_gives(kind, tmp_path):
    model = MODELS[kind]
    compiled = Compiled(source(model, interval=INTERVAL), tmp_path, HARNESS)
    t, u = a_walk(1, 400)
    y = model.simulate(t, u)
    np.testing.assert_allclose(compiled.walk(u)[0], y, rtol=0, atol=1e-11)
    inputs, outputs = compiled.chase(y)
    np.testing.assert_allclose(outputs, y, rtol=0, atol=1e-10 * np.ptp(model.range))
    np.testing.assert_allclose(model.simulate(t, inputs), y, rtol=0, atol=1e-9)


@pytest.mark.parametrize("float32", [False, True])
def test_the_self_test_passes_under_sanitizers(float32, tmp_path):
    code = source(a_model(), interval=INTERVAL, float32=float32)
    assert "worst error" in self_test(code, tmp_path, *SANITIZED)


def test_a_full_memory_drops_what_matters_least(tmp_path):
    model = a_model()
    code = source(model, interval=1e3, memory=8)
    compiled = Compiled(code, tmp_path, HARNESS)
    shrink = np.linspace(1, 0.05, 40) * np.where(np.arange(40) % 2, -1, 1)
    off = compiled.walk(shrink)[0] - model.simulate(1e3 * np.arange(40), shrink)
    assert 0 < np.abs(off).max() <= 15 * code.drop_error


def test_an_input_that_is_not_finite_counts_as_the_one_before(tmp_path):
    compiled = Compiled(source(a_model(), interval=INTERVAL), tmp_path, HARNESS)
    held, lost = compiled.walk([0.5, 0.5, 0.5])[0], compiled.walk([0.5, np.nan, np.inf])[0]
    np.testing.assert_array_equal(held, lost)
    assert isinstance(compiled.library, ctypes.CDLL)


def test_what_c_cannot_hold_is_refused():
    model = a_model()
    with pytest.raises(ParameterError, match="give the seconds between samples"):
        source(model)
    falling = AfterEffect(model.plane, times=[1.0], creep=[-2 * model.plane.weights])
    with pytest.raises(NotInvertibleError, match="export it without"):
        source(falling, interval=INTERVAL)
    assert "_aim" not in source(falling, interval=INTERVAL, inverse=False).files["minorloop.h"]
