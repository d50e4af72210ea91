import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

import oracles
from minorloop import Preisach
from minorloop.operators import _kernels

LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.05, 0.6, 1.0])
STARTS = ("negative", "positive", "demagnetised")
KINDS = list(itertools.product(("bipolar", "unipolar"), ("uniform", "reversible")))
inputs = st.lists(
    st.one_of(st.floats(-1.3, 1.3), st.sampled_from(LEVELS.tolist())), min_size=1, max_size=40
).map(np.array)


def a_model(seed=0, levels=LEVELS, relay="bipolar", diagonal="uniform", slope=0.0, sparse=0.3):
    rng = np.random.default_rng(seed)
    bands = len(levels) - 1
    weights = rng.uniform(0, 1, (bands, bands)) * (rng.uniform(size=(bands, bands)) > sparse)
    return Preisach(levels, np.tril(weights), rng.normal(), relay, diagonal, slope)


def span(model):
    return np.ptp(model.range) or 1.0


@pytest.mark.parametrize(("relay", "diagonal"), KINDS)
@given(u=inputs, seed=st.integers(0, 50), slope=st.sampled_from([0.0, 0.7]))
def test_equals_the_sum_of_areas_cell_by_cell(relay, diagonal, u, seed, slope):
    model = a_model(seed, relay=relay, diagonal=diagonal, slope=slope)
    for start, past in (("negative", ()), ("positive", (1.0,))):
        wanted = oracles.outputs(model, u, past)
        np.testing.assert_allclose(
            model.simulate(u, start), wanted, atol=1e-12 * span(model), rtol=0
        )


@given(
    exponent=st.integers(-300, 296),
    seed=st.integers(0, 50),
    bands=st.sampled_from([1, 2, 6, 30]),
    kind=st.sampled_from(KINDS),
    slope=st.sampled_from([0.0, 0.7]),
    start=st.sampled_from(STARTS),
    targets=st.lists(st.floats(0, 1), min_size=1, max_size=40).map(np.array),
)
def test_forward_and_inverse_are_exact_at_every_scale(
    exponent, seed, bands, kind, slope, start, targets
):
    levels = np.sort(np.random.default_rng(seed).uniform(-2, 3, bands + 1))
    usual, size = a_model(seed, levels, *kind, slope, sparse=0.5 * (bands > 2)), 10.0**exponent
    model = Preisach(levels, usual.weights * size, usual.offset * size, *kind, slope * size)
    low, high = usual.range
    targets = low + targets * (high - low)
    found = model.invert(np.clip(targets * size, *model.range), start)
    assert found.reachable.all()
    assert levels[0] <= found.u.min() <= found.u.max() <= levels[-1]
    past = {"negative": (), "positive": (levels[-1],)}
    expected = [model.simulate(found.u, start), found.y]
    if start in past:
        expected.append(oracles.outputs(model, found.u, past[start]))
    for outputs in expected:
        np.testing.assert_allclose(outputs / size, targets, atol=1e-12 * span(usual), rtol=0)


def test_kernels_refuse_what_is_not_a_number():
    model = a_model()
    stack, rows = model.stack("negative", 4)
    u, y = np.array([0.3, np.nan, 0.3]), np.empty(3)
    assert _kernels.simulate(model.tables, stack, rows, u, y) == 2
    assert y[0] == y[2]
    assert np.isnan(y[1])
    assert np.isnan(_kernels.aim(model.tables, stack, 2, np.nan))
    assert _kernels.invert(model.tables, stack, 2, u[1:2], u[:1], y[:1]) == 2
    assert np.isnan(u[0])
    _kernels.everett(model.tables, np.full(1, np.nan), np.zeros(1), y[2:])
    assert np.isnan(y[2])


def test_the_inverse_takes_the_nearest_input():
    """It is the nearer end of a flat branch, and it does not change for the present output."""
    weights = np.zeros((4, 4))
    weights[0, 0] = weights[3, 3] = 1.0
    model = Preisach([0, 1, 2, 3, 4], weights)
    top_of_first, bottom = model.simulate([1.0, 0.0])
    found = model.invert([top_of_first, top_of_first, bottom])
    np.testing.assert_allclose(found.u, [1.0, 1.0, 0.0])
    moved = model.track()
    moved.push(2.5)
    assert moved.aim(moved.push(2.5)) == 2.5


@given(st.integers(0, 200), st.sampled_from(["uniform", "reversible"]), st.floats(0, 4))
def test_monotone_means_that_no_branch_falls(seed, diagonal, slope):
    rng = np.random.default_rng(seed)
    levels = np.sort(rng.uniform(-1, 1, 4))
    model = Preisach(levels, np.tril(rng.uniform(-0.5, 1, (3, 3))), diagonal=diagonal, slope=slope)
    fine = np.unique(np.concatenate([np.linspace(levels[0], levels[-1], 60), levels]))
    least = np.inf
    for turn in fine[::4]:
        up, tracker = [], model.track()
        for value in (levels[-1], turn):
            tracker.push(value)
        up = [tracker.peek(value) for value in fine[fine >= turn]]
        down_from = model.track()
        down_from.push(turn)
        down = [down_from.peek(value) for value in fine[fine <= turn]]
        for branch in (up, down):
            least = min(least, np.min(np.diff(branch), initial=np.inf))
    if model.monotone:
        assert least >= -1e-9
    if least < -1e-9:
        assert not model.monotone


@given(seed=st.integers(0, 100), relay=st.sampled_from(["bipolar", "unipolar"]))
def test_range_of_a_signed_model_is_that_of_all_its_memories(seed, relay):
    rng = np.random.default_rng(seed)
    levels = np.arange(5.0)
    weights = np.tril(rng.uniform(-1, 1, (4, 4)))
    model = Preisach(levels, weights, 0.3, relay, slope=float(rng.uniform(-1, 1)))
    paths = np.array([*itertools.product(levels, repeat=5)])  # shorter ones are their beginnings
    # Each begins at the lowest level, which is saturation.
    everything = model.simulate(np.insert(paths, 0, levels[0], axis=1).ravel())
    np.testing.assert_allclose(model.range, (everything.min(), everything.max()), atol=1e-12)


def test_densities_are_integrated_over_each_cell():
    model = Preisach.from_density(LEVELS, lambda alpha, beta: np.exp(alpha - 2 * beta))
    expected, _ = integrate.dblquad(
        lambda beta, alpha: np.exp(alpha - 2 * beta), 0.05, 0.6, -0.75, -0.2
    )
    assert model.weights[4, 1] == pytest.approx(expected, rel=1e-12)
    corner, _ = integrate.dblquad(
        lambda beta, alpha: np.exp(alpha - 2 * beta), 0.05, 0.6, 0.05, lambda alpha: alpha
    )
    assert model.weights[4, 4] == pytest.approx(corner, rel=1e-12)
