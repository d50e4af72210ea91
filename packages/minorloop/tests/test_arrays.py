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


U = [1.0, 2.0, 3.0]


def levels(*values):
    return lambda: as_levels(values)


def uniform(*given):
    return lambda: uniform_levels(*given)


@pytest.mark.parametrize(
    ("error", "says", "act"),
    [
        (ParameterError, r"shape \(1,\)", levels(1.0)),
        (ParameterError, "not an array of numbers", levels("a", "b")),
        (ParameterError, "nan at index 1", levels(0.0, np.nan)),
        (ParameterError, "1.0 at index 1 is followed by 1.0; sort", levels(0.0, 1.0, 1.0)),
        (ParameterError, "more than a float can hold; scale the input", levels(-1e308, 1e308)),
        (ParameterError, "apart, less than 1e-290; scale the input up", levels(0.0, 1e-320)),
        (ParameterError, "finite low < high", uniform(1.0, 0.0, 3)),
        *((ParameterError, "give a whole number", uniform(0.0, 1.0, bands))
          for bands in (0, "x", None, np.nan, np.inf)),
        (ParameterError, "gain is more than a float can hold", lambda: as_finite("gain", 10**400)),
        (SignalError, "u is not an array of real numbers", lambda: as_samples([10**400], name="u")),
        (SignalError, "index 2", lambda: as_times([0.0, 1.0, 0.5])),
        (SignalError, "targets has shape", lambda: as_waveform([0, 1], [1.0], name="targets")),
        (SignalError, "finite", lambda: as_waveform([0.0, 1.0], [1.0, np.nan])),
        (SignalError, r"give u of shape \(2, 3\)", lambda: as_waveform(range(3), U, channels=2)),
        (SignalError, r"u has shape \(2,\) and y \(1,\)", lambda: as_pair([0.0, 1.0], [1.0])),
        (SignalError, r"input .* below 1e\+150", lambda: as_pair([0, 1e308], [np.nan, 1])),
    ],
)  # fmt: skip
def test_says_what_is_wrong(error, says, act):
    with pytest.raises(error, match=says):
        act()


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


@pytest.mark.parametrize("value", [0, 11, 2.0, np.nan, np.inf, "a", None, True, 10**400])
def test_refuses_wrong_counts(value):
    with pytest.raises(ParameterError, match=r"sweeps is .*; give a whole number from 1 to 10"):
        as_whole("sweeps", value, 1, 10)
    assert as_whole("sweeps", np.int64(3), 1, 10) == 3
