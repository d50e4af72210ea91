import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop_head.control.controller import heating
from minorloop_head.control.head import controller
from minorloop_head.twins.wire import Wire
from papers.catheter.control.laws import LAWS
from wires import EVERY_LAW, angle, identified, made_up


def driven(law, reference, seconds):
    """True angles of a twin in a loop with one step of delay."""
    plant = Wire(noise=0.05, seed=1)
    state, seen, angles = law.begin(), angle(plant), []
    for _ in range(round(seconds / law.interval)):
        current, state = law.step(state, reference, seen)
        seen = plant.exchange(current)
        angles.append(angle(plant))
    return np.array(angles)


@EVERY_LAW
@pytest.mark.parametrize("reference", [15.0, 45.0])
def test_every_controller_brings_the_wire_to_the_target(name, reference):
    angles = driven(controller(LAWS[name], identified().model), reference, 40.0)
    assert abs(angles[-1] - reference) < (1.5 if name == "feedforward" else 0.3)


@EVERY_LAW
@given(peak=st.floats(0.09, 0.16), share=st.floats(0.6, 1.0))
@example(peak=0.12473, share=0.98107)  # a return so short that it is nearly a rise alone
@settings(max_examples=15)
def test_a_settled_wire_is_taken_over_with_its_current(name, peak, share):
    wire = made_up()
    found = wire.moved(wire.begin(peak), share * peak)
    law, current = controller(LAWS[name], wire), math.sqrt(share * peak)
    first, _ = law.step(law.begin(found.angle, current), found.angle, found.angle)
    assert first**2 == pytest.approx(current**2, abs=0.01 * 0.16)


@EVERY_LAW
@given(
    readings=st.lists(st.floats(-10, 80) | st.just(math.nan), min_size=1, max_size=40),
    reference=st.floats(-20, 90),
)
@settings(max_examples=25)
def test_no_controller_requests_more_than_its_limits(name, readings, reference):
    law = controller(LAWS[name], made_up())
    state = law.begin()
    for reading in readings:
        current, state = law.step(state, reference, reading)
        assert 0.0 <= current <= 0.4
        assert state.applied == current


def test_heating_goes_by_the_inverse_of_operator_and_lag():
    wire = made_up(latent=0.0)
    state = wire.begin()
    target = wire.operator.track().aim(30.0)
    power = heating(wire, state, 30.0, response=2.0, ambient=0.01)
    assert power == pytest.approx(wire.lag * target / 2.0 - 0.01)
    gentle = heating(wire, state, 30.0, response=2.0, steepest=10 * 30.0 / target)
    assert gentle == pytest.approx(0.1 * wire.lag * target / 2.0)


@pytest.mark.parametrize(
    ("law", "options", "complaint"),
    [
        ("observer", {"response": 0.0}, "response"),
        ("observer", {"correction": 1e3}, "correction"),
        ("observer", {"steepness": -1.0}, "steepness"),
        ("best", {}, "give one of 'observer'"),
        ("observer", {"gain": 1.0}, r"'observer' has no option 'gain'; give .*response"),
    ],
)
def test_unknown_controllers_and_options_out_of_range_are_refused(law, options, complaint):
    with pytest.raises(ParameterError, match=complaint):
        controller(law, made_up(), **options)
