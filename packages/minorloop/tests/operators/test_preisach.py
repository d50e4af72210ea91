import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

import oracles
from minorloop import Memory, Preisach
from minorloop.operators import _kernels

LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.05, 0.6, 1.0])
STARTS = ("negative", "positive", "demagnetised")
KINDS = list(itertools.product(("bipolar", "unipolar"), ("uniform", "reversible")))
inputs = st.lists(
    st.one_of(st.floats(-1.3, 1.3), st.sampled_from(LEVELS.tolist())), min_size=1, max_size=40
).map(np.array)
inside = st.lists(st.floats(-1, 1), min_size=1, max_size=40).map(np.array)


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


@pytest.mark.parametrize("bands", [1, 2, 30])
@pytest.mark.parametrize(("relay", "diagonal"), KINDS)
@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_the_inverse_is_exact(bands, relay, diagonal, slope):
    rng = np.random.default_rng(bands)
    levels = np.sort(rng.uniform(-2, 3, bands + 1))
    model = a_model(5, levels, relay, diagonal, slope, sparse=0.5 if bands > 1 else 0.0)
    targets = rng.uniform(*model.range, 10_000)
    for start in STARTS:
        found = model.invert(targets, start)
        assert found.reachable.all()
        assert levels[0] <= found.u.min()
        assert found.u.max() <= levels[-1]
        achieved = model.simulate(found.u, start)
        np.testing.assert_allclose(achieved, targets, atol=1e-12 * span(model), rtol=0)
        np.testing.assert_allclose(found.y, achieved, atol=1e-13 * span(model), rtol=0)


@given(
    exponent=st.integers(-300, 298),
    seed=st.integers(0, 50),
    kind=st.sampled_from(KINDS),
    slope=st.sampled_from([0.0, 0.7]),
    u=inside,
)
def test_forward_and_inverse_are_exact_at_every_scale(exponent, seed, kind, slope, u):
    usual, size = a_model(seed, LEVELS, *kind, slope, sparse=0.0), 10.0**exponent
    model = Preisach(LEVELS, usual.weights * size, usual.offset * size, *kind, slope * size)
    targets = usual.simulate(u) * size
    found = model.invert(np.clip(targets, *model.range))
    assert found.reachable.all()
    for outputs in (model.simulate(u), found.y, oracles.outputs(model, found.u)):
        np.testing.assert_allclose(outputs / size, targets / size, atol=1e-12 * span(usual), rtol=0)


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


def test_negative_weights_are_inverted_if_a_slope_makes_the_model_monotone():
    weights = np.tril(np.random.default_rng(0).uniform(-1, 1, (6, 6)))
    lifted = Preisach(LEVELS, weights, slope=500.0)
    assert lifted.monotone
    targets = np.random.default_rng(1).uniform(*lifted.range, 500)
    assert lifted.invert(targets).worst <= 1e-12 * span(lifted)


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


def test_everett_is_half_the_change_along_a_new_branch():
    model = a_model(12)
    tracker = model.track("positive")
    before = tracker.push(-0.4)
    assert model.everett(0.3, -0.4) == pytest.approx((tracker.push(0.3) - before) / 2)


def test_aim_equals_the_inverse_and_the_memory_has_no_bound():
    model = a_model(9)
    targets = np.random.default_rng(2).uniform(*model.range, 200)
    tracker, aimed = model.track(), []
    for target in targets:
        aimed.append(tracker.aim(target))
        tracker.push(aimed[-1])
    np.testing.assert_array_equal(aimed, model.invert(targets).u)
    swing = np.linspace(1, 0, 2000) * np.where(np.arange(2000) % 2, -1, 1)
    tracker = model.track()
    followed = [tracker.push(value) for value in swing]
    np.testing.assert_array_equal(followed, model.simulate(swing))
    assert len(tracker.memory) > 1900
    assert tracker.memory == Memory.after(swing, low=-1.0, high=1.0)
