"""Choose thresholds if only their number is given.

The density of adaptive thresholds is proportional to the cube root of the slope of the output. The
optimal density of a piecewise approximation is a root of the local error (de Boor, Good
approximation by splines with variable knots, 1973). A density proportional to the slope would leave
too few thresholds on the flanks, where minor loops are.
"""

import numpy as np

from minorloop.arrays import FloatArray, Levels, as_levels, uniform_levels

_BINS = 4096
_POWER = 1 / 3
_ADAPTIVE_FLOOR = 0.4
"""Share of the adaptive thresholds that are evenly distributed."""


def levels_for(u: FloatArray, y: FloatArray, bands: int, spacing: str) -> Levels:
    """``bands + 1`` thresholds over the range of the input, evenly or adaptively spaced."""
    low, high = float(u.min()), float(u.max())
    even = uniform_levels(low, high, bands)
    return even if spacing == "uniform" else adaptive_levels(u, y, bands)


def adaptive_levels(
    u: FloatArray, y: FloatArray, bands: int, *, floor: float = _ADAPTIVE_FLOOR
) -> Levels:
    """(L + 1,) thresholds that are denser where the output is steep.

    ``u`` (T,): inputs; ``y`` (T,): outputs; NaN if not measured; ``bands``: L; ``floor``: share of
    the thresholds that are evenly distributed.
    """
    low, high = float(u.min()), float(u.max())
    before, after = u[:-1], u[1:]
    moved = np.diff(y)
    use = np.isfinite(moved) & (before != after)
    edges = np.linspace(low, high, _BINS + 1)
    # Signed slopes, so that noise averages out where the input moves in small steps.
    rate = moved[use] / (after - before)[use]
    left = np.searchsorted(edges, np.minimum(before, after)[use])
    right = np.searchsorted(edges, np.maximum(before, after)[use])
    # Each step adds its slope to the bins between its ends: a running sum of jumps.
    slopes, visits = np.zeros(_BINS + 1), np.zeros(_BINS + 1)
    np.add.at(slopes, left, rate)
    np.add.at(slopes, right, -rate)
    np.add.at(visits, left, 1.0)
    np.add.at(visits, right, -1.0)
    steep = np.abs(np.cumsum(slopes))[:-1] / np.maximum(np.cumsum(visits)[:-1], 1.0)
    share = steep**_POWER
    total = share.sum()
    share = share / total if total > 0 else np.full(_BINS, 1 / _BINS)
    share = (1 - floor) * share + floor / _BINS
    cumulative = np.concatenate([[0.0], np.cumsum(share)])
    levels = np.interp(np.linspace(0, cumulative[-1], bands + 1), cumulative, edges)
    levels[0], levels[-1] = low, high
    return as_levels(levels)
