"""Compiled steps of an observer of a wire: arrays in, arrays out.

The operator is a `PlaneTables` with its stack of extrema and the rows in use. ``wire`` is lag,
latent heat, interval and iterations for the slope; ``gains`` are those of
`minorloop_head.control.observer.PowerObserver.gains`.
"""

import numpy as np
from numba import njit

from minorloop.operators._kernels import aim, push_balance, simulate
from minorloop_head.heated_wire import SMALLEST_CHANGE

POWER, ANGLE, AMBIENT, ERROR, OFFSET, WAY = range(6)
"""Places in the values of an estimate."""


@njit(cache=True, nogil=True)
def _aimed(plane, stack, rows, ends, target):
    """Return the power in A^2 that brings the wire nearest to an angle in degrees."""
    return aim(plane, stack, rows, min(max(target, ends[0]), ends[1]))


@njit(cache=True, nogil=True)
def predict(plane, stack, rows, wire, values, heat):
    """Change the values of an estimate by an interval with a heating power; return the rows used.

    tau dw/dt + q dy/dt = p - (w - a), see `minorloop_head.heated_wire.HeatedWire.step`.
    """
    lag, latent, interval, solves = wire
    before = values[POWER]
    gap, stiff = interval * (heat - (before - values[AMBIENT])), lag + interval
    values[WAY] = 0.0
    if abs(gap / stiff) < SMALLEST_CHANGE:
        return rows
    power, angle = values[POWER : POWER + 1], values[ANGLE : ANGLE + 1]
    rows = push_balance(plane, stack, rows, gap, stiff, latent, int(solves), power, angle)
    values[WAY] = values[POWER] - before
    return rows


@njit(cache=True, nogil=True)
def correct(plane, stack, rows, ends, gains, values, off):
    """Change the values of an estimate by the difference of a reading from it; return the rows."""
    rate, learning, keep, dead, mean, flattest, most_offset, largest, bound = gains
    error = off + (values[ERROR] - off) * keep
    values[ERROR] = error
    size = abs(error) - dead
    if size <= 0.0:
        return rows
    beyond = size if error > 0.0 else -size
    towards, angle, offset = rate * beyond, values[ANGLE], values[OFFSET]
    change = _aimed(plane, stack, rows, ends, angle + towards) - values[POWER]
    onward = abs(towards) if values[WAY] >= 0.0 else -abs(towards)
    ahead = abs(_aimed(plane, stack, rows, ends, angle + onward) - values[POWER])
    share = min(abs(towards) / (mean * ahead), 1.0) if ahead > 0.0 else 0.0
    if abs(offset) > most_offset and offset * beyond > 0.0:
        share = 1.0
    most = abs(towards) / flattest
    learnt = min(max(beyond, -largest), largest) / flattest
    values[AMBIENT] = min(max(values[AMBIENT] + share * learning * learnt, -bound), bound)
    values[OFFSET] = offset + (1.0 - share) * towards - share * rate * offset
    values[POWER] += share * min(max(change, -most), most)
    power, angles = values[POWER : POWER + 1], values[ANGLE : ANGLE + 1]
    return simulate(plane, stack, rows, power, angles)


@njit(cache=True, nogil=True)
def compare(
    plane, stacks, rows, wire, ends, gains, delays, values, past, squares, powers, readings, share
):
    """Advance estimates (N, 6) with delays (N,) by intervals with powers and readings, both (T,).

    A reading may be NaN. ``past`` (N, D) are the angles of the estimates, newest first; ``squares``
    (N,) their mean square errors, of which a reading changes a ``share``. They, the estimates and
    their stacks (N, rows, 4) are changed.
    """
    for k in range(delays.size):
        used, delay, later = rows[k], delays[k], past[k]
        for t in range(powers.size):
            used = predict(plane, stacks[k], used, wire, values[k], powers[t])
            expected = later[delay - 1] if delay > 0 else values[k, ANGLE]
            off = readings[t] - expected - values[k, OFFSET]
            if np.isnan(off):
                values[k, ERROR] = 0.0
            else:
                squares[k] += share * (off * off - squares[k])
                used = correct(plane, stacks[k], used, ends, gains[k], values[k], off)
            later[1:] = later[:-1].copy()
            later[0] = values[k, ANGLE]
        rows[k] = used
