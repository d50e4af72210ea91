"""Detection of a mark by the tool: a dark dot on the wall that an earlier picture does not show."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image, Window, unroll
from minorloop_head.vision.imaging import Image32

_TEXEL = 0.03e-3
"""Side of a texel in metres: a tenth of a mark, and a pixel in a near view."""
_RADIUS = 0.15e-3
"""Radius of a mark in metres."""
_REACH = 0.8e-3
"""Largest distance in metres of a mark from its expected place: more than twice the error of a
failed touch."""
_AROUND = 1.2e-3
"""Half of the side of the compared square of wall, in metres: it shows changes of the light."""
_DARKER = math.log(0.8)
"""Largest change of the logarithm of the grey level of a mark: noise is a quarter of it."""


def new_mark(
    camera: CalibratedCamera,
    expected: npt.ArrayLike,
    before: tuple[Image, FloatArray],
    after: tuple[Image, FloatArray],
) -> FloatArray | None:
    """Return phi and z (2,) of the dot that became dark near a place; None without one.

    ``expected`` (2,): phi and z; ``before`` and ``after``: pictures, and pan and tilt at each in
    radians.
    """
    phi, z = np.asarray(expected, dtype=np.float64).tolist()
    count = 2 * round(_AROUND / _TEXEL) + 1
    window = Window(phi - _AROUND / camera.radius, z - _AROUND, _TEXEL, count, count)
    old, new = (
        _greys(unroll(image, camera, window, *angles.tolist())) for image, angles in (before, after)
    )
    change = new - old
    known = np.isfinite(change)
    if known.mean() < 0.5:
        return None
    change = np.where(known, change - np.median(change[known]), 0.0)
    smooth = ndimage.gaussian_filter(change, _RADIUS / _TEXEL / 2)
    steps = (np.arange(count) - count // 2) * _TEXEL
    x, y = np.meshgrid(steps, steps)
    near = np.where(np.hypot(x, y) <= _REACH, smooth, 0.0)
    row, column = np.unravel_index(int(near.argmin()), near.shape)
    if not near[row, column] < _DARKER:
        return None
    about = np.hypot(x - steps[column], y - steps[row]) < 1.5 * _RADIUS
    weight = np.where(about, np.maximum(0.5 * smooth[row, column] - smooth, 0.0), 0.0)
    off = np.array([float((weight * each).sum()) for each in (x, y)]) / float(weight.sum())
    return np.array([phi, z]) + off / (camera.radius, 1.0)


def _greys(flat: Image32) -> Image32:
    """Return logarithms of grey levels, so that a change of the light is a sum."""
    return np.asarray(np.log(flat + np.float32(4.0)))
