import numpy as np
import pytest

from minorloop.identification.residuals import find_startup, noise_in


def test_a_startup_is_short_and_worse_than_the_rest():
    error = np.full(400, 0.01)
    assert find_startup(error, np.arange(400)) is None
    error[:5] = 0.3
    assert find_startup(error, np.arange(400)).rows == 5
    error[:80] = 0.3
    assert find_startup(error, np.arange(400)) is None


def test_independent_errors_are_noise_and_slow_ones_are_not():
    rng = np.random.default_rng(1000)
    y = rng.uniform(size=400)
    error = 0.05 * rng.normal(size=400)
    assert noise_in(error, y) == pytest.approx(0.05, rel=0.15)
    assert noise_in(0.05 * np.sin(np.arange(400) / 20), y) < 1e-3


def test_errors_are_no_noise_where_readings_leave_a_hole():
    rng = np.random.default_rng(1000)
    y, noise = rng.uniform(size=200), 0.05 * rng.normal(size=200)
    without_a_bit = y - 0.125 * (np.floor(8 * y) % 2)
    assert noise_in(y - 0.0625 - without_a_bit, without_a_bit) == 0
    assert noise_in(-noise, np.round(y) + noise) > 0.04  # an actuator with two states
