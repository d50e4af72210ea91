"""Compiled loops that compare two maps of the wall: arrays in, arrays filled."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def _change(level, motion, i, j, out):
    """Fill out (2,) with the change of a map at a texel as the head pans and tilts, a radian."""
    up, down = max(i - 1, 0), min(i + 1, level.shape[0] - 1)
    left, right = max(j - 1, 0), min(j + 1, level.shape[1] - 1)
    along = (level[down, j] - level[up, j]) / np.float32(down - up)
    around = (level[i, right] - level[i, left]) / np.float32(right - left)
    for a in range(2):
        out[a] = motion[a, 0, i, j] * around + motion[a, 1, i, j] * along


@njit(cache=True, nogil=True)
def weigh(level, base, both, motion, scale, alike, told, right):
    """Fill ``told`` (2, 2) and ``right`` (2,) of a step that moves a map (rows, columns) to a base.

    ``motion`` (2, 2, rows, columns) is by how many texels the wall moves around and along as the
    head pans and tilts, a radian. Differences count less beyond ``scale``. The changes of the base
    are the instruments of those of the map; with ``alike``, both have the mean of the two.
    """
    told[:], right[:] = 0.0, 0.0
    instrument, slope = np.empty(2), np.empty(2)
    for i in range(level.shape[0]):
        for j in range(level.shape[1]):
            if not both[i, j]:
                continue
            _change(base, motion, i, j, instrument)
            _change(level, motion, i, j, slope)
            if alike:
                for a in range(2):
                    slope[a] = 0.5 * (instrument[a] + slope[a])
                    instrument[a] = slope[a]
            rest = np.float64(level[i, j] - base[i, j])
            weight = 1.0 / (1.0 + (rest / scale) ** 2)
            for a in range(2):
                right[a] += weight * instrument[a] * rest
                for b in range(2):
                    told[a, b] += weight * instrument[a] * slope[b]
