import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from minorloop_head.console.head_pose import (
    HeadPoseMap,
    HeadPoseState,
    gaze,
    into_cone,
    jumped,
    turn,
)

TICK = 0.04
HOW = HeadPoseMap()
angles = st.floats(-1.4, 1.4)
cones = st.floats(0.02, 0.78)
pairs = st.tuples(st.floats(-4, 4), st.floats(-4, 4))
quaternions = (
    st.tuples(*(st.floats(-1, 1),) * 4)
    .filter(lambda q: math.hypot(*q) > 0.6)
    .map(lambda q: tuple(x / math.hypot(*q) for x in q))
)


def looking(yaw, pitch, roll=0.0, before=None):
    """Pose of a head that is turned right by yaw, then up by pitch, in radians."""
    r = Rotation.from_euler("YXZ", [-yaw, pitch, roll])
    return tuple((r if before is None else Rotation.from_quat(before) * r).as_quat().tolist())


def settle(state, pose, ticks=400, how=HOW):
    for _ in range(ticks):
        state = gaze(how, state, pose, TICK)
    return state


@given(angles, angles, angles, quaternions)
def test_yaw_and_pitch_are_those_that_the_head_was_turned_by(yaw, pitch, roll, reference):
    found = turn(reference, looking(yaw, pitch, roll, before=reference))
    assert found == pytest.approx((yaw, pitch), abs=1e-6)


@given(pairs, cones)
def test_saturation_keeps_the_direction(wish, cone):
    kept = into_cone(wish, cone)
    assert math.hypot(*kept) <= cone * (1 + 1e-12)
    assert kept[0] * wish[1] == pytest.approx(kept[1] * wish[0], abs=1e-6)
    assert kept[0] * wish[0] + kept[1] * wish[1] >= 0


@given(st.lists(st.tuples(st.none() | quaternions, st.booleans()), max_size=40), cones)
def test_no_pose_leads_out_of_the_cone(steps, cone):
    how, state = HeadPoseMap(cone=cone), HeadPoseState()
    for pose, clutch in steps:
        after = gaze(how, state, pose, TICK, clutch=clutch)
        assert math.hypot(*after.command) <= cone * (1 + 1e-12)
        change = np.subtract(after.command, state.command)
        # What is brought back into the cone may move a little further along its radius.
        assert np.abs(change).max() <= 2 * HOW.heating * TICK + 1e-9
        state = after


@given(quaternions, quaternions, st.integers(0, 20))
def test_clutch_does_not_jump_wherever_the_head_went(before, after, ticks):
    state = settle(HeadPoseState(), before, 1)
    state = settle(state, looking(0.2, -0.12, before=before), 30)
    pressed = gaze(HOW, state, before, TICK, clutch=True)
    assert pressed.command == state.command
    for _ in range(ticks):
        pressed = gaze(HOW, pressed, after, TICK, clutch=True)
    released = settle(pressed, after, 50)
    assert released.command == pytest.approx(state.command, abs=1e-9)


def test_a_turn_by_the_reach_goes_to_the_edge_less_the_dead_band():
    state = settle(settle(HeadPoseState(), looking(0, 0), 1), looking(HOW.reach, 0.0))
    assert np.degrees(state.command) == pytest.approx((30.0 * 44 / 45, 0.0), abs=1e-3)


def test_a_head_behind_which_something_happens_is_unwrapped_and_one_that_comes_round_is_not():
    state = HeadPoseState()
    for yaw in np.arange(0.0, 4.0, 0.1):
        state = gaze(HOW, state, looking(yaw, 0.0), TICK)
    assert state.turned[0] == pytest.approx(3.9)  # over the right shoulder, at the same edge
    assert state.command[0] > 0
    for yaw in np.arange(4.0, 2 * math.pi + 0.35, 0.05):
        state = gaze(HOW, state, looking(yaw, 0.0), TICK)
    state = settle(state, looking(0.3, 0.0))
    assert state.command == pytest.approx(
        settle(settle(HeadPoseState(), looking(0, 0), 1), looking(0.3, 0.0)).command, abs=1e-3
    )


@pytest.mark.parametrize(
    ("degrees", "passed", "believed"),
    [(29, 0.001, True), (31, 0.017, False), (39, 0.04, True), (70, 0.04, False), (90, 0.1, True)],
)
def test_a_turn_that_no_neck_makes_is_a_jump(degrees, passed, believed):
    assert jumped(looking(0, 0), looking(math.radians(degrees), 0), passed) is not believed


@given(st.tuples(*(st.floats(-0.2, 0.2),) * 4))
def test_what_is_no_pose_moves_nothing(numbers):
    state = settle(HeadPoseState(), looking(0, 0), 1)
    assert gaze(HOW, state, numbers, TICK) == state
