import numpy as np
import pytest

from minorloop.dynamics.linear import Linear
from minorloop.identification.arx import arx

LAGS = Linear.lags(27.0, 6.0)


def step(plant=LAGS, noise=0.0, seed=0, rest=300, hold=600, gain=1.0, interval=1.0):
    """A step from 0.40 to 0.45, as an actuator records it."""
    t = interval * np.arange(1.0, rest + hold + 1)
    u = np.where(t <= rest * interval, 0.40, 0.45)
    y = gain * plant.simulate(t, u, before=0.40)
    return t, u, y + np.random.default_rng(seed).normal(0, noise * gain * 0.05, t.size)


def farthest(fit, wanted):
    """Relative error of the worst found time constant."""
    return float(np.abs(fit.model.time_constants[:, None] / wanted - 1).min(axis=0).max())


@pytest.mark.parametrize(("times", "late"), [((27.0,), 2), ((27.0, 6.0), 0), ((50, 12, 3), 2)])
def test_a_known_plant_is_found_exactly(times, late):
    fit = arx(*step(Linear.lags(*times, delay=late), gain=220.0))
    assert farthest(fit, times) <= 1e-4
    assert fit.model.order == len(times)
    assert abs(fit.model.dc_gain - 1) <= 1e-9
    assert fit.model.delay == late
    np.testing.assert_allclose(fit.gain, 220.0, rtol=1e-6)
    np.testing.assert_allclose(fit.continuous.time_constants, times, rtol=1e-4)


@pytest.fixture(scope="module")
def noisy():
    """Noise of a two-thousandth of the step."""
    return [arx(*step(noise=5e-4, seed=seed)) for seed in range(5)]


def test_a_known_plant_is_found_within_five_percent_despite_noise(noisy):
    assert max(farthest(fit, [27.0, 6.0]) for fit in noisy) <= 0.05
    assert max(abs(fit.model.dc_gain - 1) for fit in noisy) <= 1e-9
    t = np.arange(0.0, 300)
    errors = [fit.model.step_response(t) - LAGS.step_response(t) for fit in noisy]
    assert np.abs(errors).max() <= 1e-3


def test_a_second_record_chooses():
    second = step(noise=5e-4, seed=99, gain=2.0)
    fit = arx(*step(noise=5e-4), second=second)
    assert fit.free_run_nrmse < 1e-3
    best = min(one.free_run for one in fit.candidates)
    assert fit.candidate.free_run <= 1.05 * best + 1e-5
    assert farthest(fit, [27.0, 6.0]) <= 0.05
