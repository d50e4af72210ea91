import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

import oracles
from minorloop.errors import NotInvertibleError, ParameterError, SignalError, UnreachableError
from minorloop.operators import _kernels
from minorloop.operators.memory import Memory
from minorloop.operators.plane import cell_areas
from minorloop.operators.preisach import Preisach

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
    np.testing.assert_allclose(
        model.simulate(u), oracles.outputs(model, u), atol=1e-12 * span(model), rtol=0
    )


@given(u=inputs)
def test_starts_at_positive_saturation(u):
    model = a_model(3)
    np.testing.assert_allclose(
        model.simulate(u, "positive"),
        oracles.outputs(model, u, past=(1.0,)),
        atol=1e-12 * span(model),
        rtol=0,
    )


def test_starts_demagnetised():
    model = a_model(3, LEVELS[::2])
    past = model.memory("demagnetised").extrema
    u = np.random.default_rng(0).uniform(-1.2, 1.2, 5)
    np.testing.assert_allclose(
        model.simulate(u, "demagnetised"),
        oracles.outputs(model, u, past),
        atol=1e-12 * span(model),
        rtol=0,
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


def test_unreachable_targets_are_refused_or_approached():
    model = a_model()
    low, high = model.range
    with pytest.raises(UnreachableError, match=r'index 1 is beyond .* pass unreachable="clip"'):
        model.invert([low, high + 0.1])
    clipped = model.invert([low - 1, high + 1, (low + high) / 2], unreachable="clip")
    assert clipped.reachable.tolist() == [False, False, True]
    np.testing.assert_allclose(clipped.y[:2], [low, high], atol=1e-12)
    beyond = high + 0.5e-12 * (high - low)
    assert model.invert([beyond]).reachable.all()


@pytest.mark.parametrize("far", [1e30, 1e300, 1.7e308])
@pytest.mark.parametrize("slope", [0.0, 0.7])
def test_for_distant_targets_the_end_of_the_grid_is_nearest(far, slope):
    model = a_model(slope=slope)
    clipped = model.invert([far, -far, far, 0.5 * sum(model.range)], unreachable="clip")
    np.testing.assert_array_equal(clipped.u[:3], [1, -1, 1])
    assert clipped.reachable.tolist() == [False, False, False, True]
    assert model.track().aim(far, unreachable="clip") == pytest.approx(1)
    with pytest.raises(UnreachableError, match="beyond what the model can reach"):
        model.track().aim(far)


def test_negative_weights_are_not_inverted_unless_monotone():
    weights = np.tril(np.random.default_rng(0).uniform(-1, 1, (6, 6)))
    with pytest.raises(NotInvertibleError, match="signed=False"):
        Preisach(LEVELS, weights).invert([0.0])
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


@given(inside, inside)
def test_wiping_out(past, more):
    model = a_model(1)
    past = np.clip(past, -0.5, 0.5)
    forgotten = model.simulate(np.concatenate([past, [0.8, -0.7], more]))
    never_known = model.simulate(np.concatenate([[0.8, -0.7], more]))
    np.testing.assert_allclose(
        forgotten[past.size :], never_known, atol=1e-12 * span(model), rtol=0
    )


@given(inside, inside)
def test_congruency(one, other):
    model = a_model(2)
    loop = np.concatenate([np.linspace(-0.3, 0.4, 9), np.linspace(0.4, -0.3, 9)])
    lead = np.array([0.4, -0.3, 0.4, -0.3])
    shapes = []
    for past in (one, other):
        y = model.simulate(np.concatenate([past, lead, loop]))[past.size + lead.size :]
        shapes.append(y - y[0])
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-12 * span(model), rtol=0)


@given(inside)
def test_never_falls_while_the_input_rises(u):
    model = a_model(6)
    steps = np.diff(model.simulate(u)) * np.sign(np.diff(u))
    assert (steps >= -1e-12 * span(model)).all()


@given(inputs)
def test_step_track_and_simulate_are_equal_to_the_bit(u):
    model, memory, stepped = a_model(8), Memory.negative(-1.0), []
    tracker = model.track()
    for value in u:
        y, memory = model.step(memory, value)
        stepped.append(y)
    np.testing.assert_array_equal(stepped, model.simulate(u))
    np.testing.assert_array_equal([tracker.push(value) for value in u], stepped)
    assert tracker.memory == memory == Memory.after(u, low=-1.0, high=1.0)


def test_simulations_in_threads_are_independent():
    model = a_model(10)
    u = np.random.default_rng(0).uniform(-1.2, 1.2, (32, 2000))
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(model.simulate, u))
    np.testing.assert_array_equal(together, [model.simulate(row) for row in u])


@pytest.mark.parametrize(("relay", "diagonal"), KINDS)
def test_the_model_is_recovered_from_its_reversal_values(relay, diagonal):
    model = a_model(11, relay=relay, diagonal=diagonal, slope=0.2)
    n = LEVELS.size
    f = np.full((n, n), np.nan)
    for a in range(n):
        for b in range(a + 1):
            f[a, b] = model.simulate([LEVELS[a], LEVELS[b]])[-1]
    back = Preisach.from_reversal_values(LEVELS, f, relay=relay, diagonal=diagonal, slope=0.2)
    np.testing.assert_allclose(back.weights, model.weights, atol=1e-13)
    assert back.offset == pytest.approx(model.offset, abs=1e-12)


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


def test_a_density_by_cell_is_multiplied_by_the_area():
    density = np.tril(np.random.default_rng(0).uniform(size=(6, 6)))
    model = Preisach.from_density(LEVELS, density, offset=1.0)
    np.testing.assert_allclose(model.weights, density * cell_areas(LEVELS))
    assert model.offset == 1.0


def test_everett_is_half_the_change_along_a_new_branch():
    model = a_model(12)
    tracker = model.track("positive")
    before = tracker.push(-0.4)
    assert model.everett(0.3, -0.4) == pytest.approx((tracker.push(0.3) - before) / 2)
    with pytest.raises(ParameterError, match="alpha >= beta"):
        model.everett(0.0, 0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weights": np.zeros((5, 5))}, r"shape \(5, 5\)"),
        ({"weights": np.ones((6, 6))}, "above the diagonal"),
        ({"weights": np.full((6, 6), np.nan)}, "must be finite"),
        ({"levels": LEVELS[::-1]}, "not strictly increasing"),
        ({"levels": [0.0]}, "give L"),
        ({"levels": [0.0, np.inf, 1, 2, 3, 4, 5]}, "must be finite"),
        ({"relay": "tripolar"}, "'bipolar', 'unipolar'"),
        ({"diagonal": "bent"}, "'uniform', 'reversible'"),
        ({"offset": np.nan}, "finite"),
        ({"slope": "steep"}, "finite"),
        ({"levels": [0, 1e-300, 1, 2, 3, 4, 5]}, "scale the input up"),
        ({"weights": np.tril(np.full((6, 6), 1e300))}, "give them in a larger unit"),
    ],
)
def test_refuses_wrong_parameters(options, message):
    with pytest.raises(ParameterError, match=message):
        Preisach(**{"levels": LEVELS, "weights": np.zeros((6, 6)), **options})


@pytest.mark.parametrize("u", [[np.nan], [np.inf], ["a"], [[[1.0]]], 3.0])
def test_refuses_wrong_signals(u):
    with pytest.raises(SignalError):
        a_model().simulate(u)


def test_refuses_unknown_words():
    with pytest.raises(ParameterError, match="start"):
        a_model().simulate([0.0], start="cold")
    with pytest.raises(ParameterError, match="unreachable"):
        a_model().invert([0.0], unreachable="ignore")


def test_is_frozen_and_comparable():
    model = a_model()
    assert model == a_model()
    assert model != a_model(1)
    with pytest.raises(ValueError, match="read-only"):
        model.weights[0, 0] = 1.0
    with pytest.raises(AttributeError):
        model.offset = 1.0
