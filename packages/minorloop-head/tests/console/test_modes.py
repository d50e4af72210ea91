import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from console_rig import AHEAD, right
from minorloop_head.console.modes import (
    MODES,
    StickMap,
    TeleopConfig,
    TeleopState,
    TickInput,
    advance,
    push,
)

TICK = 0.04
CONFIG = TeleopConfig()
HERE = TickInput(pose=AHEAD, pose_age=0.0, link_age=0.0)


def run(state, inputs, ticks):
    for _ in range(ticks):
        state = advance(CONFIG, state, inputs, TICK)
    return state


def steered():
    """A state in HEAD, off the middle, the catheter on its way."""
    state = advance(CONFIG, TeleopState(), replace(HERE, request="HEAD"), TICK)
    state = run(state, replace(HERE, pose=right(20.0), stick=(1.0, 1.0)), 100)
    assert state.mode == "HEAD"
    assert state.command[0] > 0.17
    assert state.rates[0] > 5e-3
    return state


tick_inputs = st.builds(
    TickInput,
    request=st.sampled_from((None, *MODES)),
    pose=st.one_of(st.none(), st.floats(-180, 180).map(right)),
    pose_age=st.floats(0, 0.3),
    link_age=st.floats(0, 0.3),
    stick=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    clutch=st.booleans(),
    servo=st.one_of(st.none(), st.tuples(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9))),
    scan=st.one_of(
        st.none(),
        st.tuples(
            st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
            st.tuples(st.floats(-8e-3, 8e-3), st.floats(-0.7, 0.7)),
        ),
    ),
)


@given(st.lists(tick_inputs, max_size=60))
def test_whatever_is_given_nothing_jumps(all_inputs):
    state = TeleopState()
    for each in all_inputs:
        after = advance(CONFIG, state, each, TICK)
        moved = math.dist(after.command, state.command)
        assert moved <= 2 * math.sqrt(2) * CONFIG.gaze.heating * TICK + 1e-9
        assert math.hypot(*after.command) <= CONFIG.gaze.cone * (1 + 1e-12)
        if after.mode != state.mode and after.mode not in ("TRACK", "SCAN"):
            assert after.command == state.command
        if after.mode == "HOLD":
            assert after.rates == (0.0, 0.0)
            assert after.command == state.command
        state = after


@given(st.lists(tick_inputs, max_size=60))
def test_nothing_moves_for_a_page_that_is_silent(all_inputs):
    state = TeleopState()
    for each in all_inputs:
        state = advance(CONFIG, state, replace(each, link_age=math.inf), TICK)
        assert state.mode == "HOLD"
        assert state.command == (0.0, 0.0)


@given(st.floats(-180, 180), st.booleans())
def test_in_track_the_operators_head_does_nothing(yaw, clutch):
    state = advance(CONFIG, steered(), replace(HERE, request="TRACK", servo=(0.0, 0.0)), TICK)
    before = state.command
    state = run(state, replace(HERE, pose=right(yaw), clutch=clutch, servo=(0.0, 0.0)), 25)
    assert state.mode == "TRACK"
    assert state.command == before


@pytest.mark.parametrize("lost", [{"pose_age": 0.11}, {"pose": None}, {"link_age": 0.11}])
def test_a_loss_holds_and_continues_only_on_request_without_a_jump(lost):
    before = steered()
    state = advance(CONFIG, before, replace(HERE, **lost), TICK)
    assert (state.mode, state.rates, state.command) == ("HOLD", (0.0, 0.0), before.command)
    assert state.reason
    back = run(state, replace(HERE, pose=right(-60)), 20)
    assert back == state
    again = advance(CONFIG, back, replace(HERE, pose=right(-60), request="HEAD"), TICK)
    again = run(again, replace(HERE, pose=right(-60)), 20)
    assert (again.mode, again.reason, again.command) == ("HEAD", "", before.command)


def test_a_lost_pose_does_not_end_track():
    state = advance(CONFIG, steered(), replace(HERE, request="TRACK", servo=(0.0, 0.0)), TICK)
    assert run(state, replace(HERE, pose=None, servo=(0.0, 0.0)), 50).mode == "TRACK"


def test_a_target_out_of_sight_ends_track_after_a_while():
    state = advance(CONFIG, steered(), replace(HERE, request="TRACK", servo=(0.0, 0.0)), TICK)
    assert run(state, HERE, 14).mode == "TRACK"
    state = run(state, HERE, 18)
    assert state.mode == "HOLD"
    assert "lost from sight" in state.reason


def test_track_without_a_target_is_refused():
    state = advance(CONFIG, steered(), replace(HERE, request="TRACK"), TICK)
    assert state.mode == "HOLD"
    assert "pick one" in state.reason


deflections = st.floats(-1, 1)
maps = st.builds(StickMap, dead_band=st.floats(0, 0.5), expo=st.floats(0, 1))


@given(maps, deflections, deflections)
def test_more_deflection_is_never_less_rate(how, one, other):
    low, high = sorted((one, other))
    assert how.shaped(low) <= how.shaped(high) + 1e-12


@given(maps, st.floats(allow_nan=True, allow_infinity=True))
def test_no_number_asks_for_more_than_the_full_rate(how, deflection):
    assert -1 <= how.shaped(deflection) <= 1


@given(st.lists(st.one_of(st.none(), st.tuples(deflections, deflections)), max_size=50))
def test_the_catheter_never_goes_off_with_a_jerk(pushes):
    how, rates = StickMap(), (0.0, 0.0)
    for deflection in pushes:
        after = push(how, rates, deflection, TICK)
        if deflection is None:
            assert after == (0.0, 0.0)
        else:
            assert abs(after[0] - rates[0]) <= how.advance_acceleration * TICK + 1e-12
            assert abs(after[1] - rates[1]) <= how.roll_acceleration * TICK + 1e-12
        assert abs(after[0]) <= how.advance
        assert abs(after[1]) <= how.roll
        rates = after


def test_motors_stop_from_the_full_rate_in_time():
    how = StickMap()
    assert max(how.advance / 40e-3, how.roll / math.pi) <= 0.15 + 1e-12
