"""Compiled loops that fit an operator with after-effect: arrays in, arrays out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from minorloop.operators._after_effect_kernels import moments_of, next_mark, part_of, relaxed
from minorloop.operators._memory_kernels import copy, push, switched_on


@njit(cache=True, nogil=True)
def follow(marks, lost, begins, reset, x):
    """In place: stretched inputs (T,) become stretched effective inputs.

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
def switch(marks, spread, extrema, count, x, target, interval, settling, times, shares, lags):
    """Apply an effective input; returns the extrema in use, and fills the lags (P - 1, K) of cells.

    As `minorloop.operators._after_effect_kernels.fill_lags`, for each cell. ``shares`` (4, K) is
    room for what is switched on at the begin of the interval, and at the begin, in the middle and
    at the end of a part of it.
    """
    begun, before, middle, now = shares[0], shares[1], shares[2], shares[3]
    at, left, first = extrema[count - 1], interval, True
    still, tilt = np.empty(times.size), np.empty(times.size)
    lags[:] = 0.0
    switched_on(marks, spread, extrema, count, begun)
    copy(begun, before)
    rising = x > at
    while left > 0.0 and at != x:
        mark, top = next_mark(marks, at, rising), count - 1
        if rising == (top & 1 == 0):
            top += 1
        if top >= 2 + rising:
            mark = min(mark, extrema[top - 2]) if rising else max(mark, extrema[top - 2])
        to, seconds = part_of(at, x, target, mark, left, settling, times[0], first)
        moments_of(at, to, target, settling, times, first, still, tilt)
        count = push(extrema, count, (at + to) / 2.0)
        switched_on(marks, spread, extrema, count, middle)
        count = push(extrema, count, to)
        switched_on(marks, spread, extrema, count, now)
        for p in range(times.size):
            kept = math.exp(-seconds / times[p])
            for k in range(now.size):
                bent = 2.0 * (now[k] + before[k] - 2.0 * middle[k]) * tilt[p]
                lags[p, k] = kept * lags[p, k] + (now[k] - before[k]) * still[p] + bent
        copy(now, before)
        at, left, first = to, left - seconds, False
    for p in range(times.size):
        kept, rest = math.exp(-left / times[p]), math.exp(-interval / times[p])
        for k in range(now.size):
            lags[p, k] = kept * lags[p, k] - rest * (before[k] - begun[k])
        if not spread:
            for i in range(marks.size - 1):
                lags[p, i * (i + 1) // 2 + i] = 0.0
    return count


@njit(cache=True, nogil=True)
def fill(
    levels,
    marks,
    spread,
    x,
    targets,
    u,
    intervals,
    settling,
    times,
    begins,
    reset,
    extrema,
    count,
    late,
    out,
):
    """Fill rows (T, P K) of the design matrix; returns the extrema in use.

    Column block p is the share of each cell that has switched on late by time constant p, less that
    by p + 1; block 0 is at once. So the unknowns of a block are the weights of plane and creep up
    to time constant p, which must not be negative. With thresholds that move late too, nothing is
    subtracted, and the unknowns are the weights of plane and creep, which must not be negative then
    (see `AfterEffect.monotone`). ``x`` (T,) is the effective input in units of ``marks``, the
    stretched thresholds, as are the extrema; ``late`` (P, K) is the state. ``targets`` (T,) are the
    inputs ``u`` (T,) in these units.
    """
    bands, cells, planes = levels.size - 1, late.shape[1], late.shape[0]
    both = settling > 0.0 and planes > 1
    lags, shares = np.zeros((planes - 1, cells)), np.empty((4, cells))
    for t in range(u.size):
        if begins[t]:
            count = copy(reset, extrema)
            switched_on(marks, spread, extrema, count, late[0])
            for p in range(1, planes):
                for k in range(cells):
                    late[p, k] = late[0, k]
        now_x = min(max(x[t], marks[0]), marks[-1])
        if both:
            count = switch(
                marks,
                spread,
                extrema,
                count,
                now_x,
                targets[t],
                intervals[t],
                settling,
                times,
                shares,
                lags,
            )
        count = push(extrema, count, now_x)
        now = late[0]
        switched_on(marks, spread, extrema, count, now)
        if not spread:
            for i in range(bands):
                share = (u[t] - levels[i]) / (levels[i + 1] - levels[i])
                now[i * (i + 1) // 2 + i] = min(max(share, 0.0), 1.0)
        for p in range(1, planes):
            one, gain = late[p], -math.expm1(-intervals[t] / times[p - 1])
            for k in range(cells):
                one[k] += gain * (now[k] - one[k]) - lags[p - 1, k]
        for p in range(planes):
            alone = both or p + 1 == planes
            for k in range(cells):
                rest = 0.0 if alone else late[p + 1, k]
                out[t, p * cells + k] = late[p, k] - rest
    return count
