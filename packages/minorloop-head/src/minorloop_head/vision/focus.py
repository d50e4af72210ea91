"""Sharpness of a region of an image, and the peak of a focus sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray

SHARP, FLAT, AT_THE_END, NO_FRAMES = "sharp", "nothing to focus on", "at the end", "no frames"
"""Verdicts of a search."""

_DARK = 2.0
"""Grey level that is added before the logarithm, so that noise in the dark counts little."""
_LEAST_GAIN, _SCATTERS = 0.02, 3.0
"""A sweep has a peak if the logarithm of its sharpness bends by 2 % and three times its scatter."""
_NEAR_TOP = 0.75
"""Share of the greatest sharpness from which values belong to the top of the curve. A far wall is
sharp over most of a sweep: five values about the greatest one would follow their scatter."""


@dataclass(frozen=True, eq=False)
class FocusPeak:
    """The peak of a focus sweep."""

    distance: float
    """Focus distance at the peak, in metres."""
    curve: FloatArray
    """Shape (N, 2). Distances in metres, nearest first, and the sharpness of the region there."""
    verdict: str
    """``sharp``, ``nothing to focus on``, ``at the end`` of the sweep, or ``no frames`` if too few
    could be used; without a peak, the distance is the guess."""


def sharpness(image: Any, pixel: npt.ArrayLike, *, size: int = 96) -> float:
    """Return the mean squared slope of the logarithm about a pixel; NaN if too dark.

    Parameters
    ----------
    image : (height, width) array of uint8
    pixel : (2,) array_like
        Column and row of the centre of the region.
    size : int
        Side of the region in pixels; parts outside of the image are left out.

    Notes
    -----
    Slopes are taken over two pixels of means over three, which suppresses noise. A slope with a
    saturated pixel in its means is left out, as it is sharp at any focus. Tenenbaum, 1970. Each
    slope is relative to the brightness where it is: the nearer part of a wall that is seen at a
    slant is brighter, and would put the peak 7 % before the pixel.
    """
    u, v = np.asarray(pixel, dtype=np.float64)
    if not (isinstance(image, np.ndarray) and image.ndim == 2 and math.isfinite(u + v)):
        return math.nan
    half = size // 2
    top, left = max(round(v) - half, 0), max(round(u) - half, 0)
    part = image[top : max(round(v) + half, 0), left : max(round(u) + half, 0)].astype(np.float64)
    if min(part.shape) < 8:
        return math.nan
    smooth = _means(part)
    down = smooth[2:, 1:-1] - smooth[:-2, 1:-1]
    across = smooth[1:-1, 2:] - smooth[1:-1, :-2]
    dull = _means(_means(part == 255)) == 0
    level = float(part.mean())
    if level < 2 or dull.mean() < 0.25:
        return math.nan
    here = 2 * (smooth[1:-1, 1:-1] + _DARK)
    return float(((down**2 + across**2) / here**2)[dull].mean())


def peak_of(curve: FloatArray, guess: float, least: int) -> FocusPeak:
    """Find the peak of a sweep: that of a parabola through the top of the curve.

    Parameters
    ----------
    curve : (N, 2) array
        Distances in metres, nearest first, and sharpness; NaN where unknown.
    guess : float
        Distance without a peak, in metres.
    least : int
        Least number of known values.
    """
    known = curve[np.isfinite(curve[:, 1])]
    if len(known) < least:
        return FocusPeak(guess, curve, NO_FRAMES)
    inverse, sharp = 1 / known[:, 0], known[:, 1]
    if not _curved(inverse, np.log(sharp)):
        return FocusPeak(guess, curve, FLAT)
    best = int(sharp.argmax())
    first = int(np.clip(best - 2, 0, len(sharp) - 5))
    upper = np.flatnonzero(sharp > _NEAR_TOP * sharp[best])
    near = slice(min(first, int(upper[0])), max(first + 5, int(upper[-1]) + 1))
    a, b, _ = np.polyfit(inverse[near] - inverse[best], np.log(sharp[near]), 2)
    top = inverse[best] - b / (2 * a) if a < 0 else inverse[best]
    top = float(np.clip(top, inverse.min(), inverse.max()))
    return FocusPeak(1 / top, curve, SHARP if 0 < best < len(sharp) - 1 else AT_THE_END)


def _curved(inverse: FloatArray, level: FloatArray) -> bool:
    """Return whether a curve bends by more than it scatters."""
    fitted = np.polyval(np.polyfit(inverse - inverse.mean(), level, 2), inverse - inverse.mean())
    return bool(np.ptp(fitted) > _LEAST_GAIN + _SCATTERS * np.std(level - fitted))


def _means(part: npt.NDArray[Any]) -> FloatArray:
    """Return means over three rows and three columns."""
    rows = part[:-2] + part[1:-1].astype(np.float64) + part[2:]
    means: FloatArray = (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9
    return means
