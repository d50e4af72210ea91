"""Width of a line on the wall, from the profiles across its course.

A line is modelled as two flanks side by side, each of one brightness under a light, blurred by lens
and map. If it is as narrow as the blur, the amount of light that it takes is known, but not its
width: it may be narrow and black, or wider and grey. Widths are averaged by their probability.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray

KINDS = (*((0.93, 0.08, blur) for blur in (0.6, 0.85, 1.2, 1.7)), (0.0, 2.0, 1.0))
"""Mean and standard deviation of the share of light that a flank takes, and standard deviation in
texels of the blur of an edge on the map: of a black crack, in a near and a far view, and of a
groove that reflects light, which may be brighter than the wall. By trial on 28 dark and lit grooves
of our own walls and nine of a path tracer."""
_WIDTHS = np.geomspace(0.4, 8.0, 25)
"""In texels, 20 to 400 um."""
_SHIFTS = (-1.0, 0.0, 1.0)
"""Offset of the middle from the course, in texels: the course lies nearer to a bright flank."""
_FINE = 0.05
"""Step in texels in which flanks are drawn."""
_CORRELATED, _LEAST = 2.0, 1e-4
"""Number of neighbours in a profile with a common error, and least variance of that error."""


def measured_widths(
    taken: FloatArray, side: int, core: int, even: float
) -> tuple[FloatArray, FloatArray]:
    """Return widths (N,) of a line along its course, and their standard deviations, in texels.

    Parameters
    ----------
    taken : (K, N, M) array
        Share of the light that is taken under each light, every half texel across.
    side, core : int
        Half texels of the profile to either side, and those that may belong to the line.
    even : float
        Standard deviation in texels over which widths are averaged along the course.
    """
    smooth = ndimage.gaussian_filter1d(taken, even, axis=1, mode="nearest")
    beside = np.abs(np.arange(-side, side + 1)) > core
    noise = _CORRELATED * max(float((smooth[..., beside] ** 2).mean()), _LEAST)
    costs = np.empty((len(KINDS), len(_SHIFTS) * len(_WIDTHS), taken.shape[1]))
    for (mean, sd, blur), cost in zip(KINDS, costs, strict=True):
        for flanks, one in zip(_flanks(side, blur), cost, strict=True):
            square, product = flanks.T @ flanks, smooth @ flanks
            normal = square / noise + np.eye(2) / sd**2
            share = (product / noise + mean / sd**2) @ np.linalg.inv(normal)
            share = np.minimum(share, 1.0)
            # The squares of the profile are the same for all widths: left out.
            left = (share * (share @ square - 2 * product)).sum(axis=-1) / noise
            far = ((share - mean) ** 2).sum(axis=-1) / sd**2
            each = 0.5 * (left + far + np.linalg.slogdet(normal)[1]) + 2 * np.log(sd)
            one[:] = each.sum(axis=0)
    costs = ndimage.gaussian_filter1d(costs, even, axis=2, mode="nearest")
    odds = np.exp(costs.min(axis=(0, 1)) - costs).sum(axis=0)
    odds = odds.reshape(len(_SHIFTS), len(_WIDTHS), -1).sum(axis=0)
    odds /= odds.sum(axis=0)
    mean = np.log(_WIDTHS) @ odds
    spread = np.sqrt(np.maximum(np.log(_WIDTHS) ** 2 @ odds - mean**2, 0.0))
    return np.exp(mean), np.exp(mean) * spread


@cache
def _flanks(side: int, blur: float) -> FloatArray:
    """Return blurred shares of half texels that flanks cover, (shifts x widths, M, 2)."""
    fine = np.arange(-side, side + _FINE, _FINE)
    texels = np.arange(-side, side + 1) / 2
    tried = []
    for shift in _SHIFTS:
        for half in 0.5 * _WIDTHS:
            off = fine - shift
            both = np.array([(off > -half) & (off <= 0), (off > 0) & (off < half)], dtype=float)
            blurred = ndimage.gaussian_filter1d(both, blur / _FINE, axis=1)
            tried.append([np.interp(texels, fine, one) for one in blurred])
    return np.array(tried).swapaxes(1, 2)
