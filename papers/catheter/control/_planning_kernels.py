"""Compiled loops of the planner: arrays and `PlaneTables` in, arrays out."""

import numpy as np
from numba import njit

from minorloop.operators._kernels import simulate
from minorloop_head.heated_wire import SMALLEST_CHANGE


@njit(cache=True, nogil=True)
def _copy(stack, rows, out):
    """Copy the first rows; numba takes seconds to compile an assignment of slices."""
    for k in range(rows):
        for column in range(stack.shape[1]):
            out[k, column] = stack[k, column]


@njit(cache=True, nogil=True)
def courses(plane, stack, rows, start, wire, powers, step, parts, out):
    """Return angles (C, N) of a heated wire under C sequences of powers (C, N), each held.

    ``stack`` (rows and more, 4) is the memory before and is left as it was; ``start`` is the
    effective power and the angle then, ``wire`` lag and latent heat. Each power is held for
    ``parts`` implicit steps of ``step`` seconds.
    """
    lag, latent = wire
    most = rows + powers.shape[1] * parts + 4
    own, trial = np.empty((most, 4)), np.empty((most, 4))
    u, y = np.empty(1), np.empty(1)
    for c in range(powers.shape[0]):
        _copy(stack, rows, own)
        n, w, angle = rows, start[0], start[1]
        for k in range(powers.shape[1]):
            for _ in range(parts):
                gap = step * (powers[c, k] - w)
                stiff = lag + step
                change = gap / stiff
                if abs(change) < SMALLEST_CHANGE:
                    continue
                if latent > 0.0:
                    for _ in range(2):
                        _copy(own, n, trial)
                        u[0] = w + change
                        simulate(plane, trial, n, u, y)
                        change = gap / (stiff + latent * (y[0] - angle) / change)
                w += change
                u[0] = w
                n = simulate(plane, own, n, u, y)
                angle = y[0]
            out[c, k] = angle
