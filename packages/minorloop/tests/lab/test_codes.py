import numpy as np
import pytest

from minorloop.lab.codes import codes


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
