"""Estimate where the head points from the image of one point of the wall.

A head without joint sensors still has its camera: a fixed patch of the wall shows, frame by frame,
how the head has turned since the patch was picked.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.jacobian import pan_tilt_jacobian, rates_for

_STEPS, _CLOSE, _WIDEST = 8, 1e-6, math.pi / 2
"""Newton steps at most, length of the last one, and largest length of any, in radians."""


def sighted_angles(
    camera: CalibratedCamera, place: npt.ArrayLike, pixel: npt.ArrayLike, guess: npt.ArrayLike
) -> FloatArray | None:
    """Return (2,) pan and tilt in radians at which a place of the wall is seen at a pixel.

    It is None if no angles near the guess show it there, or a number is not finite.

    ``camera``: the camera; ``place`` (2,): phi and z; ``pixel`` (2,): column and row; ``guess``
    (2,): pan and tilt to begin from, in radians, such as those of the frame before.

    Notes
    -----
    Newton's method on the two normalised coordinates with the Jacobian of pan and tilt. An error
    of the angles at which the patch was picked stays in all later ones.
    """
    seen, angles = np.asarray(pixel, dtype=np.float64), np.asarray(guess, dtype=np.float64)
    where = np.asarray(place, dtype=np.float64)
    if not all(each.shape == (2,) and np.isfinite(each).all() for each in (seen, angles, where)):
        return None
    wanted = camera.lens.normalised(seen)
    point = wall_point(float(where[0]), float(where[1]), camera.radius)
    for _ in range(_STEPS):
        x, y, depth = camera.mount.pose(*angles.tolist()).to_camera(point)
        if not depth > 0:
            return None
        now = np.array([x, y]) / depth
        jacobian = pan_tilt_jacobian(
            now,
            float(angles[1]),
            lever=camera.mount.lever,
            depth=float(depth),
            camera=camera.mount.camera,
        )
        move = rates_for(jacobian, wanted - now)
        if move is None or not np.hypot(*move) < _WIDEST:
            return None
        angles = angles + move
        if np.hypot(*move) < _CLOSE:
            return angles
    return None
