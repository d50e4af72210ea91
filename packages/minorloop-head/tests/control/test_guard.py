import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.control.guard import MOST_EVENTS, Guard
from minorloop_head.control.head import controller
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.observer import PowerObserver
from minorloop_head.twins.wire import Wire
from papers.catheter.control.laws import LAWS
from wires import EVERY_LAW, TICK, angle, identified, temperature

readings = st.one_of(
    st.floats(-60, 140),
    st.floats(allow_nan=True, allow_infinity=True),
    st.just(math.nan),
    st.just(20.0),
)
references = st.one_of(st.floats(-100, 200), st.floats(allow_nan=True, allow_infinity=True))
gaps = st.sampled_from([0.04, 0.04, 0.04, 0.0, -1.0, 3.0, math.nan, math.inf])


def guarded(name="observer", **options):
    wire = identified().model
    law = controller(LAWS[name], wire)
    if name == "observer":
        return Guard(observer=law, **options)
    return Guard(controller=law, observer=PowerObserver(wire=wire), **options)


def causes(state):
    return [event.cause for event in state.log]


def loop(guard, reference, seconds, *, spoil=lambda t, y: y, state=None, plant=None):
    """Run a guard on the twin of its model; return currents, state and plant."""
    state = guard.begin() if state is None else state
    plant = Wire(noise=0.05, seed=1) if plant is None else plant
    currents, seen = [], angle(plant)
    for k in range(round(seconds / TICK)):
        current, state = guard.step(state, reference, spoil(TICK * k, seen))
        seen = plant.exchange(current)
        currents.append(current)
    return np.array(currents), state, plant


@EVERY_LAW
@given(
    ticks=st.lists(st.tuples(readings, references, gaps), min_size=1, max_size=50),
    hottest=st.sampled_from([150.0, 90.0, 40.0]),
)
@settings(max_examples=25)
def test_the_limits_are_kept_for_any_readings_and_targets(name, ticks, hottest):
    guard = guarded(name, limits=WireLimits(hottest=hottest))
    state, t = guard.begin(), 0.0
    for reading, reference, gap in ticks:
        t += gap if math.isfinite(gap) else 0.0
        stamp = t if math.isfinite(gap) else gap
        before = guard.temperature(state)
        current, state = guard.step(state, reference, reading, t=stamp)
        assert 0.0 <= current <= 0.4
        # One more interval under this current does not lead beyond the limit.
        after = guard.step(state, reference, math.nan)[1]
        assert guard.temperature(after) <= max(hottest, before, guard.temperature(state)) + 1e-6
        assert len(state.log) <= MOST_EVENTS


@EVERY_LAW
def test_a_long_heating_stops_short_of_the_limit(name):
    guard = guarded(name, limits=WireLimits(hottest=80.0))
    _, state, _ = loop(guard, 55.0, 20.0)
    assert guard.temperature(state) <= 80.0 + 1e-9
    if name != "feedforward":
        assert "hot" in causes(state)


@EVERY_LAW
@pytest.mark.parametrize(("fault", "lasts"), [("lost", 0.2), ("stuck", 0.6)])
def test_a_sensor_at_fault_ends_in_cooling(name, fault, lasts):
    guard, last = guarded(name), [0.0]

    def spoil(t, y):
        if t < 4.0:
            last[0] = y
            return y
        return math.nan if fault == "lost" else last[0]

    currents, state, plant = loop(guard, 40.0, 12.0, spoil=spoil)
    assert state.fault == fault
    assert (currents[round((4.0 + lasts + 0.08) / 0.04) :] == 0.0).all()
    assert temperature(plant) < 50.0
    assert causes(state).count("sensor") == 1


def test_an_invalid_target_keeps_the_last_one():
    guard = guarded()
    _, state, plant = loop(guard, 30.0, 20.0)
    _, state, plant = loop(guard, math.nan, 5.0, state=state, plant=plant)
    assert state.reference == 30.0
    assert angle(plant) == pytest.approx(30.0, abs=0.5)
    assert causes(state).count("reference") == 1


def test_a_time_that_goes_back_is_logged_and_its_reading_is_not_used():
    guard = guarded()
    _, state = guard.step(guard.begin(), 20.0, 0.01, t=1.0)
    _, state = guard.step(state, 20.0, 50.0, t=0.5)
    assert state.clock.t == 1.0
    assert not state.reading.used
    assert "time went from 1 to 0.5 s" in state.log[-1].text


def test_after_a_gap_the_wire_is_as_warm_as_its_current_made_it():
    guard = guarded()
    wire = guard.observer.wire
    current, state = guard.step(guard.begin(), 40.0, 0.01, t=0.0)
    _, state = guard.step(state, 40.0, math.nan, t=3.0)
    expected = wire.begin()
    for _ in range(75):
        expected = wire.step(expected, current**2, 0.04)
    assert state.estimate.wire.power == pytest.approx(expected.power)
    assert "clock" in causes(state)


def test_a_target_beyond_the_stroke_is_held_near_the_end():
    guard = guarded()
    _, state, plant = loop(guard, 90.0, 25.0)
    assert state.unreachable.reason == "beyond the stroke"
    assert 50.0 < angle(plant) < 60.0
    _, state, plant = loop(guard, 30.0, 20.0, state=state, plant=plant)
    assert state.unreachable is None
    assert angle(plant) == pytest.approx(30.0, abs=0.5)


@pytest.mark.parametrize("jump", [1e4, -0.5])
def test_a_clock_that_was_set_is_accepted_after_some_seconds_not_before(jump):
    guard = guarded()
    state = guard.begin()
    for k in range(260):
        t = 0.04 * k + (jump if k >= 30 else 0.0)
        _, state = guard.step(state, 20.0, 0.01 * (k % 7), t=t)
        if k >= 30:
            assert (state.clock.t == t) == (k >= 154)
    assert state.clock.t == pytest.approx(0.04 * 259 + jump)
    assert state.fault == ""


@pytest.mark.parametrize("count", [3, 12])
def test_late_readings_are_not_used_and_no_time_is_counted_twice(count):
    guard, wire = guarded(), identified().model
    readings, state, powers = [], guard.begin(), []
    plant = wire.begin()
    for k in range(120):
        readings.append(plant.angle)
        late = 75 <= k < 75 + count
        at = k - 12 if late else k
        current, state = guard.step(state, 30.0, readings[at], t=0.04 * at)
        plant = wire.step(plant, current**2, 0.04)
        powers.append(state.estimate.wire.power - plant.power)
    assert np.abs(powers[70:]).max() < 0.01
    assert max(readings) < 31.0
    assert state.clock.t == pytest.approx(0.04 * 119)


def test_readings_that_stay_while_the_wire_is_heated_are_no_sign_of_the_surroundings():
    guard, rng = guarded(), np.random.default_rng(0)
    _, state, plant = loop(guard, 25.0, 14.0)

    def still(t, y):
        return 25.0 + 0.02 * rng.normal()

    currents, state, _ = loop(guard, 35.0, 20.0, state=state, plant=plant, spoil=still)
    assert "no motion at 25 degrees" in str(state.unreachable)
    assert "the sensor does not turn with it" in str(state.unreachable)
    assert currents[-1] == 0.0


def test_right_readings_after_late_ones_are_believed_again_once_the_wire_is_cold():
    guard, past = guarded(), []

    def late(t, y):
        past.append(y)
        return past[max(len(past) - 26, 0)] if 0.4 < t <= 1.6 else y

    _, state, plant = loop(guard, 45.0, 14.0)
    _, state, plant = loop(guard, 20.0, 6.0, state=state, plant=plant, spoil=late)
    _, state, plant = loop(guard, 45.0, 45.0, state=state, plant=plant)
    assert angle(plant) == pytest.approx(45.0, abs=1.0)
    assert state.fault == ""


@pytest.mark.parametrize(("name", "target"), [("observer", 10.0), ("internal_model", 40.0)])
def test_a_wire_whose_sensor_is_reversed_cools_and_the_log_says_why(name, target):
    angles = []

    def turned_round(t, y):
        angles.append(y)
        return -y

    currents, state, _ = loop(guarded(name), target, 12.0, spoil=turned_round)
    assert max(angles) < 6.0
    assert currents[-1] == 0.0
    assert state.fault == "reversed"
    said = [event.text for event in state.log if event.cause == "sensor"]
    assert len(said) == 1
    assert "the sign of the sensor is reversed, or the picture is mirrored" in said[0]
