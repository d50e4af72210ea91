import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from later import Later
from minorloop.dynamics import conversion
from minorloop.errors import ParameterError

signal = Later("scipy.signal")

POLES = st.lists(st.floats(-4, -0.05), min_size=1, max_size=4, unique_by=lambda p: round(4 * p))
NUMBERS = st.lists(st.floats(-3, 3), min_size=5, max_size=5)


def polynomials(poles, numbers):
    bottom = np.poly(poles)
    return np.array(numbers[: bottom.size]), bottom


@given(POLES, NUMBERS)
def test_canonical_form_has_the_transfer_function(poles, numbers):
    top, bottom = polynomials(poles, numbers)
    a, b, c, d = conversion.canonical(top, bottom)
    for s in (0.7, 1j, -9.0, 2 - 3j):
        ratio = np.polyval(top, s) / np.polyval(bottom, s)
        got = c @ np.linalg.solve(s * np.eye(b.size) - a, b) + d
        np.testing.assert_allclose(got, ratio, atol=1e-7 * (1 + abs(ratio)))


@given(POLES, NUMBERS, st.floats(0.05, 2))
def test_sampled_equals_scipy(poles, numbers, interval):
    top, bottom = polynomials(poles, numbers)
    got = conversion.sampled(top, bottom, interval)
    system = conversion.canonical(top, bottom)
    a, b, c, d = (np.atleast_2d(part) for part in system)
    wanted = signal.cont2discrete((a, b.T, c, d), interval, method="zoh")
    wanted = signal.ss2tf(*wanted[:4])
    np.testing.assert_allclose(got[0], np.ravel(wanted[0]), atol=1e-8)
    np.testing.assert_allclose(got[1], wanted[1], atol=1e-9)


@given(POLES, NUMBERS, st.floats(0.1, 1))
@settings(max_examples=25)
def test_continuous_inverts_sampled(poles, numbers, interval):
    top, bottom = polynomials(poles, numbers)
    again = conversion.continuous(*conversion.sampled(top, bottom, interval), interval)
    s = 1j * np.array([0.03, 0.3, 3.0])
    wanted = np.polyval(top, s) / np.polyval(bottom, s)
    got = np.polyval(again[0], s) / np.polyval(again[1], s)
    np.testing.assert_allclose(got, wanted, atol=1e-5 * (1e-3 + np.abs(top).max()))


def test_a_pure_gain_does_not_change():
    for convert in (conversion.sampled, conversion.continuous):
        top, bottom = convert(np.array([3.0]), np.array([1.0]), 0.5)
        np.testing.assert_array_equal(top, [3.0])
        np.testing.assert_array_equal(bottom, [1.0])


def test_rounding_adds_no_zeros():
    """Three lags, sampled and made continuous again, have no zeros."""
    top, bottom = np.array([0, 0, 0, 1.0]), np.poly([-1 / 27, -1 / 6, -1 / 2])
    again, _ = conversion.continuous(*conversion.sampled(top, bottom, 1.0), 1.0)
    assert np.count_nonzero(again) == 1


@pytest.mark.parametrize("pole", [0.0, -0.3, -1e-12])
def test_refuses_poles_that_no_continuous_system_has(pole):
    with pytest.raises(ParameterError, match="identify with a lower order or sample faster"):
        conversion.continuous(np.array([0.0, 1.0]), np.array([1.0, -pole]), 1.0)
    conversion.refuse_alternating(np.array([0.5, -0.3 + 0.1j, -0.3 - 0.1j]))
