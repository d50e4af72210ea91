"""Where the head points, as the image of one point of the wall says it.

A head without sensors at its joints still has its camera: a piece of wall that stays where it is
tells, frame by frame, how the head has turned since the piece was picked.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.geometry import wall_point
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.jacobian import pan_tilt_jacobian, undo

_STEPS, _CLOSE, _WIDEST = 8, 1e-6, math.pi / 2


def sighted_angles(
    eye: CalibratedCamera, place: npt.ArrayLike, pixel: npt.ArrayLike, guess: npt.ArrayLike
) -> FloatArray | None:
    """(2,) pan and tilt in radians at which a place of the wall is seen at a pixel.

    Parameters
    ----------
    eye : CalibratedCamera
        The camera.
    place : (2,) array_like
        phi and z.
    pixel : (2,) array_like
        Column and row.
    guess : (2,) array_like
        Pan and tilt to begin from, in radians, such as those of the frame before.

    Returns
    -------
    (2,) array or None
        None where no angles near the guess show it there, or a number is not finite.

    Notes
    -----
    Newton's steps on the two normalised coordinates with the Jacobian of pan and tilt. An error
    of the angles at which the piece was picked stays in all later ones.
    """
    seen, angles = np.asarray(pixel, dtype=np.float64), np.asarray(guess, dtype=np.float64)
    where = np.asarray(place, dtype=np.float64)
    if not all(each.shape == (2,) and np.isfinite(each).all() for each in (seen, angles, where)):
        return None
    wanted = eye.lens.normalised(seen)
    point = wall_point(float(where[0]), float(where[1]), eye.radius)
    for _ in range(_STEPS):
        x, y, depth = eye.mount.pose(*angles.tolist()).to_camera(point)
        if not depth > 0:
            return None
        now = np.array([x, y]) / depth
        lever = eye.mount.lever
        jacobian = pan_tilt_jacobian(now, float(angles[1]), lever=lever, depth=float(depth))
        move = undo(jacobian, wanted - now)
        if move is None or not np.hypot(*move) < _WIDEST:
            return None
        angles = angles + move
        if np.hypot(*move) < _CLOSE:
            return angles
    return None
