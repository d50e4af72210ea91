import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop_head.control.sensing import Sensed, SensorWatch

anything = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True), st.none(), st.text(max_size=3), st.integers()
)


def after(watch, readings):
    state = Sensed()
    for reading in readings:
        state = watch.step(state, reading)
    return state


def wiggling(count, around=20.0):
    return [around + 0.01 * (-1) ** k * (1 + k % 7) for k in range(count)]


@given(readings=st.lists(anything, max_size=60))
def test_every_usable_value_is_plausible(readings):
    watch, state = SensorWatch(), Sensed()
    for reading in readings:
        state = watch.step(state, reading)
        assert math.isnan(state.value) or watch.low <= state.value <= watch.high
        assert not state.fault or math.isnan(state.value)


def test_a_camera_that_gives_few_pictures_is_at_fault_only_after_a_row_without_angles():
    few = [math.nan if k % 4 else reading for k, reading in enumerate(wiggling(200))]
    assert after(SensorWatch(patience=25), few).fault == "lost"
    by_camera = SensorWatch(patience=25, makes_up=25)
    assert after(by_camera, few).fault == ""
    assert after(by_camera, [*few, *[math.nan] * 25]).fault == "lost"


def test_a_camera_that_gives_few_pictures_is_trusted_again_after_as_many_readings():
    by_camera = SensorWatch(patience=25, makes_up=25, recovery=10)
    few = [math.nan if k % 2 else reading for k, reading in enumerate(wiggling(20))]
    lost = [*wiggling(30), *[math.nan] * 25]
    assert after(by_camera, [*lost, *few[:18]]).fault == "lost"
    assert after(by_camera, [*lost, *few[:19]]).fault == ""
    assert after(by_camera, [*lost, *few[:10], *[math.nan] * 25, *few[:18]]).fault == "lost"


def test_a_lost_sensor_is_at_fault_after_a_fifth_of_a_second():
    readings = wiggling(30)
    assert after(SensorWatch(), [*readings, *[math.nan] * 4]).fault == ""
    assert after(SensorWatch(), [*readings, *[math.nan] * 5]).fault == "lost"


def test_a_noisy_sensor_that_repeats_itself_is_stuck():
    readings = wiggling(30)
    assert after(SensorWatch(), [*readings, *[readings[-1]] * 13]).fault == ""
    assert after(SensorWatch(), [*readings, *[readings[-1]] * 14]).fault == "stuck"


def test_one_outlier_is_dropped_and_repeated_ones_are_a_fault():
    readings = wiggling(30)
    once = after(SensorWatch(), [*readings, 170.0])
    assert math.isnan(once.value)
    assert once.fault == ""
    assert after(SensorWatch(), [*readings, *[500.0] * 5]).fault == "implausible"


def test_readings_that_no_wire_can_make_are_a_fault_however_long_they_last():
    watch, state = SensorWatch(), after(SensorWatch(), wiggling(30))
    for reading in wiggling(400, around=23.0):
        state = watch.step(state, reading, believed=False)
    assert math.isnan(state.value)
    assert state.fault == "implausible"
    for reading in wiggling(30):
        state = watch.step(state, reading)
    assert state.fault == ""


@pytest.mark.parametrize("bad", [[math.nan] * 10, [20.0] * 40, [1e9] * 10])
def test_the_sensor_is_trusted_again_after_a_second_of_good_readings(bad):
    readings = [*wiggling(30), *bad]
    assert after(SensorWatch(), [*readings, *wiggling(20)]).fault != ""
    assert after(SensorWatch(), [*readings, *wiggling(40)]).fault == ""


@pytest.mark.parametrize(
    "option",
    [
        {"noise": -1.0},
        {"repeats": 1},
        {"patience": 0},
        {"recovery": 0},
        {"jump": 0.0},
        {"low": 10.0, "high": 10.0},
    ],
)
def test_bad_options_are_refused(option):
    with pytest.raises(ParameterError):
        SensorWatch(**option)
