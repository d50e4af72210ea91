import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from minorloop import ParameterError, Preisach, RelayModel, excitation

LEVELS = np.linspace(0.2, 0.8, 7)
picks = st.lists(st.integers(0, 6), min_size=1, max_size=60)
anywhere = st.lists(st.floats(0, 1), min_size=1, max_size=60)


def a_plane(relay="bipolar", bands=6):
    weights = np.tril(np.random.default_rng(0).uniform(size=(bands, bands)))
    return Preisach(np.linspace(0.2, 0.8, bands + 1), weights, 0.5, relay)


def one_by_one(model, u):
    """Every relay on its own: on from alpha, off below beta, otherwise unchanged."""
    n = len(model.levels)
    state = {(a, b): 0 for a in range(n) for b in range(a + 1)}
    y = []
    for value in u:
        for a, b in state:
            if value >= model.levels[a]:
                state[a, b] = 1
            elif value < model.levels[b]:
                state[a, b] = 0
        signs = {k: v if model.relay == "unipolar" else 2 * v - 1 for k, v in state.items()}
        y.append(model.offset + sum(model.weights[k] * s for k, s in signs.items()))
    return y


@pytest.mark.parametrize("relay", ["bipolar", "unipolar"])
@given(picks)
def test_equals_the_preisach_operator_for_inputs_on_levels(relay, steps):
    plane, u = a_plane(relay), LEVELS[steps]
    dots = RelayModel.from_preisach(plane)
    np.testing.assert_allclose(
        dots.simulate(u), plane.simulate(u), atol=1e-12 * np.ptp(plane.range), rtol=0
    )


@pytest.mark.parametrize("relay", ["bipolar", "unipolar"])
@given(anywhere)
def test_rows_and_columns_switch_as_single_relays_do(relay, u):
    weights = np.tril(np.random.default_rng(1).uniform(-1, 1, (7, 7)))
    model = RelayModel(LEVELS, weights, 0.1, relay)
    np.testing.assert_allclose(model.simulate(u), one_by_one(model, u), atol=1e-12)


def test_reproduces_the_diagram_of_the_fibre_paper():
    """After u4, u6, u2, u4 the two left columns and those that the last rise reached are on."""
    u = LEVELS[[3, 5, 1, 3]]  # u1 is the lowest of the paper's levels
    on = RelayModel(LEVELS, np.zeros((7, 7))).states(u)
    alpha, beta = np.meshgrid(np.arange(1, 8), np.arange(1, 8), indexing="ij")
    expected = (beta <= alpha) & ((alpha <= 4) | ((beta <= 2) & (alpha <= 6)))
    np.testing.assert_array_equal(on.astype(bool), expected)


def test_stepping_ends_at_the_last_level_and_marks_targets_unreachable():
    dots = RelayModel.from_preisach(a_plane())
    found = dots.stepping_inverse([1e3, -1e3])
    assert found.u.tolist() == [LEVELS[-1], LEVELS[0]]
    assert not found.reachable.any()


@given(st.integers(0, 1000))
def test_reversal_curves_have_as_many_steps_as_relays_and_determine_them(seed):
    rng, low = np.random.default_rng(seed), np.tril_indices(LEVELS.size)
    model = RelayModel(LEVELS, np.tril(rng.normal(size=(7, 7))), relay="unipolar")
    u = excitation.reversal_curves(LEVELS)
    assert u.size == low[0].size
    found = RelayModel.fit(u, one_by_one(model, u), LEVELS, signed=True)
    expected = model.weights.copy()
    expected[0, 0] = 0.0  # always on: the offset
    np.testing.assert_allclose(found.weights, expected, atol=1e-10)
    assert found.offset == pytest.approx(model.weights[0, 0], abs=1e-10)


@given(st.integers(0, 1000))
def test_constrained_relays_have_the_least_error_of_any_that_are_not_negative(seed):
    rng, low = np.random.default_rng(seed), np.tril_indices(LEVELS.size)
    u = rng.uniform(0.2, 0.9, 40)
    y = np.where(rng.uniform(size=40) < 0.2, np.nan, rng.normal(size=40) + 3 * u)
    single = [np.tril(np.arange(49).reshape(7, 7) == 7 * a + b) for a, b in zip(*low, strict=True)]
    columns = [one_by_one(RelayModel(LEVELS, 1.0 * one, relay="unipolar"), u) for one in single]
    matrix, known = np.column_stack([np.ones(40), *columns]), ~np.isnan(y)
    least = np.concatenate([[-np.inf], np.zeros(len(single))])
    best = lsq_linear(matrix[known], y[known], (least, np.inf), method="bvls")
    found = RelayModel.fit(u, y, LEVELS)
    assert found.weights.min() >= 0
    off = (found.simulate(u) - y)[known]
    assert off @ off == pytest.approx(2 * best.cost, rel=1e-9)


def test_refuses_to_fit_inputs_below_the_lowest_level():
    with pytest.raises(ParameterError, match=r"u reaches 0\.1, below the lowest level"):
        RelayModel.fit([0.1, 0.5], [0.0, 1.0], LEVELS)
