import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from minorloop.errors import RecordError
from minorloop_head.vision.hand_eye import fit_hand_eye
from minorloop_head.vision.lens_calibration import TargetPose

TURN, PLACE = Rotation.from_rotvec([0.4, -1.1, 2.0]), np.array([0.03, -0.05, 0.12])
"""Of the camera on the flange."""


def placed(rotation, position):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.as_matrix(), position
    return pose


def session(seed=1000, count=12, turn_sd=1e-3, place_sd=1e-4, axes=3):
    """Poses of the target in the camera, and of the flange in the base, both with errors."""
    rng = np.random.default_rng(seed)
    target = placed(Rotation.from_rotvec([0.2, 2.9, 0.3]), [0.5, 0.1, 0.0])
    mounted = placed(TURN, PLACE)
    poses, flange = [], []
    for number in range(count):
        way = rng.uniform(-0.5, 0.5, 3) * (np.arange(3) < axes)
        seen = placed(Rotation.from_rotvec(way), [*rng.uniform(-0.02, 0.02, 2), 0.2])
        flange.append(target @ np.linalg.inv(mounted @ seen))
        off = Rotation.from_rotvec(rng.normal(0, turn_sd, 3)).as_matrix()
        place = seen[:3, 3] + rng.normal(0, place_sd, 3)
        name = f"{number}.png"
        poses.append(TargetPose(name, off @ seen[:3, :3], place, np.eye(6), np.zeros((1, 2))))
    return poses, np.array(flange)


def test_the_camera_on_a_flange_is_found_within_its_uncertainty():
    off = []
    for seed in range(1000, 1020):
        found = fit_hand_eye(*session(seed))
        turn, place = np.degrees(TURN.as_rotvec()), 1e3 * PLACE
        true = np.concatenate([place, turn])
        off += [abs(each.value - value) / each.sd for each, value in zip(found, true, strict=True)]
        assert np.abs([each.value for each in found[:3]] - place).max() < 0.5
    assert np.mean(np.array(off) < 3) >= 0.95
    assert np.mean(np.array(off) < 1) < 0.85  # they are not too wide either


def exchanged():
    poses, flange = session()
    return poses, flange[::-1]


@pytest.mark.parametrize(
    ("poses", "sentence"),
    [
        (session(count=3), "3 pictures with a target at known poses of the flange; give 4"),
        (session(axes=1), "turned about one axis only"),
        (exchanged(), "camera and flange turned differently"),
    ],
    ids=["few", "one axis", "order"],
)
def test_what_does_not_determine_the_mount_is_refused(poses, sentence):
    with pytest.raises(RecordError, match=sentence):
        fit_hand_eye(*poses)
