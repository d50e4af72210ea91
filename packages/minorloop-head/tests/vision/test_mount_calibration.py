import numpy as np

from minorloop_head.geometry import Mount, rotation_z
from minorloop_head.procedures.calibrate import mount_doubts
from minorloop_head.vision.lens_calibration import target_pose
from minorloop_head.vision.mount_calibration import fit_mount

from .sighted_targets import LENS, MIDDLE, seen

MOUNT = Mount(lever=7.5e-3, offset=(0.4e-3, -0.6e-3), roll=0.2)
STRAIGHT, ROLL = np.array([31.5, 28.7]), 2.0
ANGLES = [(pan, tilt) for pan in (-15, -5, 5, 15) for tilt in (-12, 0, 12)]
CORNER = np.array([0.0, 0.0, 0.04]) - MIDDLE


def measured(angles=ANGLES, noise=0.1, mount=MOUNT):
    """Poses of a target on the axis of the pipe, and the read angles."""
    poses, rng = [], np.random.default_rng(1000)
    for number, (pan, tilt) in enumerate(angles):
        pose = mount.pose(*np.radians([pan, tilt]))
        turn = (pose.rotation @ rotation_z(np.radians(ROLL))).T
        picture = seen(f"{number}.png", turn, turn @ (CORNER - pose.position))
        poses.append(target_pose(LENS, picture, 0.07))
    return poses, np.array(angles) + STRAIGHT + rng.normal(0, noise, (len(angles), 2))


def test_a_mount_is_found_within_its_uncertainty():
    fit = fit_mount(*measured(), middle=MIDDLE[:2])
    found = {each.name: each for each in fit.measured}
    true = {
        "lever": 7.5, "lens right of the axis": 0.0, "lens below the axis": 0.0,
        "tilt axis before the pan axis": 0.0, "tilt where level": 28.7, "squint": 0.0,
        "camera roll": 2.0, "pan where straight": 31.5, "roll of the base": np.degrees(0.2),
        "lean of the base": 0.0, "pivot right of the axis": 0.4, "pivot below the axis": -0.6,
        "target before the pivot": 40.0,
    }  # fmt: skip
    assert found.keys() == true.keys()
    for name, value in true.items():
        assert abs(found[name].value - value) < 3.5 * found[name].sd, name
        if found[name].unit == "deg":
            assert abs(found[name].value - value) < 0.3, name
    assert abs(fit.lever - MOUNT.lever) < 0.2e-3
    assert np.abs(fit.joints).max() < 0.4


def doubts(change):
    poses, joints = measured()
    names = [f"{number}.png" for number in range(len(poses))]
    return mount_doubts(fit_mount(poses, change(joints)), names, 0.1)


def test_angles_that_contradict_the_pictures_are_doubted():
    assert doubts(lambda joints: joints) == ()
    (scaled,) = doubts(lambda joints: joints * [1.1, 1.0])
    assert "the mount is not to be trusted" in scaled
    one = np.zeros((len(ANGLES), 2))
    one[5, 0] = 3.0
    (said,) = doubts(lambda joints: joints + one)
    assert "most in 5.png (" in said
