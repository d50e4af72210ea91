"""Compiled loops for lines on the wall: arrays in, arrays out."""

from __future__ import annotations

import numpy as np
from numba import njit

_SIDES, _TURN = 8, 0.09
"""Number of headings tried to either side of the last one, and angle between them in radians:
41 degrees to a side. A crack turns less within ``AHEAD``."""
_KEPT = 0.6
"""Weight of the last heading in the next one: a dark texel beside a line does not turn it."""
_COST = 0.3
"""Cost of a turn by a radian, as a share of the least height: it prefers the straight dark way."""
AHEAD = 8
"""Texels whose mean height decides, twice the standard deviation of the filter along a line: with
fewer, a spot of noise ends a line, with more, a turn does."""


@njit(cache=True, nogil=True)
def keep_highest(smooth, step, side, heights, sides):
    """Keep the height of a line through each texel, and its side, where it is the highest yet.

    ``smooth`` (K, R, C) are maps smoothed along the line, one a light, and longer than ``heights``
    (rows, columns): the padding is beyond either edge. Under each light a line is below the lower
    of two texels a ``step`` (2,) to both sides, or above the higher; the height is the mean over
    the lights. ``side`` (2,) goes into ``sides`` (2, rows, columns).
    """
    rows, columns = heights.shape
    most, turned = smooth.shape[1], smooth.shape[2]
    i, j = step
    share = heights.dtype.type(1.0 / smooth.shape[0])
    zero = heights.dtype.type(0.0)
    total = np.empty(columns, smooth.dtype)
    for v in range(rows):
        total[:] = 0.0
        for k in range(smooth.shape[0]):
            one, other, middle = smooth[k, (v - i) % most], smooth[k, (v + i) % most], smooth[k, v]
            for u in range(abs(j)):
                a, b = one[(u - j) % turned], other[(u + j) % turned]
                total[u] += max(min(a, b) - middle[u], middle[u] - max(a, b), zero)
            for u in range(abs(j), columns):  # without a turn the compiler makes it one of vectors
                a, b = one[u - j], other[u + j]
                total[u] += max(min(a, b) - middle[u], middle[u] - max(a, b), zero)
        for u in range(columns):
            if share * total[u] > heights[v, u]:
                heights[v, u] = share * total[u]
                sides[0, v, u], sides[1, v, u] = side[0], side[1]


@njit(cache=True, nogil=True)
def _height(heights, known, y, x, beyond):
    """Return the height at row y and column x, or ``beyond`` where it is not known."""
    i, j = int(np.rint(y)), int(np.rint(x))
    if not (0 <= i < heights.shape[0] and 0 <= j < heights.shape[1]):
        return beyond
    return heights[i, j] if known[i, j] else beyond


@njit(cache=True, nogil=True)
def follow(heights, known, seen, owner, own, start, way, least, out):
    """Fill out (N, 2) with rows and columns along a line from its end; return their number.

    Each step goes where the mean height of the texels ahead is greatest. The line ends where the
    wall is not ``seen``, on texels of another ``owner`` (0 is none, ``own`` its own), and where
    that mean is below ``least``; there it goes straight on to the last texel but one that is not,
    since ``heights`` are the highest of three texels. Those not ``known`` count as the least.
    """
    y, x, angle = start[0], start[1], np.arctan2(way[0], way[1])
    straight = False
    for n in range(out.shape[0]):
        best, at = -1.0, angle
        for side in range(-_SIDES, _SIDES + 1):
            turn, total = side * _TURN, 0.0
            c, s = np.cos(angle + turn), np.sin(angle + turn)
            for k in range(1, AHEAD + 1):
                total += _height(heights, known, y + k * s, x + k * c, least)
            value = total / AHEAD - _COST * least * turn * turn
            if value > best:
                best, at = value, angle + turn
        straight = straight or best < least
        if not straight:
            angle = _KEPT * angle + (1.0 - _KEPT) * at
        y, x = y + np.sin(angle), x + np.cos(angle)
        i, j = int(np.rint(y)), int(np.rint(x))
        if not (0 <= i < owner.shape[0] and 0 <= j < owner.shape[1] and seen[i, j]):
            return n
        if straight and _height(heights, known, y, x, least) < least:
            return max(n - 1, 0)
        out[n, 0], out[n, 1] = y, x
        if owner[i, j] != 0 and owner[i, j] != own:
            return n + 1
    return out.shape[0]


@njit(cache=True, nogil=True)
def sum_of_trees(rows, first, feature, threshold, branches, value):
    """Return the sum (N,) over all trees of their values for each row (N, F) of features.

    ``first`` are the first nodes of the trees; a leaf has the ``feature`` -1.
    """
    total = np.zeros(len(rows))
    for n in range(len(rows)):
        for start in first:
            node = start
            while feature[node] >= 0:
                upper = 1 if rows[n, feature[node]] > threshold[node] else 0
                node = start + branches[node, upper]
            total[n] += value[node]
    return total
