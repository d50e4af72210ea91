"""Compiled loops of the reduced memory sequence: arrays in, arrays out.

The extrema alternate: even entries are minima, odd ones maxima, entry 0 is negative saturation,
and the last one in use is the present input.
"""

from __future__ import annotations

import math

from numba import njit

INSIDE = {"cache": True, "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of functions that only compiled functions call: an entry from Python would take half of
their compilation time."""


@njit(cache=True, nogil=True)
def copy(values, out):
    """Copy numbers to the begin of an array; return their number.

    A loop, because numba takes seconds to compile an assignment of one array to another.
    """
    for k in range(values.size):
        out[k] = values[k]
    return values.size


@njit(cache=True, nogil=True)
def copy_extrema(extrema, count, out):
    """Copy the first ``count`` extrema; numba takes seconds to compile an assignment of slices."""
    for k in range(count):
        out[k] = extrema[k]


@njit(**INSIDE)
def wipes_out(u, top, extremum, rising):
    """Whether the present input, with index ``top`` >= 2, wipes out the two extrema before it.

    It does if it passes the earlier of the two, ``extremum``. A rise never wipes out negative
    saturation, entry 0. Mayergoyz, Mathematical Models of Hysteresis, 1991, section 1.2. Takes
    numbers, not the array: numba counts references to an array at each call.
    """
    if rising:
        return top >= 3 and u >= extremum
    return u <= extremum


@njit(cache=True, nogil=True)
def push(extrema, count, u):
    """Apply an input inside the levels to the first ``count`` extrema; return the new count."""
    top = count - 1
    if u == extrema[top]:
        return count
    rising = u > extrema[top]
    if rising == (top & 1 == 0):  # a reversal: the last input becomes an extremum
        top += 1
    while top >= 2 and wipes_out(u, top, extrema[top - 2], rising):
        top -= 2
    extrema[top] = u
    return top + 1


@njit(cache=True, nogil=True)
def reduce(extrema, u, low, high):
    """Fill ``extrema`` (T + 1,) with the memory of inputs (T,); return the count, 0 at a NaN."""
    extrema[0] = low
    count = 1
    for t in range(u.size):
        if math.isnan(u[t]):
            return 0
        count = push(extrema, count, min(max(u[t], low), high))
    return count


@njit(cache=True, nogil=True)
def switched_on(levels, spread, extrema, count, out):
    """Fill ``out`` (K,) with the fraction of every cell that is switched on, packed row by row.

    The first ``count`` extrema form a staircase on the plane: between two minima, all relays up
    to the maximum after the first of them are on. Each step covers a rectangle of every cell that
    it crosses. On the diagonal it covers a corner of the triangle (``spread``), or the line
    alpha = beta as far as the present input.
    """
    bands = levels.size - 1
    out[:] = 0.0
    for k in range(1, count, 2):
        top, begin = extrema[k], extrema[k - 1]
        end = extrema[k + 1] if k + 1 < count else top
        for j in range(bands):
            p, q = max(begin, levels[j]), min(end, levels[j + 1])
            if q <= p:
                continue
            width = levels[j + 1] - levels[j]
            for i in range(j + 1, bands):
                if top <= levels[i]:
                    break
                height = levels[i + 1] - levels[i]
                share = min(top - levels[i], height) / height
                out[i * (i + 1) // 2 + j] += share * (q - p) / width
            if spread:
                t = min(top, levels[j + 1])
                r = min(q, t)
                if r > p:
                    out[j * (j + 1) // 2 + j] += ((t - p) ** 2 - (t - r) ** 2) / width**2
    if not spread:
        now = extrema[count - 1]
        for i in range(bands):
            share = (now - levels[i]) / (levels[i + 1] - levels[i])
            out[i * (i + 1) // 2 + i] = min(max(share, 0.0), 1.0)
