"""A wire turns no faster than its model allows; readings that do are not believed."""

import math

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.control.motion import Belief, MotionWatch, Sign, SignWatch, fastest
from wires import TICK, identified, made_up


def believed(watch, readings, models=None, heated=None):
    """Whether each reading is believed, of a wire that the model expects at 20 degrees."""
    belief, found = Belief(), []
    models = [20.0] * len(readings) if models is None else models
    for k, (reading, model) in enumerate(zip(readings, models, strict=True)):
        motion = model - models[k - 1] if k else 0.0
        heating = motion * 0.1 if heated is None else heated[k]
        belief = watch.step(belief, reading, model, motion=motion, heating=heating)
        found.append(belief.believed and not math.isnan(reading))
    return found


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


@pytest.mark.parametrize("off", [3.0, -3.0, 6.0, 10.0, 25.0, -25.0])
def test_a_jump_is_not_believed_until_the_readings_jump_back(off):
    readings = [*still(50), *still(2000, around=20.0 + off), *still(50)]
    found = believed(MotionWatch(wire=identified().model), readings)
    assert all(found[:50])
    assert not any(found[50:2050])
    assert all(found[2050:])


def test_outliers_from_the_first_reading_on_are_the_only_ones_that_are_not_believed():
    readings = np.array(still(500))
    readings[::25] += 40.0
    found = believed(MotionWatch(wire=identified().model), readings.tolist())
    assert not any(found[25::25])
    assert all(found[k] for k in range(500) if k % 25)


@pytest.mark.parametrize("gap", [1, 5, 12])
@pytest.mark.parametrize("off", [4.0, -4.0, 8.0, -8.0])
def test_readings_of_a_turning_wire_that_are_shifted_after_a_gap_are_not_believed(gap, off):
    wire, watch = identified().model, MotionWatch(wire=identified().model)
    models, heated = heated_and_cooled(wire, 52 + gap)
    readings = [angle + 0.01 * (-1) ** k for k, angle in enumerate(models)]
    readings[50 : 50 + gap] = [math.nan] * gap
    assert all(believed(watch, readings, models, heated)[50 + gap :])
    readings[50 + gap :] = [each + off for each in readings[50 + gap :]]
    assert not any(believed(watch, readings, models, heated)[50 + gap :])


def test_readings_that_drift_back_to_the_model_are_believed_after_a_second():
    back = np.linspace(26.0, 20.0, 200).tolist()
    found = believed(MotionWatch(wire=identified().model), [*still(50), *back, *still(50)])
    assert not any(found[50:225])
    assert all(found[250:])


def test_no_wire_turns_faster_than_its_fastest_rate():
    wire = made_up()
    state, angles = wire.begin(), [0.0]
    for _ in range(300):
        state = wire.step(state, 0.16, TICK)
        angles.append(state.angle)
    most = fastest(wire) * 0.16 * TICK
    assert 0.2 * most < np.diff(angles).max() <= most


def test_a_bad_option_is_refused():
    with pytest.raises(ParameterError, match="jump is 0"):
        MotionWatch(wire=made_up(), jump=0)


def sign_after(readings, models):
    watch = SignWatch(wire=identified().model)
    sign = Sign()
    for reading, model in zip(readings, models, strict=True):
        sign = watch.step(sign, reading, model)
    return sign.reversed


def test_readings_that_fall_below_a_cold_wire_while_it_is_heated_are_reversed():
    rise = np.linspace(0.0, 12.0, 60)
    assert sign_after((-rise).tolist(), rise)
    assert sign_after([math.nan if k % 3 else -y for k, y in enumerate(rise)], rise)


def test_other_readings_below_a_cold_wire_are_not_reversed():
    rise = np.linspace(0.0, 12.0, 60)
    assert not sign_after((rise - 10.0).tolist(), rise)
    assert not sign_after(np.where(rise > 2.0, rise - 20.0, rise).tolist(), rise)
    assert not sign_after((20.0 - rise).tolist(), rise)
    assert not sign_after((-rise).tolist(), np.zeros(60))


def test_a_bias_that_begins_in_a_second_without_readings_is_not_believed():
    readings = [*still(50), *[math.nan] * 25, *still(500, around=30.0)]
    found = believed(MotionWatch(wire=identified().model), readings)
    assert not any(found[75:])
