import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.head.geometry import Mount, Pinhole, wall_point
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.hold import PointHold
from minorloop.head.vision.servo import Cone, Servo

CAMERA = CalibratedCamera(Pinhole(), Mount(), np.zeros((3, 3)))
HOLD = PointHold(servo=Servo(CAMERA, cone=Cone(half=np.radians(40))), lead=0.0)
AIM = np.radians([22.0, 8.0])


def seen(angles):
    """Pixel of the point that is in the middle at AIM."""
    pose = CAMERA.mount.pose(*AIM)
    ray = pose.rotation[:, 2]
    along = np.roots([ray[:2] @ ray[:2], 2 * pose.position[:2] @ ray[:2],
                      pose.position[:2] @ pose.position[:2] - 1e-4]).max()  # fmt: skip
    point = pose.position + along * ray
    assert np.hypot(*point[:2]) == pytest.approx(10e-3)
    phi = np.arctan2(point[1], point[0])
    camera = CAMERA.mount.pose(*angles).to_camera(wall_point(phi, point[2], 10e-3))
    return CAMERA.lens.project(camera)


def test_a_still_point_is_sent_to_the_middle():
    state = HOLD.begin(AIM + np.radians([3.0, -2.0]))
    joints = AIM + np.radians([3.0, -2.0])
    for _ in range(60):
        step, state = HOLD.step(state, seen(joints), joints)
        joints = step.angles
    np.testing.assert_allclose(joints, AIM, atol=1e-5)


def test_a_sway_is_predicted():
    """The angles that are wanted go ahead of the sway by the lead."""
    hold = PointHold(servo=HOLD.servo, lead=0.3)
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


def test_a_lost_point_is_waited_for_where_it_was():
    state = HOLD.begin(AIM)
    for _ in range(50):
        step, state = HOLD.step(state, None, AIM)
    np.testing.assert_allclose(step.angles, AIM, atol=1e-9)
    assert step.verdict == "no target"


@pytest.mark.parametrize("option", [{"lead": -1.0}, {"share": 0.0}, {"patience": 99.0}])
def test_numbers_out_of_range_are_refused(option):
    with pytest.raises(ParameterError, match="give"):
        PointHold(servo=HOLD.servo, **option)
