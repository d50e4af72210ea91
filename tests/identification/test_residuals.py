import numpy as np
import pytest

from fault_records import record
from minorloop.identification import identify
from minorloop.identification.residuals import amplitudes, find_startup


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
    found = identify(u, y, levels=8)
    assert found.residual.worst_sample == 123
    assert found.residual.worst == pytest.approx(-0.1, abs=0.03)
    assert "sample 123" in str(found)


def test_amplitudes_are_those_of_the_present_branch():
    u = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 3.0])
    np.testing.assert_array_equal(amplitudes(u), [2, 2, 2, 1, 1, 2])
