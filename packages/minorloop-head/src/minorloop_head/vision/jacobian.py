"""Motion of the image of a point as the head turns: the interaction matrix of pan and tilt.

Points are in normalised coordinates (X, Y), without distortion, x right, y down, z ahead, and
velocities are those of the camera in its own frame. Chaumette and Hutchinson, Visual servo
control I, 2006, equation (11), gives the columns. A head that pans about an axis of the base also
turns about its own optical axis, and its lens moves with it, so that all six columns are needed.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import body_rates, meet_wall
from minorloop_head.vision.calibrated_camera import CalibratedCamera

_LEAST_SHARE = 1e-3
"""Smallest over largest singular value, below which a Jacobian counts as singular."""


def _rotation_columns(point: npt.ArrayLike) -> FloatArray:
    """Return (2, 3) rates of a (2,) point for angular velocities of 1 rad/s about x, y, z."""
    x, y = np.asarray(point, dtype=np.float64)
    return np.array([[x * y, -(1 + x * x), y], [1 + y * y, -x * y, -x]])


def translation_columns(point: npt.ArrayLike, depth: float) -> FloatArray:
    """Return (2, 3) rates of a (2,) point at a depth in metres for 1 m/s along x, y, z.

    Raises a `ParameterError` if the depth is not positive; it may be infinite.
    """
    if not depth > 0:
        raise ParameterError(f"a point at depth {depth} m is not in front of the camera")
    x, y = np.asarray(point, dtype=np.float64)
    return np.array([[-1.0, 0.0, x], [0.0, -1.0, y]]) / depth


def pan_tilt_jacobian(
    point: npt.ArrayLike,
    tilt: float,
    *,
    lever: float = 0.0,
    depth: float = math.inf,
    camera: FloatArray | None = None,
) -> FloatArray:
    """Return (2, 2) rates of a point for 1 rad/s of pan and of tilt.

    Raises a `ParameterError` if the depth is not positive.

    ``point`` (2,): normalised coordinates. ``tilt``: of the head, in radians. ``lever``: from the
    pivot to the lens along the optical axis, in metres. ``depth``: of the point along the optical
    axis, in metres; without it, the lever does not matter. ``camera`` (3, 3): rotation from the
    camera to the joints, see `Mount.camera`; none without it.
    """
    # The velocity of the lens is the angular velocity crossed with the lever along z.
    carried = lever * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    columns = _rotation_columns(point) + translation_columns(point, depth) @ carried
    turns = body_rates(tilt)
    rates: FloatArray = columns @ (turns if camera is None else camera.T @ turns)
    return rates


def rates_for(jacobian: npt.ArrayLike, motion: npt.ArrayLike) -> FloatArray | None:
    """Return (2,) rates of pan and tilt that move a point by a (2,) motion; None if none do.

    With a tilt of a quarter turn, pan turns about the optical axis; a point in the middle of the
    image can then move in one direction only.
    """
    matrix = np.asarray(jacobian, dtype=np.float64)
    values = np.linalg.svd(matrix, compute_uv=False) if np.isfinite(matrix).all() else np.zeros(2)
    if not values[1] > _LEAST_SHARE * values[0]:
        return None
    return np.asarray(np.linalg.solve(matrix, np.asarray(motion, dtype=np.float64)))


def wall_depth(camera: CalibratedCamera, point: npt.ArrayLike, pan: float, tilt: float) -> float:
    """Return the depth of the wall at a (2,) point, along the optical axis, in metres.

    Raises a `ParameterError` if the lens is not inside the pipe at this pan and tilt.
    """
    pose = camera.mount.pose(pan, tilt)
    x, y = np.asarray(point, dtype=np.float64)
    return float(meet_wall(pose.position, pose.rotation @ np.array([x, y, 1.0]), camera.radius)[2])
