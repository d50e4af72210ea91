import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop.head.control.controller import Loop, heating, mean_slope, width
from minorloop.head.control.head import CONTROLLERS, controller
from wires import made_up

NAMES = pytest.mark.parametrize("name", CONTROLLERS)


def seen_as_it_is(law, wire, reference, seconds, *, start=(0.0, 0.0), bias=0.0):
    """Angles of the model itself, as the plant, in a loop with one step of delay."""
    angle, current = start
    plant = wire.found(current**2, angle)
    state, seen, angles = law.begin(angle, current), plant.angle, []
    for _ in range(round(seconds / law.interval)):
        current, state = law.step(state, reference, seen)
        seen = plant.angle
        plant = wire.step(plant, current**2, law.interval, ambient=bias)
        angles.append(plant.angle)
    return np.array(angles)


@NAMES
@pytest.mark.parametrize("reference", [15.0, 45.0])
def test_every_controller_takes_its_own_model_to_the_target(name, reference):
    wire = made_up()
    angles = seen_as_it_is(controller(name, wire), wire, reference, 40.0)
    assert abs(angles[-1] - reference) < 0.3


@NAMES
def test_what_reads_the_sensor_makes_up_for_a_warmer_ambient(name):
    wire = made_up()
    if name == "feedforward":
        pytest.skip("open loop reads no sensor")
    angles = seen_as_it_is(controller(name, wire), wire, 30.0, 90.0, bias=0.01)
    assert abs(angles[-1] - 30.0) < 0.6


@NAMES
@given(peak=st.floats(0.09, 0.16), share=st.floats(0.6, 1.0))
@settings(max_examples=15)
def test_taking_over_a_settled_wire_is_bumpless(name, peak, share):
    wire = made_up()
    found = wire.moved(wire.begin(peak), share * peak)
    law, current = controller(name, wire), math.sqrt(share * peak)
    state = law.begin(found.angle, current)
    first, _ = law.step(state, found.angle, found.angle)
    assert first**2 == pytest.approx(current**2, abs=0.1 * 0.16)
    angles = seen_as_it_is(law, wire, found.angle, 20.0, start=(found.angle, current))
    assert np.abs(angles - found.angle).max() < 1.5


@NAMES
@given(
    readings=st.lists(st.floats(-10, 80) | st.just(math.nan), min_size=1, max_size=40),
    reference=st.floats(-20, 90),
)
@settings(max_examples=25)
def test_no_controller_asks_for_more_than_its_limits(name, readings, reference):
    law = controller(name, made_up())
    state = law.begin()
    for reading in readings:
        current, state = law.step(state, reference, reading)
        assert 0.0 <= current <= 0.4
        assert state.applied == current


@NAMES
@given(readings=st.lists(st.floats(0, 60), min_size=1, max_size=10))
@settings(max_examples=15)
def test_a_step_is_pure(name, readings):
    law = controller(name, made_up())
    state = law.begin()
    for reading in readings:
        once, after = law.step(state, 30.0, reading)
        twice, again = law.step(state, 30.0, reading)
        assert once == twice
        assert law.step(after, 31.0, reading)[0] == law.step(again, 31.0, reading)[0]
        state = after


@NAMES
def test_a_lower_limit_is_kept(name):
    law = controller(name, made_up(), highest=0.3)
    current, _ = law.step(law.begin(), 50.0, 0.0)
    assert current == pytest.approx(0.3)


def test_heating_goes_by_the_inverse_of_operator_and_lag():
    wire = made_up(latent=0.0)
    state = wire.begin()
    target = wire.operator.track().aim(30.0)
    power = heating(wire, state, 30.0, response=2.0, ambient=0.01)
    assert power == pytest.approx(wire.lag * target / 2.0 - 0.01)
    gentle = heating(wire, state, 30.0, response=2.0, steepest=10 * 30.0 / target)
    assert gentle == pytest.approx(0.1 * wire.lag * target / 2.0)


def test_range_and_slope_are_those_of_the_operator():
    wire = made_up()
    assert width(wire) == pytest.approx(0.16)
    assert mean_slope(wire) == pytest.approx(60.0 / 0.16)


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"interval": 0.0}, "interval is 0.0 s"),
        ({"highest": 0.5}, "highest is 0.5 A; give 1e-06 to 0.4 A"),
        ({"highest": math.nan}, "highest is nan"),
        ({"delay": -1}, "delay is -1"),
        ({"delay": 1.5}, "delay is 1.5"),
    ],
)
def test_clocks_and_limits_out_of_range_are_refused(option, message):
    with pytest.raises(ParameterError, match=message):
        Loop(**option)


@pytest.mark.parametrize(
    ("name", "option"),
    [
        ("observer", {"response": 0.0}),
        ("observer", {"correction": 1e3}),
        ("observer", {"steepness": -1.0}),
        ("feedforward", {"response": math.inf}),
        ("internal_model", {"lag": 0.0}),
        ("pi", {"proportional": -0.1}),
        ("pi", {"integral": 2.0}),
        ("pi", {"nonsense": 1.0}),
    ],
)
def test_gains_out_of_range_are_refused(name, option):
    with pytest.raises(ParameterError):
        controller(name, made_up(), **option)


def test_an_unknown_controller_is_refused():
    with pytest.raises(ParameterError, match="give one of 'observer'"):
        controller("best", made_up())
