"""Readings that are lost, stuck, implausible, faster than a wire turns, or of the wrong sign."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.control.readings import (
    Expected,
    ReadingState,
    ReadingWatch,
    SensorWatch,
    as_number,
)
from wires import TICK, identified

anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.none(), st.text(max_size=3), st.integers()
)
LOST = [math.nan]


def watched(readings, models=None, heated=None, driven=None, **options):
    """What is known after each reading, of a wire that the model expects at the first one."""
    watch = ReadingWatch(wire=identified().model, sensor=SensorWatch(**options))
    state, found = ReadingState(), []
    models = [20.0] * len(readings) if models is None else models
    for k, (reading, model) in enumerate(zip(readings, models, strict=True)):
        motion = model - models[k - 1] if k else 0.0
        heating = motion * 0.1 if heated is None else heated[k]
        expected = Expected(model, motion, heating, model if driven is None else driven[k])
        state = watch.step(state, reading, as_number(reading), expected)
        found.append(state)
    return found


def believed(*arguments):
    """Whether each reading is usable, whatever was before."""
    return [each.believed and each.missing == 0 for each in watched(*arguments, patience=10_000)]


def fault(readings, **options):
    return watched(readings, **options)[-1].fault


def heated_and_cooled(wire, count):
    """Angles and heating powers of a wire at full current for some steps, and then cooling."""
    state, angles, heating = wire.begin(), [0.0], [0.0]
    for k in range(1, 150):
        power = 0.16 if k < count else 0.06
        heating.append(power - state.power)
        state = wire.step(state, power, TICK)
        angles.append(state.angle)
    return angles, heating


def still(count, around=20.0):
    return [around + 0.01 * (-1) ** k * (1 + k % 7) for k in range(count)]


@given(readings=st.lists(anything, max_size=60))
def test_every_usable_value_is_plausible(readings):
    for each in watched(readings):
        assert not each.used or SensorWatch.low <= each.value <= SensorWatch.high
        assert not (each.fault and each.used)


@pytest.mark.parametrize(
    ("readings", "found"),
    [
        ([*still(30), *LOST * 4], ""),
        ([*still(30), *LOST * 5], "lost"),
        ([*still(30), *still(30)[-1:] * 13], ""),
        ([*still(30), *still(30)[-1:] * 14], "stuck"),
        ([*still(30), 170.0], ""),
        ([*still(30), *[500.0] * 5], "implausible"),
        ([*still(30), *still(100, around=26.0)], "implausible"),
        ([*still(30), *still(270, around=26.0)], "unconfirmed"),
    ],
)
def test_a_sensor_is_at_fault_after_some_bad_readings(readings, found):
    last = watched(readings)[-1]
    assert last.fault == found
    assert not (found and last.used)


@pytest.mark.parametrize("bad", [LOST * 10, [20.0] * 40, [1e9] * 10, still(270, around=26.0)])
def test_the_sensor_is_trusted_again_after_a_second_of_good_readings(bad):
    assert fault([*still(30), *bad, *still(20)]) != ""
    assert fault([*still(30), *bad, *still(40)]) == ""


def test_a_camera_that_gives_few_pictures_is_at_fault_only_after_a_row_without_angles():
    few = [math.nan if k % 4 else reading for k, reading in enumerate(still(200))]
    camera = {"patience": 25, "makes_up": 25, "recovery": 10}
    assert fault(few, patience=25) == "lost"
    assert fault(few, **camera) == ""
    assert fault([*few, *LOST * 25], **camera) == "lost"
    half = [math.nan if k % 2 else reading for k, reading in enumerate(still(20))]
    lost = [*still(30), *LOST * 25]
    assert fault([*lost, *half[:18]], **camera) == "lost"
    assert fault([*lost, *half[:19]], **camera) == ""
    assert fault([*lost, *half[:10], *LOST * 25, *half[:18]], **camera) == "lost"


@pytest.mark.parametrize("off", [3.0, -3.0, 25.0])
def test_a_jump_is_not_believed_until_the_readings_jump_back(off):
    found = believed([*still(50), *still(2000, around=20.0 + off), *still(50)])
    assert all(found[:50])
    assert not any(found[50:2050])
    assert all(found[2050:])


def test_outliers_from_the_first_reading_on_are_the_only_ones_that_are_not_believed():
    readings = np.array(still(500))
    readings[::25] += 40.0
    found = believed(readings.tolist())
    assert not any(found[25::25])
    assert all(found[k] for k in range(500) if k % 25)


@pytest.mark.parametrize(("gap", "off"), [(1, 4.0), (5, -4.0), (12, 8.0), (12, -8.0)])
def test_readings_of_a_turning_wire_that_are_shifted_after_a_gap_are_not_believed(gap, off):
    models, heated = heated_and_cooled(identified().model, 52 + gap)
    readings = [angle + 0.01 * (-1) ** k for k, angle in enumerate(models)]
    readings[50 : 50 + gap] = LOST * gap
    right = [each.believed for each in watched(readings, models, heated)]
    assert all(right[50 + gap :])
    readings[50 + gap :] = [each + off for each in readings[50 + gap :]]
    wrong = [each.believed for each in watched(readings, models, heated)]
    assert not any(wrong[50 + gap :])


def test_readings_that_drift_back_to_the_model_are_believed_after_a_second():
    back = np.linspace(26.0, 20.0, 200).tolist()
    found = believed([*still(50), *back, *still(50)])
    assert not any(found[50:225])
    assert all(found[250:])


def test_a_bias_that_begins_in_a_second_without_readings_is_not_believed():
    found = watched([*still(50), *LOST * 25, *still(500, around=30.0)])
    assert not any(each.believed for each in found[75:])


RISE = np.linspace(0.0, 12.0, 60)


@pytest.mark.parametrize(
    ("readings", "driven", "wrong"),
    [
        (-RISE, RISE, True),
        (np.where(np.arange(60) % 3, np.nan, -RISE), RISE, True),
        (RISE - 10.0, RISE, False),
        (np.where(RISE > 2.0, RISE - 20.0, RISE), RISE, False),
        (20.0 - RISE, RISE, False),
        (-RISE, np.zeros(60), False),
    ],
)
def test_readings_that_fall_below_a_cold_wire_while_it_is_heated_are_reversed(
    readings, driven, wrong
):
    found = watched(readings.tolist(), readings.tolist(), driven=driven.tolist())
    assert found[-1].reversed == wrong
