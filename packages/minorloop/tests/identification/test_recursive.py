import numpy as np
import pytest

from minorloop import Preisach, excitation
from minorloop.identification.recursive import Recursive

LEVELS = np.linspace(-1.2, 1.2, 11)
NOISE = 0.006


def a_model(seed=0):
    grid = np.linspace(0, 1, 10)
    shape = np.exp(-4 * (grid[:, None] - grid[None, :]))
    return Preisach(
        LEVELS, np.tril(shape * np.random.default_rng(seed).uniform(0.5, 1.5, (10, 10)))
    )


def followed(model, u, drift=0.0, **options):
    """Recursion over a sequence; its state, and one-step-ahead errors over full scale."""
    recursion = Recursive(model.levels, **options)
    state, noise = recursion.begin(), np.random.default_rng(1)
    scale, errors = np.ptp(model.range), []
    for k, value in enumerate(u):
        gain = 1 + drift * np.sin(2 * np.pi * k / 1500) * (np.arange(10)[:, None] / 10)
        truth = Preisach(model.levels, model.weights * gain).step(state.memory, value)[0]
        errors.append((recursion.model(state).step(state.memory, value)[0] - truth) / scale)
        state = recursion.update(state, value, truth + noise.normal(0, NOISE * scale))
    return recursion, state, np.array(errors)


@pytest.mark.parametrize("inputs", ["staircase", "random"])
def test_follows_a_fixed_plane_within_half_a_percent(inputs):
    u = np.tile(excitation.decaying_staircase(LEVELS), 20)[:1000]
    if inputs == "random":
        u = np.random.default_rng(2).uniform(-1.2, 1.2, 1000)
    _, state, errors = followed(a_model(), u)
    assert np.sqrt(np.mean(errors[400:] ** 2)) <= 0.005
    assert state.theta[:-1].min() >= 0


def test_follows_a_drifting_plane_within_a_percent():
    u = np.random.default_rng(3).uniform(-1.2, 1.2, 1500)
    _, _, errors = followed(a_model(), u, drift=0.1)
    assert np.sqrt(np.mean(errors[400:] ** 2)) <= 0.01


def test_the_model_stays_on_inputs_that_hardly_excite_it():
    """Where plain recursive least squares with clipped weights grows without bound."""
    u = np.tile([0.12, 0.36], 1500)
    recursion, state, errors = followed(a_model(), u)
    assert np.abs(errors[100:]).max() < 0.05
    assert np.abs(state.theta).max() < 10 * np.ptp(a_model().range)
    assert recursion.excitation(state) < 1e-9


@pytest.mark.parametrize(
    ("sample", "why"),
    [
        ({"u": 0.5, "y": 1.0, "settled": False}, "not settled"),
        ({"u": 0.5, "y": np.nan}, "not settled"),
        ({"u": 1.3, "y": 1.0}, "beyond the levels"),
        ({"u": 0.2, "y": 1.0}, "no relay switched"),
    ],
)
def test_freezes(sample, why):
    recursion = Recursive(LEVELS)
    before = recursion.update(recursion.begin(), 0.2, 0.1)
    after = recursion.update(before, **sample)
    assert after.frozen == why
    np.testing.assert_array_equal(after.theta, before.theta)
