"""Compiled loops that fit an operator with after-effect: arrays in, arrays out."""

from __future__ import annotations

import math

from numba import njit

from minorloop.operators._after_effect_kernels import relaxed
from minorloop.operators._memory_kernels import copy, push, switched_on


@njit(cache=True, nogil=True)
def follow(marks, lost, begins, reset, x):
    """Replace stretched inputs ``x`` (T,) by stretched effective inputs, in place.

    ``marks`` are the stretched thresholds, ``lost`` (T,) is 1 - exp(-interval /
    settling), ``begins`` (T,) is true where a curve begins, at the effective input ``reset``.
    """
    now = reset
    for t in range(x.size):
        if begins[t]:
            now = reset
        now = relaxed(now, min(max(x[t], marks[0]), marks[-1]), lost[t])
        x[t] = now


@njit(cache=True, nogil=True)
def fill(levels, marks, spread, x, u, intervals, times, begins, reset, extrema, count, late, out):
    """Fill rows (T, P K) of the design matrix; return the number of extrema of the memory.

    Column block p is the share of each cell that has switched on with the delay of time constant p,
    less the share with that of p + 1; block 0 has no delay. So the unknowns of a block are the sums
    of the weights of plane and creep up to time constant p, which must not be negative. ``x`` (T,),
    the effective input, and the extrema are in units of ``marks``, the stretched thresholds;
    ``late`` (P, K) is the state.
    """
    bands, cells, planes = levels.size - 1, late.shape[1], late.shape[0]
    for t in range(u.size):
        if begins[t]:
            count = copy(reset, extrema)
            switched_on(marks, spread, extrema, count, late[0])
            for p in range(1, planes):
                for k in range(cells):
                    late[p, k] = late[0, k]
        count = push(extrema, count, min(max(x[t], marks[0]), marks[-1]))
        now = late[0]
        switched_on(marks, spread, extrema, count, now)
        if not spread:
            for i in range(bands):
                share = (u[t] - levels[i]) / (levels[i + 1] - levels[i])
                now[i * (i + 1) // 2 + i] = min(max(share, 0.0), 1.0)
        for p in range(1, planes):
            one, gain = late[p], -math.expm1(-intervals[t] / times[p - 1])
            for k in range(cells):
                one[k] += gain * (now[k] - one[k])
        for p in range(planes):
            for k in range(cells):
                rest = late[p + 1, k] if p + 1 < planes else 0.0
                out[t, p * cells + k] = late[p, k] - rest
    return count
