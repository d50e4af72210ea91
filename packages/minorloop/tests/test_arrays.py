import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop import ParameterError, Preisach, SignalError
from minorloop.arrays import (
    as_finite,
    as_levels,
    as_pair,
    as_samples,
    as_times,
    as_triangle,
    as_waveform,
    as_whole,
    uniform_levels,
)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 1e6), st.integers(1, 300))
def test_uniform_levels_have_exact_ends(low, width, bands):
    levels = uniform_levels(low, low + width, bands)
    assert levels.size == bands + 1
    assert (levels[0], levels[-1]) == (low, low + width)
    np.testing.assert_allclose(np.diff(levels), width / bands, rtol=1e-3)
    assert not levels.flags.writeable


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ([1.0], r"shape \(1,\)"),
        ([[0.0, 1.0]], r"shape \(1, 2\)"),
        (["a", "b"], "not an array of numbers"),
        ([0.0, np.nan], "nan at index 1"),
        ([0.0, 1.0, 1.0], "1.0 at index 1 is followed by 1.0; sort them and drop repeats"),
        ([-1e308, 1e308], "more than a float can hold; scale the input down"),
        ([0.0, 1e-320], "apart, less than 1e-290; scale the input up"),
    ],
)
def test_refuses_wrong_levels(values, says):
    with pytest.raises(ParameterError, match=says):
        as_levels(values)


@pytest.mark.parametrize(
    ("low", "high", "bands", "says"),
    [
        (1.0, 0.0, 3, "finite low < high"),
        (0.0, np.nan, 3, "finite low < high"),
        (-np.inf, 0.0, 3, "finite low < high"),
        (-1e308, 1e308, 3, "more than a float can hold"),
        *((0.0, 1.0, bands, "give a whole number") for bands in (0, "x", None, np.nan, np.inf)),
    ],
)
def test_refuses_wrong_ends_and_counts_of_uniform_levels(low, high, bands, says):
    with pytest.raises(ParameterError, match=says):
        uniform_levels(low, high, bands)


@pytest.mark.parametrize("scale", [1e-280, 1e-30, 1e30, 1e280])
def test_the_memory_is_exact_in_extreme_units(scale):
    weights = np.tril(np.random.default_rng(0).uniform(size=(5, 5)))
    u = np.random.default_rng(1).uniform(-1, 1, 200)
    plain = Preisach(np.linspace(-1, 1, 6), weights).simulate(u)
    scaled = Preisach(np.linspace(-1, 1, 6) * scale, weights).simulate(u * scale)
    np.testing.assert_allclose(scaled, plain, atol=1e-12 * np.ptp(plain))


def test_masked_samples_were_not_measured():
    masked = np.ma.array([1.0, 1e6, 3.0], mask=[False, True, False])
    np.testing.assert_array_equal(as_samples(masked, name="y", gaps=True), [1.0, np.nan, 3.0])
    with pytest.raises(SignalError, match="y is nan at index 1"):
        as_samples(masked, name="y")


def test_refuses_numbers_beyond_floats():
    with pytest.raises(ParameterError, match="gain is more than a float can hold"):
        as_finite("gain", 10**400)
    with pytest.raises(SignalError, match="u is not an array of real numbers"):
        as_samples([10**400], name="u")
    with pytest.raises(ParameterError, match="levels are not an array of numbers"):
        as_levels([0, 10**400])
    with pytest.raises(ParameterError, match="weights are not an array of numbers"):
        as_triangle([[10**400]], 1, name="weights")


@pytest.mark.parametrize("value", [0, 11, 2.0, np.nan, np.inf, "a", None, True, 10**400])
def test_refuses_wrong_counts(value):
    with pytest.raises(ParameterError, match=r"sweeps is .*; give a whole number from 1 to 10"):
        as_whole("sweeps", value, 1, 10)
    assert as_whole("sweeps", np.int64(3), 1, 10) == 3


def test_refuses_wrong_times_and_shapes():
    with pytest.raises(SignalError, match=r"index 2"):
        as_times([0.0, 1.0, 0.5])
    with pytest.raises(SignalError, match="at least 3"):
        as_times([0.0, 1.0], fewest=3)
    with pytest.raises(SignalError, match="targets has shape"):
        as_waveform([0.0, 1.0], [1.0], name="targets")
    with pytest.raises(SignalError, match="finite"):
        as_waveform([0.0, 1.0], [1.0, np.nan])
    with pytest.raises(SignalError, match=r"give u of shape \(2, 3\)"):
        as_waveform([0.0, 1.0, 2.0], [1.0, 2.0, 3.0], channels=2)
    with pytest.raises(SignalError, match=r"u has shape \(2,\) and y \(1,\)"):
        as_pair([0.0, 1.0], [1.0])


@pytest.mark.parametrize(("u", "y", "which"), [(1e308, 1.0, "input"), (1.0, -4e307, "output")])
def test_a_pair_whose_squares_would_overflow_is_refused(u, y, which):
    with pytest.raises(SignalError, match=rf"the {which} reaches .*; scale it to below 1e\+150"):
        as_pair([0.0, u], [np.nan, y])
