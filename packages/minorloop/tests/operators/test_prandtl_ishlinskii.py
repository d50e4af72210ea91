import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import NotInvertibleError, ParameterError, SignalError
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

STARTS = ("negative", "positive", "demagnetised", "relaxed")
signals = st.lists(st.floats(-10, 10), min_size=1, max_size=60).map(np.array)


@st.composite
def operators(draw):
    """Invertible operators with weights of both signs."""
    plays = draw(st.integers(1, 8))
    gaps = draw(st.lists(st.floats(0.05, 2), min_size=plays - 1, max_size=plays - 1))
    slopes = draw(st.lists(st.floats(0.05, 5), min_size=plays, max_size=plays))
    weights = np.diff(slopes, prepend=0.0)
    return PrandtlIshlinskii(np.cumsum([0.0, *gaps]), weights, draw(st.floats(-5, 5)))


@st.composite
def started(draw):
    """An operator with a start: a name, or the state after some past."""
    model = draw(operators())
    past = draw(st.one_of(st.sampled_from(STARTS), signals))
    return model, past if isinstance(past, str) else model.trace(past, "relaxed")[-1]


def one_play(u, radius, position):
    """Backlash step by step: a piston in a sleeve of half-width ``radius``, pushed by its ends."""
    positions = []
    for sample in u:
        if sample - position > radius:
            position = sample - radius
        elif position - sample > radius:
            position = sample + radius
        positions.append(position)
    return np.array(positions)


def test_equals_the_sum_of_single_plays():
    rng = np.random.default_rng(1)
    radii, weights = np.array([0.0, 0.3, 1.1]), np.array([0.5, 2.0, -0.7])
    start = np.array([0.2, 0.1, -0.4])
    u = rng.normal(size=300)
    expected = 3.0 + sum(
        weight * one_play(u, radius, position)
        for radius, weight, position in zip(radii, weights, start, strict=True)
    )
    model = PrandtlIshlinskii(radii, weights, 3.0)
    np.testing.assert_allclose(model.simulate(u, start), expected, atol=1e-14)


@given(started(), signals)
def test_weighted_positions_add_up_to_the_output(case, u):
    model, start = case
    expected = model.offset + model.trace(u, start) @ model.weights
    np.testing.assert_allclose(model.simulate(u, start), expected, atol=1e-11)


@given(operators(), signals, st.floats(10, 20))
def test_a_larger_input_wipes_out_the_past(model, u, peak):
    swing = np.array([peak + model.radii[-1] * 2, -peak - model.radii[-1] * 2, 1.0])
    with_past = model.simulate(np.concatenate([u, swing]), "relaxed")[-3:]
    np.testing.assert_array_equal(with_past[1:], model.simulate(swing, "relaxed")[1:])


@given(operators(), signals, signals, st.floats(-3, 3), st.floats(0.1, 4))
def test_loops_between_equal_inputs_are_congruent(model, past, other, low, height):
    loop = np.concatenate([[low, low + height, low], low + height * np.linspace(0, 1, 7)])
    one = model.simulate(np.concatenate([past, loop]), "relaxed")[-8:]
    two = model.simulate(np.concatenate([other, loop]), "relaxed")[-8:]
    np.testing.assert_allclose(one - one[0], two - two[0], atol=1e-10)


@given(started(), signals)
def test_outputs_of_the_inverted_inputs_are_the_targets(case, targets):
    model, start = case
    result = model.invert(targets, start)
    scale = max(np.ptp(targets), np.abs(targets - model.offset).max(), 1.0)
    assert result.worst <= 1e-12 * scale
    np.testing.assert_array_equal(result.y, model.simulate(result.u, start))
    assert result.reachable.all()


@given(started(), signals)
def test_the_inverse_consists_of_weighted_plays(case, targets):
    model, start = case
    inverse, carried = model.inverse(), model.inverse_positions(start)
    u = inverse.simulate(targets, carried)
    np.testing.assert_allclose(u, model.invert(targets, start).u, atol=1e-8)
    np.testing.assert_allclose(inverse.inverse().radii, model.radii, rtol=1e-9)
    np.testing.assert_allclose(inverse.inverse().weights, model.weights, atol=1e-9)
    assert inverse.inverse().offset == pytest.approx(model.offset, abs=1e-9)
    np.testing.assert_allclose(
        inverse.inverse_positions(carried), model.positions(start), atol=1e-8
    )


def test_inverse_weights_and_radii_in_closed_form():
    model = PrandtlIshlinskii([0.0, 1.0, 3.0], [2.0, 3.0, -1.0])
    inverse = model.inverse()
    np.testing.assert_allclose(inverse.radii, [0.0, 2 * 1, 2 * 3 + 3 * 2])
    np.testing.assert_allclose(inverse.weights, [1 / 2, -3 / (5 * 2), 1 / (4 * 5)])
    start = np.array([0.5, 0.25, -1.0])
    expected = [2 * 0.5 + 3 * 0.25 + 1, 0.25 * 5 - 1 * -1.0, -1.0 * 4]
    np.testing.assert_allclose(model.inverse_positions(start), expected)


@pytest.mark.parametrize(
    ("radii", "weights", "what"),
    [
        ([0.5, 1.0], [1.0, 1.0], "smallest radius is 0.5"),
        ([0.0, 1.0], [0.0, 1.0], "weights up to index 0 add up to 0"),
        ([0.0, 1.0], [1.0, -1.5], "weights up to index 1 add up to -0.5"),
    ],
)
def test_refuses_to_invert_operators_without_an_inverse(radii, weights, what):
    model = PrandtlIshlinskii(radii, weights)
    assert not model.invertible
    for attempt in (
        lambda: model.invert([0.0]),
        model.inverse,
        lambda: model.inverse_positions("relaxed"),
        lambda: model.aim("relaxed", 0.0),
    ):
        with pytest.raises(NotInvertibleError, match=what):
            attempt()


@pytest.mark.parametrize(
    ("radii", "weights", "offset", "what"),
    [
        ([], [], 0.0, "at least one"),
        ([0.0, 1.0], [1.0], 0.0, "as many weights"),
        ([-0.1, 1.0], [1.0, 1.0], 0.0, "zero or more"),
        ([0.0, 1.0, 1.0], [1.0, 1.0, 1.0], 0.0, "not strictly increasing: 1 at index 1"),
        ([0.0, np.inf], [1.0, 1.0], 0.0, r"radii\[1\] is inf"),
        ([0.0], [1.0], np.nan, "offset is nan"),
        (["a"], [1.0], 0.0, "not numbers"),
    ],
)
def test_refuses_bad_parameters(radii, weights, offset, what):
    with pytest.raises(ParameterError, match=what):
        PrandtlIshlinskii(radii, weights, offset)


@pytest.mark.parametrize(
    ("start", "what"),
    [
        ("up", "'negative', 'positive', 'demagnetised', 'relaxed'"),
        ([0.0], "give 2 play positions"),
        ([0.0, np.nan], "must be finite"),
        ([0.0, 1.5], "no input leads to such positions"),
        ([None, "x"], "not an array of numbers"),
    ],
)
def test_refuses_impossible_start_positions(start, what):
    with pytest.raises(ParameterError, match=what):
        PrandtlIshlinskii([0.0, 1.0], [1.0, 1.0]).simulate([0.0], start)


def test_refuses_bad_signals():
    model = PrandtlIshlinskii([0.0, 1.0], [1.0, 1.0])
    with pytest.raises(SignalError, match="index 1"):
        model.simulate([0.0, np.nan])
    with pytest.raises(SignalError, match="one sequence"):
        model.invert([[0.0, 1.0]])
    with pytest.raises(ParameterError, match="unreachable"):
        model.invert([0.0], unreachable="ignore")
    with pytest.raises(ParameterError, match="finite"):
        model.step("relaxed", np.inf)


def record(model, *, seed=3, samples=400):
    u = np.random.default_rng(seed).uniform(-2, 2, samples)
    return u, model.simulate(u, "relaxed")


@pytest.mark.parametrize(
    ("weights", "signed"), [([0.4, 0.0, 1.2, 0.3], False), ([2.0, -0.5, 0.7, -1.0], True)]
)
def test_fit_finds_the_operator_that_made_the_record(weights, signed):
    truth = PrandtlIshlinskii([0.0, 0.25, 0.7, 1.5], weights, 4.0)
    u, y = record(truth)
    y[::7] = np.nan
    model = PrandtlIshlinskii.fit(u, y, radii=truth.radii, start="relaxed", signed=signed)
    np.testing.assert_allclose(model.weights, truth.weights, atol=1e-9)
    assert model.offset == pytest.approx(4.0)


def test_residuals_are_small_for_slopes_that_differ_by_five_decades():
    rng = np.random.default_rng(11)
    slopes = 10 ** rng.uniform(-4, 1, 30)
    model = PrandtlIshlinskii(np.linspace(0, 2, 30), np.diff(slopes, prepend=0.0), 3.0)
    targets = model.simulate(rng.uniform(-3, 3, 500), "relaxed")
    assert model.invert(targets[::-1], "relaxed").worst <= 1e-12 * np.ptp(targets)


@pytest.mark.parametrize("signed", [False, True])
def test_a_fit_can_always_be_inverted(signed):
    u = np.sin(np.linspace(0, 12, 300))
    clockwise = -np.random.default_rng(4).normal(size=300)
    model = PrandtlIshlinskii.fit(u, clockwise, radii=6, signed=signed)
    assert model.invertible
    assert model.radii.size == 6
    assert signed or (model.weights >= 0).all()
    assert model.invert(clockwise).worst <= 1e-12 * np.ptp(clockwise)


@pytest.mark.parametrize(
    ("u", "y", "options", "error", "what"),
    [
        (np.zeros(50), np.zeros(50), {}, SignalError, "constant"),
        (np.arange(5.0), np.arange(5.0), {}, SignalError, "5 measured samples for 13 unknowns"),
        (np.arange(5.0), np.arange(4.0), {}, SignalError, "give \\(T,\\) samples of each"),
        (np.arange(50.0), np.full(50, np.nan), {}, SignalError, "no measured sample"),
        (np.arange(50.0), np.arange(50.0), {"radii": 0}, ParameterError, "whole number >= 1"),
        (np.arange(50.0), np.arange(50.0), {"radii": [1.0]}, ParameterError, "begin with 0"),
        (np.arange(50.0), np.arange(50.0), {"radii": ["a"]}, ParameterError, "not an array"),
        (np.arange(50.0), np.arange(50.0), {"radii": []}, ParameterError, "at least one"),
    ],
)
def test_fit_refuses_unusable_records_and_options(u, y, options, error, what):
    with pytest.raises(error, match=what):
        PrandtlIshlinskii.fit(u, y, **options)
