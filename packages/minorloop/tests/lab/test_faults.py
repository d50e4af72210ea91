import numpy as np
import pytest

from minorloop.lab.faults import codes, spikes

T = np.linspace(0, 1, 400)


@pytest.mark.parametrize("code", [9999.0, -9999.0, 32767.0, 9.9e37])
def test_codes_far_from_all_readings_are_found(code):
    y = np.linspace(-1.0, 1.0, 100)
    y[[5, 90]] = code
    assert [(found.samples, found.size) for found in codes(y)] == [((5, 90), code)]


def test_a_code_among_other_readings_is_a_reading():
    y = np.linspace(-20000, 20000, 100)
    y[50] = -9999.0
    assert codes(y) == ()
    assert codes(np.array([np.nan, 1.0, 2.0, 3.0])) == ()


def test_readings_absurdly_far_from_all_others_are_codes():
    y = np.sin(np.arange(3000.0))
    y[[7, 1500]] = 1e12, -2e4
    assert [found.samples for found in codes(y)] == [(7, 1500)]
    y[1500] = -5e3  # an outlier, which may be a measurement
    assert [found.samples for found in codes(y)] == [(7,)]
    y[100:110] = 1e12  # too many
    assert codes(y) == ()
    assert codes(np.append(np.zeros(50), 1e12)) == ()


@pytest.mark.parametrize("length", [3, 5, 8])
@pytest.mark.parametrize("step", [0.0, 2e-3])
def test_bursts_are_found(length, step):
    chance = np.random.default_rng(1000 + length)
    y = np.exp(-T / 0.3) + 1e-3 * np.random.default_rng(1100).normal(size=T.size)
    at = np.zeros(T.size, dtype=bool)
    for begin in (40, 170, 330):
        at[begin : begin + length] = True
    y += at * chance.uniform(0.4, 0.8, T.size)
    y = np.round(y / step) * step if step else y
    np.testing.assert_array_equal(spikes(y), at)


def test_a_short_hold_at_another_value_is_no_burst():
    y = np.where((T > 0.3) & (T < 0.35), 1.0, 0.0) + 1e-3 * np.random.default_rng(5).normal(
        size=T.size
    )
    assert not spikes(y).any()
