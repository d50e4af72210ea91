"""Find the gaps of a record over which its input cannot have turned; there its memory continues."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.lab.noise import noise_of
from minorloop.lab.timebase import UNKNOWN

__all__ = ["between", "crossed"]

_FEWEST = 3
"""Least samples on each side of a gap that show how the input moves."""
_SURE = 6.0
"""Standard deviations of noise from which a reversal is one of the input."""
_FASTER, _SLOWER = 2.5, 0.5
"""Most and least speed across a gap, over the greater and the lesser of the speeds beside it. A
sine over half a period whose middle third is missing has twice the speed there; a ramp has the
same; an input that jumps in the gap is beyond the first, one that turns twice is below the second.
"""


def crossed(t: npt.ArrayLike, u: npt.ArrayLike, gaps: npt.ArrayLike) -> BoolArray:
    """Return which gaps the input crosses without turning, as far as both sides show.

    On each side, for as long as the gap, the input must be monotone but for its noise, in the
    direction in which it crosses the gap and with about that speed, or at rest. So a gap is short
    against the time between reversals there. None is crossed by an input whose noise hides
    reversals that change more than 0.5 % of the Preisach plane.

    Parameters
    ----------
    t, u : (T,) array_like
        Times in seconds, never decreasing, and inputs.
    gaps : (G,) array_like of int
        Samples after which a gap follows.

    Returns
    -------
    (G,) array of bool
    """
    times, inputs = np.asarray(t, np.float64), np.asarray(u, np.float64)
    places: IntArray = np.asarray(gaps, np.int64)
    least, span = _SURE * _noise(inputs), float(np.ptp(inputs))
    if not places.size or least**2 > UNKNOWN * span**2:
        return np.zeros(places.size, dtype=np.bool_)
    long = times[places + 1] - times[places]
    begins = np.searchsorted(times, times[places] - long)
    ends = np.searchsorted(times, times[places + 1] + long, side="right")
    covered = (times[0] <= times[places] - long) & (times[-1] >= times[places + 1] + long)
    found = covered & (places + 1 - begins >= _FEWEST) & (ends - places - 1 >= _FEWEST)
    for k in np.flatnonzero(found):
        part, last = slice(begins[k], ends[k]), int(places[k] - begins[k])
        found[k] = _smooth(times[part], inputs[part], last, least)
    return np.asarray(found)


def between(t: FloatArray, u: FloatArray, wanted: FloatArray, gaps: IntArray) -> FloatArray:
    """Return inputs at wanted times within gaps, on monotone cubics; NaN elsewhere.

    Parameters
    ----------
    t, u : (T,) array
        Times in seconds, never decreasing, and inputs.
    wanted : (N,) array
        Times, increasing.
    gaps : (G,) array of int
        Samples after which a gap follows.
    """
    values = np.full(wanted.size, np.nan)
    inside = np.zeros(wanted.size, dtype=np.bool_)
    firsts = np.searchsorted(wanted, t[gaps], side="right")
    lasts = np.searchsorted(wanted, t[gaps + 1], side="left")
    for first, last in zip(firsts, lasts, strict=True):
        inside[first:last] = True
    if inside.any():
        apart = np.concatenate([[True], np.diff(t) > 0])
        values[inside] = PchipInterpolator(t[apart], u[apart])(wanted[inside])
    return values


def _noise(u: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences that a slow input lacks."""
    if u.size < 5:
        return float(np.inf)
    return noise_of(np.diff(u, 4), 4)


def _smooth(t: FloatArray, u: FloatArray, last: int, least: float) -> bool:
    """Whether the input goes one way around the gap after a sample, and no faster in it."""
    way = 1.0 if u[-1] >= u[0] else -1.0
    falls = float((np.maximum.accumulate(way * u) - way * u).max())
    if falls > least:
        return False
    moved = abs(float(u[last + 1] - u[last]))
    long = float(t[last + 1] - t[last])
    beside = (
        abs(float(u[last] - u[0])) / float(t[last] - t[0]) * long,
        abs(float(u[-1] - u[last + 1])) / float(t[-1] - t[last + 1]) * long,
    )
    return moved <= _FASTER * max(beside) + least and moved >= _SLOWER * min(beside) - least
