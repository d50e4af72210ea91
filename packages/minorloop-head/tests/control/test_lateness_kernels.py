import numpy as np
import pytest

from minorloop_head.control import _lateness_kernels as kernels

LIMITS = {"seen": 0.5, "moved": 0.9, "slower": 2.0, "back": 0.5}
STEPS, INTERVAL = 4, 0.04


def slowing(readings, count):
    """The same in numpy."""
    known = np.isfinite(readings)
    if known[-count:].mean() < LIMITS["seen"] or np.ptp(readings[known]) < LIMITS["moved"]:
        return np.empty(0)
    at = np.arange(readings.size)
    angle = np.interp(at, at[known], readings[known])
    rate = (angle[STEPS:] - angle[:-STEPS])[-count:] / (STEPS * INTERVAL)
    way, part = (1.0 if angle[-1] >= angle[-count] else -1.0), count // 4
    slower = way * (rate[:part].mean() - rate[-part:].mean())
    fell = slower >= LIMITS["slower"] and (way * rate).min() >= -LIMITS["back"]
    return rate if fell else np.empty(0)


@pytest.mark.parametrize("missing", [0.0, 0.3, 0.7])
def test_a_motion_that_gets_slower_is_found_as_numpy_finds_it(missing):
    rng, found = np.random.default_rng(1000), 0
    for _ in range(400):
        size = int(rng.integers(30, 80))
        count = int(rng.integers(8, size - STEPS))
        lag = rng.uniform(0.2, 2.0)
        t = INTERVAL * np.arange(size) - rng.uniform(0.0, 1.0)
        readings = rng.uniform(-30, 30) * -np.expm1(-np.maximum(t, 0.0) / lag)
        readings += rng.normal(0.0, 0.01, size)
        readings[rng.random(size) < missing] = np.nan
        over = STEPS, STEPS * INTERVAL
        rates = kernels.slowing(
            readings, count, LIMITS["seen"], LIMITS["moved"], over, LIMITS["slower"], LIMITS["back"]
        )
        np.testing.assert_allclose(rates, slowing(readings, count), rtol=1e-9, atol=1e-9)
        found += rates.size > 0
    assert (10 < found < 390) == (missing < 0.5)


@pytest.mark.parametrize("steps", [1, 3, 9])
def test_readings_are_added_and_the_oldest_are_dropped(steps):
    recent, expected = np.empty((3, 0)), np.empty((3, 0))
    for k in range(12):
        recent = kernels.added(recent, 0.1 * k, 0.2 * k, float(k), steps, 20)
        more = np.tile([[0.1 * k], [0.2 * k], [np.nan]], steps)
        more[2, -1] = k
        expected = np.concatenate([expected, more], axis=1)[:, -20:]
        np.testing.assert_array_equal(recent, expected)
