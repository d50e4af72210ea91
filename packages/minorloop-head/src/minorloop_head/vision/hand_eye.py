"""Hand-eye calibration: how a camera is mounted on the flange of a robot, AX = XB.

The target stands still. With the poses F of the flange in the base, X of the camera on the flange,
C of the target in the camera and Z of the target in the base, F X C = Z in every picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop_head.vision.lens_calibration import TargetPose
from minorloop_head.vision.measured import Measured

_LEAST_POSES = 4
"""Fewest poses: three determine the 12 unknowns, and one more shows whether they agree."""
_LEAST_TURN = 10.0
"""Least turn about a second axis, in degrees: one axis leaves the place along it free."""
_LARGEST_MISFIT = 2.0
"""Largest rms difference between turns of camera and flange, in degrees."""


def fit_hand_eye(poses: Sequence[TargetPose], flange: FloatArray) -> tuple[Measured, ...]:
    """Return the pose of a camera on the flange: x, y, z in mm, and a rotation vector in degrees.

    Raises a `RecordError` if there are too few poses, the robot turned about one axis only, or the
    poses do not belong to the pictures.

    ``poses``: of a target that stands still; ``flange`` (N, 4, 4): poses of the flange in the base
    of the robot, in metres.

    References
    ----------
    Park and Martin, Robot sensor calibration: solving AX = XB on the Euclidean group, 1994, for
    the start; then least squares in all numbers, with the errors of turns and places estimated.
    """
    if len(poses) < _LEAST_POSES:
        raise RecordError(
            f"{counted(len(poses), 'picture')} with a target at known poses of the flange; give "
            f"{_LEAST_POSES} or more"
        )
    turns = np.asarray(flange, dtype=np.float64)[:, :3, :3]
    places = np.asarray(flange, dtype=np.float64)[:, :3, 3]
    seen = np.array([pose.rotation for pose in poses])
    away = np.array([pose.position for pose in poses])
    x = _start(turns, places, seen, away)

    def off(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        mounted, target = (Rotation.from_rotvec(x[k : k + 3]).as_matrix() for k in (0, 6))
        camera = turns @ mounted
        turned = np.swapaxes(camera, 1, 2) @ target @ np.swapaxes(seen, 1, 2)
        place = np.einsum("nji,nj->ni", camera, x[9:12] - turns @ x[3:6] - places)
        return Rotation.from_matrix(turned).as_rotvec(), place - away

    sds = np.ones(2)
    for _ in range(3):  # the errors of turns and places weight each other
        found = least_squares(
            lambda x, sds=sds: np.concatenate(  # type: ignore[misc]
                [(part / sd).ravel() for part, sd in zip(off(x), sds, strict=True)]
            ),
            x,
            x_scale=np.repeat([0.1, 0.01, 0.1, 0.01], 3),
        )
        x = found.x
        freedom = 1 - 12 / found.fun.size
        sds = np.array([np.sqrt((part**2).mean() / freedom) + 1e-12 for part in off(x)])
    jacobian = np.asarray(found.jac)
    spread = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)))
    parts = (
        ("camera on the flange", 3, 1e3, "mm"),
        ("turn of the camera on the flange", 0, float(np.degrees(1.0)), "deg"),
    )
    return tuple(
        Measured(f"{name} {axis}", scale * float(x[n]), scale * float(spread[n]), unit)
        for name, first, scale, unit in parts
        for n, axis in enumerate("xyz", first)
    )


def _start(turns: FloatArray, places: FloatArray, seen: FloatArray, away: FloatArray) -> FloatArray:
    """Return the unknowns (12,), after a check: poses of camera on flange and target in base."""
    pairs = list(combinations(range(len(turns)), 2))
    one, other = np.array(pairs).T
    moved = np.swapaxes(turns[one], 1, 2) @ turns[other]
    looked = seen[one] @ np.swapaxes(seen[other], 1, 2)
    hand, eye = (Rotation.from_matrix(each).as_rotvec() for each in (moved, looked))
    if np.degrees(np.linalg.svd(hand, compute_uv=False)[1] / len(pairs) ** 0.5) < _LEAST_TURN / 2:
        raise RecordError(
            "the flange turned about one axis only, or hardly; take pictures at poses that are "
            f"turned by {_LEAST_TURN:g} degrees and more about two axes"
        )
    mounted, misfit = Rotation.align_vectors(hand, eye)
    misfit = np.degrees(misfit / len(pairs) ** 0.5)
    if misfit > _LARGEST_MISFIT:
        raise RecordError(
            f"camera and flange turned differently, by {misfit:.2g} degrees rms; check the order "
            "of the pictures, the kind and unit of the angles, that the poses are of the flange in "
            "the base, and that the target stood still"
        )
    inner = mounted.as_matrix()
    # Motion of the flange and of the camera: (R_A - 1) t_X = R_X t_B - t_A.
    step = np.einsum("nji,nj->ni", turns[one], places[other] - places[one])
    shift = away[one] - np.einsum("nij,nj->ni", looked, away[other])
    rows = (moved - np.eye(3)).reshape(-1, 3)
    lens = np.linalg.lstsq(rows, (shift @ inner.T - step).ravel(), rcond=None)[0]
    target = Rotation.from_matrix(turns @ inner @ seen).mean()
    at = (places + np.einsum("nij,nj->ni", turns, lens + away @ inner.T)).mean(axis=0)
    return np.concatenate([mounted.as_rotvec(), lens, target.as_rotvec(), at])
