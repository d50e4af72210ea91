"""Turning the head until a point is where it is wanted."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from minorloop_head.geometry import Mount, Pinhole, wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.servo import Cone, Servo, rates_for

CAMERA = CalibratedCamera(
    Pinhole(k1=-0.12, k2=0.02), Mount(offset=(0.5e-3, -0.4e-3)), np.zeros((3, 3))
)
FAST = {"rate_limit": 1e3, "cone": Cone(1.5)}
MIDDLE = np.array(CAMERA.lens.centre)
places = st.tuples(st.floats(-3, 3), st.floats(22e-3, 40e-3))


def aim_near(place, off):
    """Angles from which a place of the wall is seen ``off`` radians beside the middle."""
    return np.array(CAMERA.mount.aim(wall_point(*place, 10e-3))) + off


def follow(servo, place, angles, steps, bias=(0.0, 0.0)):
    """Errors in pixels, and angles, with a head that obeys at once but for a bias."""
    state, errors, ways = servo.begin(angles), [], [np.array(angles)]
    for _ in range(steps):
        true = ways[-1] + bias
        pixel = CAMERA.pixel(np.array(place), *true)
        step, state = servo.step(state, pixel, ways[-1])
        ways.append(step.angles)
        errors.append(np.hypot(*(pixel - MIDDLE)))
    return np.array(errors), np.array(ways)


@settings(max_examples=12)
@given(place=places, a=st.floats(-0.15, 0.15), b=st.floats(-0.15, 0.15))
def test_the_error_decays_at_the_gain(place, a, b):
    servo = Servo(CAMERA, gain=1.0, **FAST)
    errors, _ = follow(servo, place, aim_near(place, (a, b)), 100)
    assume(errors[0] >= 2)
    # 4 s at 1/s; the law is exact only for small errors.
    assert errors[-1] < errors[0] * np.exp(-4) * 1.6
    assert (np.diff(errors) < 1e-9).all()


@given(
    angles=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    pixel=st.tuples(st.floats(0, 639), st.floats(0, 479)),
)
def test_the_cone_and_the_rate_are_never_passed(angles, pixel):
    servo = Servo(CAMERA, gain=2.0, rate_limit=0.3, cone=Cone(0.5))
    state = servo.begin(angles)
    for _ in range(30):
        before = state.angles
        step, state = servo.step(state, pixel)
        assert np.hypot(*step.angles) <= 0.5 + 1e-9
        assert np.hypot(*(step.angles - before)) <= 0.3 * 0.04 + 1e-12


def test_a_point_that_is_lost_leaves_the_head_where_it_is():
    servo = Servo(CAMERA)
    _, state = servo.step(servo.begin((0.1, 0.2)), (400.0, 240.0))
    for lost in (None, (np.nan, 3.0)):
        step, after = servo.step(state, lost)
        assert step.verdict == "no target"
        assert np.isnan(step.error)
        assert after is state
        assert_allclose(step.rates, 0)


def test_broken_angles_are_replaced_by_the_wanted_ones():
    servo = Servo(CAMERA)
    state = servo.begin((0.3, 0.2))
    step, _ = servo.step(state, (400.0, 240.0), (np.nan, 0.2))
    expected, _ = servo.step(state, (400.0, 240.0), (0.3, 0.2))
    assert_allclose(step.angles, expected.angles)


def test_a_quarter_turn_of_tilt_is_singular():
    servo = Servo(CalibratedCamera(CAMERA.lens, Mount(lever=1e-3), CAMERA.leds), cone=Cone(3.0))
    step, _ = servo.step(servo.begin((0.0, np.pi / 2)), CAMERA.lens.centre)
    assert step.verdict == "singular"
    assert_allclose(step.rates, 0)
    assert rates_for(np.full((2, 2), np.nan), (0.1, 0.1)) is None
