import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wires import TICK, made_up

powers = st.floats(0.0, 0.16)


def finely(wire, power, seconds, *, ambient=0.0, cooling=1.0, step=0.002):
    """Angle of a cold wire that is heated in explicit steps so short that they are exact."""
    tracker = wire.operator.track()
    w, y = 0.0, tracker.push(0.0)
    for _ in range(round(seconds / step)):
        gap = step * (power - cooling * (w - ambient))
        slope = (tracker.peek(w + 1e-7) - y) / 1e-7 if gap > 0 else 0.0
        w += gap / (wire.lag + wire.latent * slope)
        y = tracker.push(w)
    return y


def held(wire, power, seconds, **options):
    state = wire.begin()
    for _ in range(round(seconds / 0.04)):
        state = wire.step(state, power, 0.04, **options)
    return state


@pytest.mark.parametrize("seconds", [3.0, 5.0, 9.0])
def test_a_step_solves_the_heat_balance(seconds):
    wire = made_up()
    assert held(wire, 0.16, seconds).angle == pytest.approx(finely(wire, 0.16, seconds), abs=0.5)


def test_latent_heat_delays_the_motion():
    dry, wet = made_up(latent=0.0), made_up(latent=4e-3)
    assert held(wet, 0.16, 5.0).angle < held(dry, 0.16, 5.0).angle - 5.0


@given(power=powers, ambient=st.floats(-0.05, 0.05), cooling=st.floats(0.5, 5.0))
@settings(max_examples=20)
def test_the_effective_power_settles_at_the_balance_with_the_surroundings(power, ambient, cooling):
    wire = made_up()
    state = held(wire, power, 90.0, ambient=ambient, cooling=cooling)
    assert state.power == pytest.approx(power / cooling + ambient, abs=1e-4)


@given(peak=powers, share=st.floats(0.0, 1.0))
def test_the_state_after_a_rise_and_a_return_is_recovered(peak, share):
    wire = made_up()
    power = share * peak
    angle = wire.moved(wire.begin(peak), power).angle
    found = wire.found(power, angle)
    assert found.angle == pytest.approx(angle, abs=1e-6)
    assert found.power == power


def test_an_angle_that_the_power_does_not_explain_means_a_warmer_or_colder_wire():
    wire = made_up()
    found = wire.found(0.0, 30.0)
    assert found.angle == pytest.approx(30.0)
    assert found.power > 0.05


def test_no_wire_turns_faster_than_its_fastest_rate():
    wire = made_up()
    state, angles = wire.begin(), [0.0]
    for _ in range(300):
        state = wire.step(state, 0.16, TICK)
        angles.append(state.angle)
    most = wire.fastest * 0.16 * TICK
    assert 0.2 * most < np.diff(angles).max() <= most
