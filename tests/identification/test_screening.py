import numpy as np
import pytest

from fault_records import INPUTS, kinds, plant, record
from minorloop.errors import SignalError
from minorloop.identification import identify
from minorloop.identification.screening import codes, record_faults


@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e6])
@pytest.mark.parametrize("shape", INPUTS)
def test_nothing_is_found_in_a_sound_record(shape, unit):
    assert kinds(*record(shape, unit)) == []


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_nor_in_a_coarsely_quantised_one_that_saturates(noise):
    u, y = record(noise=noise)
    coarse = np.round(np.tanh(4 * y) * 100) / 100
    assert kinds(u, coarse) == []


@pytest.mark.parametrize("ranges", [-30, 0.8, 5, 1000])
@pytest.mark.parametrize("shape", INPUTS)
def test_an_outlier_is_named_with_its_sample(shape, ranges):
    u, y = record(shape)
    y[37] += ranges * np.ptp(y)
    (finding,) = record_faults(u, y, "negative", 0)
    assert (finding.kind, finding.samples) == ("outlier", (37,))
    assert f"sample 37 ({y[37]:.6g})" in finding.text
    assert "empty these cells" in finding.text


def test_a_first_reading_that_the_rough_model_misses_is_no_outlier():
    u, y = record("sine")
    y[0] -= 0.3 * np.ptp(y)
    assert kinds(u, y) == []


def test_an_output_that_follows_its_input_far_out_is_no_outlier():
    u = np.r_[0.3 + 0.02 * np.sin(np.arange(300) / 5), np.linspace(0.3, 1, 3), 0.3]
    assert "outlier" not in kinds(u, plant(u))


@pytest.mark.parametrize("code", [9.9e37, -9.9e37, 9.91e37, 3.4e38, -9999.0, 999.99, 32767.0])
def test_codes_are_left_out_and_named(code):
    u, y = record()
    y[[5, 90]] = code
    found = identify(u, y, levels=8, holdout=0.3)
    assert [one.sample for one in found.codes] == [5, 90]
    assert not found.fitted[[5, 90]].any()
    clean = y.copy()
    clean[[5, 90]] = np.nan
    assert found.model == identify(u, clean, levels=8, holdout=0.3).model
    assert "2 readings are codes of the instrument" in found.advice[0]
    assert f"sample 5 ({code:.6g})" in found.advice[0]
    assert found.warnings == ()


def test_a_code_among_other_readings_is_a_reading():
    y = np.linspace(-20000, 20000, 100)
    y[50] = -9999.0
    assert codes(y) == ()
    assert codes(np.array([np.nan, 1.0, 2.0, 3.0])) == ()


def test_an_overload_code_is_no_input():
    u, y = record()
    u = u.copy()
    u[7] = 9.9e37
    with pytest.raises(SignalError, match=r"u is 9.9e\+37 at index 7, which is an overload code"):
        identify(u, y, levels=8)


def test_a_record_of_little_is_not_screened():
    assert kinds(np.arange(8.0), np.arange(8.0) ** 9) == []
