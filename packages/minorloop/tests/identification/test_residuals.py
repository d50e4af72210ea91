import numpy as np
import pytest

from fault_records import record
from fixed_options import Plane, identify
from minorloop.identification.residuals import amplitudes, find_startup, noise_in
from minorloop.identification.rough_model import one_of_each


def test_a_startup_is_short_and_worse_than_the_rest():
    error = np.full(400, 0.01)
    assert find_startup(error, np.arange(400)) is None
    error[:5] = 0.3
    assert find_startup(error, np.arange(400)).rows == 5
    error[:80] = 0.3
    assert find_startup(error, np.arange(400)) is None


def test_the_worst_sample_is_reported():
    u, y = record()
    y[123] += 0.1 * np.ptp(y)
    found = identify(u, y, Plane(8))
    assert found.residual.worst_sample == 123
    assert found.residual.worst == pytest.approx(-0.1, abs=0.03)
    assert "sample 123" in str(found)


def test_amplitudes_are_those_of_the_present_branch():
    u = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 3.0])
    np.testing.assert_array_equal(amplitudes(u), [2, 2, 2, 1, 1, 2])


def test_one_row_of_each_block_does_not_follow_a_period():
    np.testing.assert_array_equal(one_of_each(5, 10), np.arange(5))
    rows = one_of_each(100_000, 1000)
    assert (np.diff(rows) > 0).all()
    np.testing.assert_array_equal(rows // 100, np.arange(1000))
    places = np.bincount(rows % 100, minlength=100)
    assert places.max() < 40  # every hundredth row would always be at the same place


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
