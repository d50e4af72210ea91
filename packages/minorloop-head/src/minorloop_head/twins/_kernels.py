"""Compiled parts of wires and catheter: courses over time, delayed readings, and the catheter."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def course(c, t):
    """Return the value at t of a quantity that steps or ramps once and oscillates from then on."""
    start, end, at, duration, amplitude, period = c
    if t < at:
        return start
    value = end if t >= at + duration else start + (end - start) * (t - at) / duration
    if amplitude != 0.0:
        value += amplitude * math.sin(2.0 * math.pi * (t - at) / period)
    return value


@njit(cache=True, nogil=True)
def remember(past, mark, t, y, spacing):
    """Add outputs y at time t to the ring ``past``; the newest row is at ``mark[0]``.

    Row ``mark[0]`` always has the latest time. A new row begins ``spacing`` after the one before,
    so that many short steps do not overwrite rows that are still needed.
    """
    rows = past.shape[0]
    before = (mark[0] - 1) % rows
    if past[mark[0], 0] - past[before, 0] >= spacing:
        mark[0] = (mark[0] + 1) % rows
    past[mark[0], 0] = t
    for k in range(y.size):
        past[mark[0], k + 1] = y[k]


@njit(cache=True, nogil=True)
def recall(past, mark, t, out):
    """Return outputs at t from the ring, linear between its rows; the oldest for earlier times."""
    rows = past.shape[0]
    newer = mark[0]
    for back in range(1, rows):
        older = (mark[0] - back) % rows
        if past[older, 0] <= t or back == rows - 1:
            gap = past[newer, 0] - past[older, 0]
            share = (t - past[older, 0]) / gap if gap > 0.0 else 1.0
            share = min(max(share, 0.0), 1.0)
            for k in range(out.size):
                old = past[older, k + 1]
                out[k] = old + share * (past[newer, k + 1] - old)
            return
        newer = older


@njit(cache=True, nogil=True)
def catheter_step(axis, drive, stretch, rate, h):
    """Integrate one axis of the catheter over a step.

    ``axis`` is the motor's rate, its position, the tip's position, and the direction of sliding
    (-1, 0 where it sticks, 1). ``drive`` is acceleration, breakaway, sliding, relaxation, and the
    two ends of the travel. Breakaway and sliding are the lags at which static friction ends and
    begins; ``stretch`` multiplies them.
    """
    most = drive[0] * h
    before = axis[0]
    axis[0] += min(max(rate - before, -most), most)
    axis[1] += 0.5 * h * (before + axis[0])
    if axis[1] <= drive[4] or axis[1] >= drive[5]:
        axis[1] = min(max(axis[1], drive[4]), drive[5])
        axis[0] = 0.0
    lag = axis[1] - axis[2]
    if axis[3] == 0.0 and abs(lag) > stretch * drive[1]:
        axis[3] = 1.0 if lag > 0.0 else -1.0
    if axis[3] != 0.0:
        pace = h / drive[3]
        goal = axis[1] - axis[3] * stretch * drive[2]
        moved = pace * (goal - axis[2]) / (1.0 + pace)
        if moved * axis[3] > 0.0:
            axis[2] += moved
        else:
            axis[3] = 0.0


@njit(cache=True, nogil=True)
def catheter_run(state, drives, growth, clock, ends, first, u, pace, delay, past, mark):
    """Advance and roll of the catheter under rates that are linear between samples.

    As ``_wire_kernels.head_run``; ``drives`` (2, 6) are those of ``catheter_step``, and ``growth``
    is the growth of friction per millimetre of catheter in the pipe.
    """
    out = np.empty((ends.size, 2))
    began = 0.0
    for n in range(ends.size):
        gap = ends[n] - began
        steps = int(max(math.ceil(gap / pace[0] - 1e-9), 1) * pace[1])
        h = gap / steps
        for k in range(1, steps + 1):
            stretch = 1.0 + growth * state[0, 2]
            for a in range(2):
                before = first[a] if n == 0 else u[n - 1, a]
                rate = before + (u[n, a] - before) * k / steps
                catheter_step(state[a], drives[a], stretch, rate, h)
            if delay > 0.0:
                now = clock + began + k * h
                remember(past, mark, now, state[:, 2], 0.25 * pace[0] / pace[1])
        began = ends[n]
        if delay > 0.0:
            recall(past, mark, clock + began - delay, out[n])
        else:
            for a in range(2):
                out[n, a] = state[a, 2]
    return out
