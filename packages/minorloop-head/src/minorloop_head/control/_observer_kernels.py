"""Compiled steps of an observer of a wire, and loops over its newest readings and its hypotheses.

Arrays in, arrays out.

The operator is a `PlaneTables` with its stack of extrema and the rows in use. ``wire`` is lag,
latent heat, interval and iterations for the slope; ``gains`` are those of
`minorloop_head.control.observer.PowerObserver.gains`.

``branch`` is the table of the rising branch, ``low`` its first power in A^2 and ``scale`` its
points per A^2. ``around`` (4, M) has for each hypothesis the power to which its ambient is
equivalent for a hot wire, its convection, its cold resistance over the hot one, and the slope of
its branch over that of the table, less 1, from where the table begins to rise.
"""

import numpy as np
from numba import njit

from minorloop.operators._kernels import aim, push_balance, simulate
from minorloop_head.heated_wire import SMALLEST_CHANGE

_POWER, ANGLE, AMBIENT, ERROR, OFFSET, _WAY = range(6)
"""Places in the values of an estimate."""
LEAST_RISE = 0.5
"""Degrees below which a branch counts as flat: ten times the noise of the holds of its fit."""


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
    before = values[_POWER]
    gap, stiff = interval * (heat - (before - values[AMBIENT])), lag + interval
    values[_WAY] = 0.0
    if abs(gap / stiff) < SMALLEST_CHANGE:
        return rows
    power, angle = values[_POWER : _POWER + 1], values[ANGLE : ANGLE + 1]
    rows = push_balance(plane, stack, rows, gap, stiff, latent, int(solves), power, angle)
    values[_WAY] = values[_POWER] - before
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
    change = _aimed(plane, stack, rows, ends, angle + towards) - values[_POWER]
    onward = abs(towards) if values[_WAY] >= 0.0 else -abs(towards)
    ahead = abs(_aimed(plane, stack, rows, ends, angle + onward) - values[_POWER])
    share = min(abs(towards) / (mean * ahead), 1.0) if ahead > 0.0 else 0.0
    if abs(offset) > most_offset and offset * beyond > 0.0:
        share = 1.0
    most = abs(towards) / flattest
    learnt = min(max(beyond, -largest), largest) / flattest
    values[AMBIENT] = min(max(values[AMBIENT] + share * learning * learnt, -bound), bound)
    values[OFFSET] = offset + (1.0 - share) * towards - share * rate * offset
    values[_POWER] += share * min(max(change, -most), most)
    power, angles = values[_POWER : _POWER + 1], values[ANGLE : ANGLE + 1]
    return simulate(plane, stack, rows, power, angles)


@njit(cache=True, nogil=True)
def compare(
    plane, stacks, rows, wire, ends, gains, delays, values, past, squares, powers, readings, share
):
    """Advance estimates (N, 6) with delays (N,) by intervals with powers and readings, both (T,).

    A reading may be NaN. ``past`` (N, D) are the angles of the estimates, newest first; ``squares``
    (N,) their mean square errors, in which a reading has the weight ``share``. They, the estimates
    and their stacks (N, rows, 4) are changed.
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


@njit(cache=True, nogil=True)
def added(recent, power, angle, reading, steps, most):
    """Return powers, angles and readings (3, n) with ``steps`` more; the last has a reading.

    The oldest are dropped: ``n`` is at most ``most``.
    """
    before = recent.shape[1]
    count = min(before + steps, most)
    kept = max(count - steps, 0)
    after = np.empty((3, count))
    after[:, :kept] = recent[:, before - kept :]
    after[0, kept:], after[1, kept:], after[2, kept:] = power, angle, np.nan
    after[2, count - 1] = reading
    return after


@njit(cache=True, nogil=True)
def _interpolated(readings):
    """Return readings with missing ones interpolated between their neighbours."""
    filled = readings.copy()
    last = -1
    for k in range(readings.size):
        if not np.isfinite(readings[k]):
            continue
        for gap in range(last + 1, k):
            share = (gap - last) / (k - last)
            filled[gap] = readings[k]
            if last >= 0:
                filled[gap] = readings[last] + share * (readings[k] - readings[last])
        last = k
    filled[last + 1 :] = readings[last]
    return filled


@njit(cache=True, nogil=True)
def slowing(readings, count, seen, moved, over, slower, back):
    """Return the rates (count,) of a motion that gets slower, in degrees a second; empty otherwise.

    At least a share ``seen`` of the newest ``count`` readings must exist, and they must vary by
    ``moved`` degrees. A rate is taken over ``over``: a number of readings, and their time in
    seconds. It must fall by ``slower`` from the first quarter to the last, and reverse by at most
    ``back``.
    """
    none = np.empty(0)
    known, low, high = 0, np.inf, -np.inf
    for k in range(readings.size):
        if np.isfinite(readings[k]):
            known += k >= readings.size - count
            low, high = min(low, readings[k]), max(high, readings[k])
    if known < seen * count or not high - low >= moved:
        return none
    angles = _interpolated(readings)
    steps, seconds = over
    rates, first = np.empty(count), readings.size - count
    way = 1.0 if angles[-1] >= angles[first] else -1.0
    for k in range(count):
        rates[k] = (angles[first + k] - angles[first + k - steps]) / seconds
        if way * rates[k] < -back:
            return none
    part = count // 4
    fell = way * (rates[:part].mean() - rates[count - part :].mean())
    return rates if fell >= slower else none


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def place(power, low, scale, points, flat, steeper):
    """Return the position of a power in the table: index to the left, and share of the step."""
    at = flat + steeper * ((power - low) * scale - flat)
    at = min(max(at, 0.0), points - 1.000001)
    left = np.int32(at)
    return left, at - left


@njit(cache=True, nogil=True)
def _last_flat(branch):
    """Return the last point of the table before it rises."""
    flat = 0
    while flat < branch.size - 1 and branch[flat + 1] - branch[0] < LEAST_RISE:
        flat += 1
    return flat


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def equivalent(ambient, resistance, angle, ends):
    """Return the power to which an ambient is equivalent for a wire at an angle, in A^2."""
    hot = min(max((angle - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)
    return ambient / (resistance + (1.0 - resistance) * hot)


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def advance(
    power, cost, branch, low, scale, around, colder, ends, wire, heat, interval, reading, misses
):
    """Return powers and costs (M,) after an interval with a heating power and a reading, or NaN.

    Also the least cost of hypotheses that are not ``colder`` (M,), less that of colder ones.
    ``ends`` are the least and the greatest angle, ``wire`` lag and latent heat; ``misses`` are the
    unit of errors, their limit, the weight of a reading, and the share of a cost that remains.
    """
    unit, most, news, keep = misses
    if np.isnan(reading):
        reading, news, keep = 0.0, 0.0, 1.0
    after, costs = np.empty_like(power), np.empty_like(cost)
    flat = _last_flat(branch)
    for k in range(power.size):
        left, share = place(power[k], low, scale, branch.size, flat, around[3, k])
        rise = branch[left + 1] - branch[left]
        angle = branch[left] + share * rise
        ambient = equivalent(around[0, k], around[2, k], angle, ends)
        gap = heat - around[1, k] * (power[k] - ambient)
        stiff = wire[0] + around[1, k] * interval + wire[1] * rise * scale * around[3, k]
        after[k] = power[k] + interval * gap / stiff
        miss = min(abs(reading - angle) / unit, most)
        costs[k] = cost[k] * keep + miss * miss * news
    other, cold = np.inf, np.inf
    for k in range(power.size):
        if colder[k]:
            cold = min(cold, costs[k])
        else:
            other = min(other, costs[k])
    return after, costs, other - cold


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def settled(power, branch, low, scale, around, ends, heat, angle, beyond, stop):
    """Return the final angles (M,) under a heating power for a wire that is at an angle now.

    The branch of each hypothesis is shifted by its error at the present angle and by ``beyond``
    (M,). The resistance depends on the angle, which feeds back: the iteration rises from the
    present angle to the next equilibrium. ``stop`` are the change in degrees and the number of
    iterations that end it.
    """
    near, most = stop
    out = np.empty_like(power)
    flat = _last_flat(branch)
    for k in range(power.size):
        left, share = place(power[k], low, scale, branch.size, flat, around[3, k])
        error = angle - branch[left] - share * (branch[left + 1] - branch[left]) + beyond[k]
        at = angle
        for _ in range(most):
            reached = equivalent(around[0, k], around[2, k], at, ends) + heat / around[1, k]
            left, share = place(reached, low, scale, branch.size, flat, around[3, k])
            before = at
            at = min(branch[left] + share * (branch[left + 1] - branch[left]) + error, ends[1])
            if abs(at - before) < near:
                break
        out[k] = at
    return out
