"""Search for the round outline about a pixel that was picked by hand and is some pixels off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.vision import _outline_kernels as kernels
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Window, unroll
from minorloop_head.vision.reflectance_map import LitFrame, aligned

_TEXEL = 0.05e-3
_AROUND = 1.7e-3
"""Metres of wall that a fit needs beyond the reach: 1.9 times the largest radius, and a margin."""
_RADII = (0.35e-3, 0.65e-3)
"""Initial radii of an outline in metres, as in ``candidates``."""
_STARTS = 0.15e-3
"""Distance of the initial places of an outline: it finds an edge from three texels off."""
_LEAST_SHARE, _LEAST_CONTRAST = 0.6, 0.06
"""Least share of rays with their edge on the outline, and contrast (natural logarithm) that all but
a quarter of them must have. By trial on walls without a hole."""
CLICKED, FOUND = 1.6e-3, 0.6e-3
"""Largest distance in metres of the middle of an outline from a clicked pixel, and from a place
that another view gave. A click is off by 5 pixels of 10 per millimetre of oblique wall, a third of
it; in missions 1000 to 1019 a place of another view is off by up to 0.10 mm, and on walls of a path
tracer by up to 0.21 mm."""
_FAR = 0.3
"""Extra quality that an outline at the end of the reach needs over one at the picked point."""
_DIM = 4.0


@dataclass(frozen=True, eq=False)
class Outline:
    """A round outline."""

    place: FloatArray
    """Shape (2,). Phi and z of its middle."""
    pixel: FloatArray
    """Shape (2,). Pixel of its middle, in the last frame."""
    diameter: float
    """In metres."""
    quality: float
    """Quality: share of rays with their edge there, less the scatter, plus the steepness."""


def outline_about(
    frames: Sequence[LitFrame],
    camera: CalibratedCamera,
    pixel: npt.ArrayLike,
    *,
    reach: float = CLICKED,
) -> Outline | None:
    """Return the best round outline near a pixel of the last frame.

    It is None if nothing round is there.

    ``frames``: of one place; under several lights, reflections and shadows leave no edge. Frames
    without light are left out. ``pixel`` (2,). ``reach``: largest distance of the middle of the
    outline from the pixel, in metres along the wall.
    """
    frames = aligned(frames, camera)
    last = frames[-1]
    place = camera.place(pixel, last.pan, last.tilt)
    lit = [frame for frame in frames if any(frame.lights)]
    if not lit or not np.isfinite(place).all():
        return None
    half = round((reach + _AROUND) / _TEXEL)
    count = 2 * half + 1
    corner = float(place[0]) - half * _TEXEL / camera.radius, float(place[1]) - half * _TEXEL
    window = Window(*corner, _TEXEL, count, count)
    stack = np.stack([unroll(frame.image, camera, window, frame.pan, frame.tilt) for frame in lit])
    stack = np.log(stack + _DIM)
    least, most = (radius / _TEXEL for radius in _RADII)
    best, found = -np.inf, None
    fit = np.empty(kernels.OUT)
    steps = np.arange(-reach, reach + _STARTS / 2, _STARTS) / _TEXEL
    for dx in steps:
        for dy in steps:
            if np.hypot(dx, dy) * _TEXEL > reach:
                continue
            for sign in (1.0, -1.0):
                kernels.outline(stack, half + dx, half + dy, sign, least, most, fit)
                if not _round(fit):
                    continue
                off = np.hypot(fit[0] - half, fit[1] - half) * _TEXEL / reach
                quality = float(fit[6] - fit[5] + fit[15])
                if off <= 1.0 and quality - _FAR * off > best:
                    best = quality - _FAR * off
                    found = (*fit[:3].tolist(), quality)
    if found is None:
        return None
    x, y, radius, quality = found
    middle = window.place(x, y, camera.radius)
    where = np.asarray(camera.pixel(middle, last.pan, last.tilt))
    return Outline(middle, where, 2 * _TEXEL * radius, quality)


def _round(fit: FloatArray) -> bool:
    """Return whether an outline has an edge all round."""
    low, high = (radius / _TEXEL for radius in _RADII)
    return bool(
        np.isfinite(fit).all()
        and 0.7 * low < fit[2] < 1.3 * high
        and fit[6] > _LEAST_SHARE
        and fit[8] > _LEAST_CONTRAST
    )
