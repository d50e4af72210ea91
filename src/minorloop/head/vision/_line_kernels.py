"""Compiled loop for dark lines: arrays in, arrays out."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def keep_highest(smooth, step, side, heights, sides):
    """Keep the height of a line through each texel, and its side, where it is the highest yet.

    ``smooth`` (K, R, C) are maps smoothed along the line, one a light, and longer than ``heights``
    (rows, columns): the padding is beyond either edge. The height is the lower of two texels a
    ``step`` (2,) to both sides, less the middle, under the light with the least. ``side`` (2,) goes
    into ``sides`` (2, rows, columns).
    """
    rows, columns = heights.shape
    most, turned = smooth.shape[1], smooth.shape[2]
    i, j = step
    least = np.empty(columns, smooth.dtype)
    for v in range(rows):
        least[:] = np.inf
        for k in range(smooth.shape[0]):
            one, other, middle = smooth[k, (v - i) % most], smooth[k, (v + i) % most], smooth[k, v]
            for u in range(abs(j)):
                height = min(one[(u - j) % turned], other[(u + j) % turned]) - middle[u]
                least[u] = min(least[u], height)
            for u in range(abs(j), columns):  # without a turn the compiler makes it one of vectors
                height = min(one[u - j], other[u + j]) - middle[u]
                least[u] = min(least[u], height)
        for u in range(columns):
            if least[u] > heights[v, u]:
                heights[v, u] = least[u]
                sides[0, v, u], sides[1, v, u] = side[0], side[1]
