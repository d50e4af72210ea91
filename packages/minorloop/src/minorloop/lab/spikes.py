"""Find spikes: single readings, or short bursts of them, far from those around them."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from minorloop.arrays import BoolArray, FloatArray
from minorloop.lab.faults import Fault, far_from_others, without
from minorloop.lab.holds import FoundHold
from minorloop.lab.noise import noise_of

__all__ = ["input_without_spikes", "spikes", "without_spikes"]

_WIDTH = 21
"""Readings of the running median, which follows every rise or fall exactly."""
_FAR, _STEPS = 8.0, 4.0
"""Distance of a spike from it, in standard deviations of the noise, and in steps of the sensor."""
_AROUND, _TIMES = 3, 8.0
"""Widths around a spike, over whose usual distance its own is so many times: in an oscillation all
are off."""
_LONGEST = 8
"""Most readings of a burst."""
_SHARP = 0.3
"""Least difference of each reading of a spike from its neighbours, over its largest distance."""
_LARGE = 0.25
"""Distance over the largest, of those that are found at once."""
_MOST = 0.1
"""Share of the readings above which they are no spikes, but how the output is."""
_FEWEST = 20
"""Readings below which noise cannot be distinguished from spikes."""


def spikes(y: npt.ArrayLike) -> BoolArray:
    """Return which readings are spikes, as those of a disturbed line or a lost echo.

    Parameters
    ----------
    y : (T,) array_like
        Readings of a sensor while its input is constant; NaN where nothing was measured.

    Returns
    -------
    (T,) array of bool
        All False for fewer than twenty readings, and where more than a tenth would be spikes.
    """
    values = np.asarray(y, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    found = np.zeros(values.size, dtype=np.bool_)
    if known.size < _FEWEST:
        return found
    left = known
    # A large one shifts the median beside it.
    while left.size >= _FEWEST and (more := _largest(values[left])).any():
        found[left[more]] = True
        left = left[~more]
    return found if np.count_nonzero(found) <= _MOST * known.size else np.zeros_like(found)


def without_spikes(
    y: FloatArray, holds: Sequence[FoundHold]
) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the readings, NaN where they are spikes within a hold; and the fault that they are."""
    found = np.zeros(y.size, dtype=np.bool_)
    for hold in holds:
        found[hold.begin : hold.end] = spikes(y[hold.begin : hold.end])
    faults = (far_from_others(y, np.flatnonzero(found)),) if found.any() else ()
    return without(y, faults), faults


def input_without_spikes(u: FloatArray, name: str) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return a measured input with straight lines in place of its spikes; and their fault.

    A spike would count as a passed extreme, and delete the memory of a model.
    """
    found = spikes(u)
    if not found.any():
        return u, ()
    samples = np.arange(u.size)
    level = np.interp(samples, samples[~found], u[~found])
    return level, (far_from_others(u, np.flatnonzero(found), name),)


def _largest(y: FloatArray) -> BoolArray:
    """Return the largest spikes: far from a running median, and from both neighbours alike."""
    away = y - median_filter(y, _WIDTH, mode="mirror")
    usual = median_filter(np.abs(away), _AROUND * _WIDTH, mode="mirror")
    noise = max(_FAR * noise_of(np.diff(y, 2), 2), _STEPS * _step(y))
    limit = np.maximum(noise, _TIMES * usual)
    size = np.zeros(y.size)
    for way in (1, -1):
        edges = np.flatnonzero(np.diff(way * away > limit, prepend=False, append=False))
        for begin, end in edges.reshape(-1, 2).tolist():
            far = float(np.abs(away[begin:end]).max())
            beside = [way * y[k] for k in (begin - 1, end) if k < y.size]
            rise = float((way * y[begin:end]).min() - max(beside))
            # Where the next readings differ by more than one rises, it may be an overshoot.
            sharp = rise >= max(_SHARP * far, max(beside) - min(beside))
            # The first readings of a hold may be those of the hold before.
            if sharp and begin and end - begin <= _LONGEST:
                size[begin:end] = far
    found: BoolArray = (size > 0) & (size >= _LARGE * size.max())
    return found


def _step(y: FloatArray) -> float:
    """Return the least difference of two readings, 0 where all are equal."""
    steps = np.diff(np.unique(y))
    return float(steps.min()) if steps.size else 0.0
