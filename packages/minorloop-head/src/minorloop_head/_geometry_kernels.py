"""Compiled loops of the geometry of the head: arrays in, arrays filled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from minorloop_head import distortion

distorted = njit(cache=True, nogil=True)(distortion.distorted)


@njit(cache=True, nogil=True)
def _turn(matrix, first, second, angle):
    """Multiply a (3, 3) matrix from the right by a rotation in the plane of two axes."""
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        a, b = matrix[k, first], matrix[k, second]
        matrix[k, first], matrix[k, second] = a * c + b * s, b * c - a * s


@njit(cache=True, nogil=True)
def pose(pan, tilt, lever, x, y, z, roll, squint, camera_roll):
    """Return rotation (3, 3) and position (3,) of a lens on a lever about the pivot (x, y, z)."""
    rotation = np.eye(3)
    _turn(rotation, 0, 1, roll)
    _turn(rotation, 2, 0, pan)
    _turn(rotation, 1, 2, tilt)
    _turn(rotation, 2, 0, squint)
    _turn(rotation, 0, 1, camera_roll)
    position = np.array([x, y, z])
    for k in range(3):
        position[k] += lever * rotation[k, 2]
    return rotation, position
