import numpy as np
import pytest

from fault_records import INPUTS, record
from fixed_options import Options, Plane, identify
from minorloop.identification import Smooth, excitation
from minorloop.lab.columns import read_columns
from minorloop.lab.records import Record
from plane_records import LEVELS, a_plane, a_record


def test_warnings_come_first_and_go_with_every_inverse():
    u, y = record()
    y[40:120] = y[40]
    found = identify(u, y, Plane(8), holdout=0.3)
    assert "the output is stuck" in found.warnings[0]
    assert found.advice[: len(found.warnings)] == found.warnings
    inverse = found.invert([0.0])
    assert inverse.warnings == found.warnings
    assert f"warning: {found.warnings[0]}" in str(inverse)
    assert "warning" not in str(found.model.invert([0.0]))


@pytest.mark.parametrize("option", ["lag", "slope"])
def test_an_option_is_not_recommended_where_it_was_given_or_compared(option):
    u = INPUTS["levels"]
    for given, said in (({}, True), ({option: "auto"}, False)):
        found = Options.of({"levels": 3, "holdout": 0.3, "diagonal": "uniform", **given}).identify(
            Record(u, u**3)
        )
        worse = next(text for text in found.warnings if "polynomial" in text)
        assert (f"--{option}" in worse) == said


@pytest.mark.parametrize(
    ("u", "y", "says"),
    [
        (excitation.major_loop(LEVELS), None, "one major loop"),
        (LEVELS[[0, 10, 1, 9, 2, 8, 3, 7, 4, 6, 5]], None, "reversal points only"),
        (a_record(30)[0], None, "30 samples for 56 unknowns"),
    ],
)
def test_advice_names_a_poor_input(u, y, says):
    advice = " ".join(identify(u, a_plane().simulate(u), Plane(LEVELS)).advice)
    assert says in advice
    assert "no data were held out" in advice


def test_groups_that_differ_are_named():
    u, y = a_record(400)
    groups = np.arange(400) // 80
    same = " ".join(identify(Record(u, y, groups=groups), Plane(10)).advice)
    assert "no data were held out" not in same
    few = groups[::4]
    differ = identify(Record(u[:100], y[:100], groups=few), Plane(10), prior=Smooth(0.0))
    assert "the error on left-out groups" in " ".join(differ.advice)


def test_advice_names_a_falling_output():
    u, y = a_record(400)
    assert "reverse the sign of the output" in " ".join(identify(u, -y, Plane(10)).advice)
    assert "reverse the sign" not in " ".join(identify(u, y, Plane(10)).advice)


@pytest.mark.parametrize("shape", INPUTS)
def test_exchanged_columns_are_named_unless_weights_may_be_negative(shape):
    u, y = record(shape)
    says = "loops run clockwise"
    assert says in " ".join(identify(y, u, Plane(8), holdout=0.3).warnings)
    assert says not in " ".join(identify(u, y, Plane(8), holdout=0.3).warnings)
    assert says not in " ".join(identify(y, u, Plane(8, signed=True), holdout=0.3).warnings)


def test_a_bit_that_never_changes_is_no_noise():
    u, y = record("levels")
    bit = np.ptp(y) / 8
    above = y - y.min()
    assert not identify(u, y, Plane(12)).warnings
    found = identify(u, y - bit * (np.floor(above / bit) % 2), Plane(12))
    assert "beyond noise" in " ".join(found.warnings)


def test_a_filter_is_more_than_the_lag_that_was_found():
    u, y = record("sine")
    filtered = np.convolve(y, np.full(12, 1 / 12))[: y.size]
    filtered[:12] = y[:12]
    found = identify(u, filtered, Plane(12, lag="auto"))
    assert found.lag > 0
    assert "beyond noise" in " ".join(found.warnings)


def test_advice_names_one_measured_major_loop(shared_data):
    columns = read_columns(
        shared_data / "piezo_micromanipulator_model.csv", ["input_V", "displacement_um"]
    )
    u, y = (column[200:] for column in columns.values())
    assert "one major loop" in " ".join(identify(u, y, Plane(25, lag=3), holdout=0.3).advice)
