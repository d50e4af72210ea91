import numpy as np
import pytest

from minorloop_head.geometry import Mount, Pinhole
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.servo import Cone, PointHold, Servo

CAMERA = CalibratedCamera(Pinhole(), Mount(), np.zeros((3, 3)))
HOLD = PointHold(servo=Servo(CAMERA, cone=Cone(half=np.radians(40))), lead=0.0)
AIM = np.radians([22.0, 8.0])


def seen(angles):
    """Pixel of the point that is in the middle at AIM."""
    return CAMERA.pixel(CAMERA.place(CAMERA.lens.centre, *AIM), *angles)


def test_a_sway_is_predicted():
    """The angles that are wanted go ahead of the sway by the lead."""
    hold = PointHold(servo=HOLD.servo, lead=0.3, integral_gain=0.0)
    state, wanted = hold.begin(AIM), []
    sway = np.radians(1.0) * np.sin(2 * np.pi * 0.3 * 0.04 * np.arange(400))
    for each in sway:
        base = np.array([each, 0.0])
        step, state = hold.step(state, seen(AIM + base), AIM)
        wanted.append(step.angles[0] - AIM[0])
    late = np.arange(150, 390)
    errors = [
        np.abs(np.array(wanted)[late] + np.interp(late + ahead, np.arange(400), sway)).max()
        for ahead in (0.0, 0.3 / 0.04)
    ]
    assert errors[1] < 0.7 * errors[0]


def followed(hold, seconds, *, off=(0.5, -0.3), bias=(0.0, 0.0), late=0, most=10.0):
    """Errors (T, 2) in radians of joints that go to their wanted angles late and with a bias.

    They turn by at most ``most`` degrees a second.
    """
    joints = AIM + np.radians(off)
    state, errors = hold.begin(joints), []
    asked = [joints] * (late + 1)
    for _ in range(round(seconds / 0.04)):
        step, state = hold.step(state, seen(joints + np.radians(bias)), joints)
        asked.append(step.angles)
        joints = joints + np.clip(
            asked[-1 - late] - joints, *np.radians([-0.04 * most, 0.04 * most])
        )
        errors.append(joints + np.radians(bias) - AIM)
    return np.array(errors)


@pytest.mark.parametrize("late", [0, 5, 9, 13])
def test_the_integral_removes_a_bias_at_any_delay_up_to_half_as_long_again(late):
    """The bias is one of where the head looks, which its joints do not show."""
    loop = {"bias": (0.3, -0.2), "late": late}
    held = followed(PointHold(servo=HOLD.servo), 20.0, **loop)
    assert np.abs(np.degrees(held[-50:])).max() < 0.01
    assert np.abs(np.degrees(held[100:])).max() < 0.4  # half of the first error after 4 s


def test_a_joint_that_does_not_follow_is_not_integrated():
    stuck = PointHold(servo=HOLD.servo)
    state = stuck.begin(AIM)
    joints = AIM + np.radians([1.0, 0.0])
    for _ in range(200):
        _, state = stuck.step(state, seen(joints), joints)
    assert np.abs(state.integral).max() < np.radians(0.2)
    freely = PointHold(servo=HOLD.servo, slip=np.pi)
    for _ in range(200):
        _, state = freely.step(state, seen(joints), joints)
    assert np.abs(state.integral).max() > np.radians(5)


def test_the_wanted_angles_turn_no_faster_than_the_rate_limit():
    hold = PointHold(servo=Servo(CAMERA, cone=Cone(half=np.radians(40)), rate_limit=0.1))
    joints = AIM + np.radians([5.0, -4.0])
    state, before = hold.begin(joints), joints
    for _ in range(15):
        step, state = hold.step(state, seen(joints), joints)
        assert np.hypot(*(step.angles - before)) <= 0.1 * 0.04 + 1e-12
        assert step.verdict == "at the rate limit"
        joints = before = step.angles
    assert np.abs(state.integral).max() == 0.0
