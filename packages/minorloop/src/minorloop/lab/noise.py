"""Standard deviations by medians, which outliers hardly change."""

import math

import numpy as np

from minorloop.arrays import FloatArray

__all__ = ["noise_of", "spread"]

_MEDIAN = 0.6745
"""Median of the magnitude of a normal variable over its standard deviation."""


def noise_of(differences: FloatArray, order: int) -> float:
    """Return the standard deviation of white noise of which these are the differences.

    The squares of the binomial coefficients of an order sum to that of twice the order over it.
    The median leaves out what moves now and then.

    Parameters
    ----------
    differences : (N,) array
        Differences of a signal of some order; at least one.
    order : int
        1 for differences of neighbours.
    """
    scale = _MEDIAN * math.sqrt(math.comb(2 * order, order))
    return float(np.median(np.abs(differences))) / scale


def spread(values: FloatArray) -> float:
    """Return the standard deviation of values (N,) by their median distance from the median."""
    return float(np.median(np.abs(values - np.median(values)))) / _MEDIAN
