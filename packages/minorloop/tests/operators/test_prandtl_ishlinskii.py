import numpy as np
from hypothesis import given
from hypothesis import strategies as st

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


def test_residuals_are_small_for_slopes_that_differ_by_five_decades():
    rng = np.random.default_rng(11)
    slopes = 10 ** rng.uniform(-4, 1, 30)
    model = PrandtlIshlinskii(np.linspace(0, 2, 30), np.diff(slopes, prepend=0.0), 3.0)
    targets = model.simulate(rng.uniform(-3, 3, 500), "relaxed")
    assert model.invert(targets[::-1], "relaxed").worst <= 1e-12 * np.ptp(targets)
