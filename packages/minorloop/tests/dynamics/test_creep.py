import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.dynamics.creep import Creep, fit_creep

TIMES = st.lists(st.floats(0.2, 50), min_size=1, max_size=4)
SEEDS = st.integers(0, 2**32 - 1)


def random_holds(seed, samples=60):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.1, 2.0, samples))
    return t, np.repeat(rng.normal(size=samples // 6), 6)


def lagged(t, x, tau, before):
    """Output of a first-order lag, by superposition of the steps of its input."""
    edges = np.concatenate([[2 * t[0] - t[1]], t])
    since = np.exp((np.minimum(edges, t[:, None]) - t[:, None]) / tau)
    return before * since[:, 0] + np.diff(since, axis=1) @ x


@given(TIMES, SEEDS, st.floats(-1, 1))
def test_a_sum_of_lags(times, seed, before):
    t, x = random_holds(seed)
    strengths = np.linspace(0.1, 0.4, len(times))
    lags = np.array([lagged(t, x, tau, before) for tau in times])
    model = Creep(times, strengths, gain=1.2, offset=0.5)
    wanted = 0.5 + 1.2 * x + strengths @ lags
    np.testing.assert_allclose(model.simulate(t, x, before=before), wanted, atol=1e-9)


@given(TIMES, SEEDS, st.floats(-1, 1))
def test_compensated_signals_bring_every_sample_to_its_target(times, seed, before):
    t, targets = random_holds(seed)
    model = Creep(times, np.linspace(0.4, 0.1, len(times)), gain=0.8, offset=-0.3)
    x = model.compensate(t, targets, before=before)
    np.testing.assert_allclose(model.simulate(t, x, before=before), targets, atol=1e-9)


def nrmse(model, t, x, y):
    return np.sqrt(np.mean((model.simulate(t, x) - y) ** 2)) / np.ptp(y)


@pytest.mark.parametrize("seed", range(1000, 1004))
def test_fit_finds_the_output_and_the_settled_gain(seed):
    """With time constants between those of the grid, the curve is found and not the constants."""
    rng = np.random.default_rng(seed)
    t, x = np.arange(1.0, 1201), np.repeat(rng.normal(size=6), 200)
    truth = Creep(rng.uniform(5, 90, 2), rng.uniform(0.1, 0.5, 2), gain=3.0, offset=-2.0)
    y = truth.simulate(t, x)
    found = fit_creep(t, x, y)
    assert nrmse(found, t, x, y) < 2e-3
    assert found.strengths.min() >= 0
    assert abs(found.dc_gain / truth.dc_gain - 1) < 0.02
