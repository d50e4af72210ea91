import numpy as np
import pytest

from fault_records import INPUTS, kinds, record
from fixed_options import Plane, identify
from minorloop import SignalError, excitation
from minorloop.identification.curves import Curves
from minorloop.identification.screening import record_faults


@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e6])
@pytest.mark.parametrize("shape", INPUTS)
def test_no_fault_is_found_in_a_sound_record(shape, unit):
    assert kinds(*record(shape, unit)) == []


@pytest.mark.parametrize("ranges", [-30, 0.8, 5, 1000])
@pytest.mark.parametrize("shape", INPUTS)
def test_an_outlier_is_named_with_its_sample(shape, ranges):
    u, y = record(shape)
    y[37] += ranges * np.ptp(y)
    (finding,) = record_faults(u, y, Curves.whole("negative"), 0)
    assert (finding.kind, finding.samples) == ("outlier", (37,))
    assert f"sample 37 ({y[37]:.6g})" in finding.text
    assert "empty these cells" in finding.remedy


def test_a_reading_beside_a_jump_is_no_outlier():
    u = excitation.reversal_curves(np.sqrt(np.linspace(0, 1, 13)))
    begin = np.where(np.diff(u, prepend=-1) > 0, 0.6, 0.4)  # as a heated wire
    y = np.clip(20 * (u - begin), 0, 1) + 1e-3 * np.random.default_rng(1).normal(size=u.size)
    assert "outlier" not in kinds(u, y)


@pytest.mark.parametrize("code", [9.9e37, -9.9e37, 9.91e37, 3.4e38, -9999.0, 999.99, 32767.0])
def test_codes_are_left_out_and_named(code):
    u, y = record()
    y[[5, 90]] = code
    found = identify(u, y, Plane(8), holdout=0.3)
    assert [one.samples for one in found.codes] == [(5, 90)]
    assert not found.fitted[[5, 90]].any()
    clean = y.copy()
    clean[[5, 90]] = np.nan
    assert found.model == identify(u, clean, Plane(8), holdout=0.3).model
    assert "2 readings are codes of the instrument" in found.advice[0]
    assert f"sample 5 ({code:.6g})" in found.advice[0]
    assert found.warnings == ()


def test_an_overload_code_is_no_input():
    u, y = record()
    u = u.copy()
    u[7] = 9.9e37
    with pytest.raises(SignalError, match=r"u is 9.9e\+37 at index 7, an overload code"):
        identify(u, y, Plane(8))


@pytest.mark.parametrize("code", [-9999.0, 999.99])
def test_a_sentinel_among_the_inputs_is_named(code):
    u, y = record()
    u = u.copy()
    u[50] = code
    (warning,) = (text for text in identify(u, y, Plane(8)).warnings if "input is a code" in text)
    assert f"sample 50 ({code:g}); give the applied input" in warning


def test_inputs_that_often_go_to_the_end_of_a_converter_are_inputs():
    u = np.tile([0.0, 1000.0, 32767.0, 500.0], 30)
    y = 0.01 * u + np.tile([0, 9], 60)
    assert not any("code" in text for text in identify(u, y, Plane(3)).advice)


@pytest.mark.parametrize("holdout", [0.0, 0.2])
def test_errors_as_they_are_printed_above_a_tenth_are_a_warning(holdout):
    u, y = record()
    drift = 0.8 * np.sin(np.arange(y.size) / 17) * (np.arange(y.size) < 240)
    found = identify(u, y + drift, Plane(8), holdout=holdout)
    (warning,) = (text for text in found.warnings if "the error on" in text)
    assert found.nrmse > 0.1
    assert f"fitted data is {found.nrmse:.3%} of range" in warning
    assert f"{found.nrmse:.3%} of range" in str(found)
    if found.holdout_nrmse is not None and found.holdout_nrmse > 0.1:
        assert f"held-out data is {found.holdout_nrmse:.3%} of range" in warning
