import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oracles
from minorloop import ParameterError, Preisach
from minorloop.identification.curves import Curves
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec, pack

LEVELS = np.array([-1.0, -0.6, -0.1, 0.0, 0.4, 1.0])
inputs = st.lists(st.floats(-1.3, 1.3), min_size=3, max_size=30).map(np.array)
KINDS = list(itertools.product(("bipolar", "unipolar"), ("uniform", "reversible")))


def areas_of(u, relay="bipolar", diagonal="uniform", slope=True, start="negative", seed=0):
    spec = PlaneSpec(LEVELS, relay, diagonal, offset=True, slope=slope)
    measured = np.random.default_rng(seed).uniform(size=u.size) > 0.3
    return DesignMatrix(spec, u, measured, start), measured


@pytest.mark.parametrize(("relay", "diagonal"), KINDS)
@given(u=inputs)
def test_columns_are_areas_computed_cell_by_cell(relay, diagonal, u):
    matrix, measured = areas_of(u, relay, diagonal)
    rows = []
    for steps in oracles.strips(u, -1.0, 1.0):
        on = pack(oracles.switched_on(steps, LEVELS, diagonal == "uniform"))
        rows.append(2 * on - 1 if relay == "bipolar" else on)
    expected = np.column_stack([np.array(rows), np.ones(u.size), u])[measured]
    np.testing.assert_allclose(matrix.dense(), expected, atol=1e-12)


@pytest.mark.parametrize("start", ["negative", "positive", "demagnetised"])
@given(u=inputs)
def test_forward_is_what_the_model_simulates(start, u):
    matrix, measured = areas_of(u, start=start)
    x = np.random.default_rng(1).uniform(0, 1, matrix.spec.unknowns)
    model = matrix.spec.model(x)
    np.testing.assert_allclose(matrix.forward(x), model.simulate(u, start)[measured], atol=1e-11)


@given(u=inputs)
def test_adjoint_is_the_transpose(u):
    matrix, _ = areas_of(u)
    rng = np.random.default_rng(2)
    x, r = rng.normal(size=matrix.spec.unknowns), rng.normal(size=matrix.samples)
    assert matrix.forward(x) @ r == pytest.approx(x @ matrix.adjoint(r), abs=1e-11)


def test_normal_equations_too_large_for_the_memory_are_refused():
    spec = PlaneSpec(np.linspace(-1, 1, 252))
    matrix = DesignMatrix(spec, np.array([0.5, -0.5]), np.ones(2, dtype=bool), "negative")
    with pytest.raises(ParameterError, match="of 251 bands need more than 8 GB; give at most 250"):
        matrix.gram()


def test_curves_that_begin_alike_share_the_reversals_of_their_reset():
    rng = np.random.default_rng(0)
    model = Preisach(np.linspace(-1, 1, 6), np.tril(rng.uniform(size=(5, 5))))
    u = rng.uniform(-1, 1, 60)
    curves = Curves(np.arange(0, 60, 6), "demagnetised")
    inputs, places = curves.driven(u, model.levels)
    measured = np.zeros(inputs.size, dtype=bool)
    measured[places] = True
    spec = PlaneSpec(model.levels)
    matrix = DesignMatrix(spec, inputs, measured, "demagnetised")
    found = matrix.forward(spec.unknowns_of(model))
    np.testing.assert_allclose(found, curves.simulate(model, u), atol=1e-12)
    one = len(model.memory("demagnetised").extrema)
    assert matrix.reversals <= one + u.size
    assert matrix.parent.size <= one + u.size
