"""Compiled loops over the newest readings of a wire: arrays in, arrays out."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def added(recent, power, angle, reading, steps, most):
    """Return powers, angles and readings (3, n) with so many steps more; the last has a reading.

    The oldest are dropped, so that ``n`` is ``most`` at most.
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
def _filled(readings):
    """Return readings with those that are missing put on the line between their neighbours."""
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
    """Return the rates (count,) of a motion that gets slower, in degrees a second; else none.

    At least a share ``seen`` of the newest ``count`` readings must be there, and all must vary by
    ``moved`` degrees. A rate is taken over ``over``: a number of readings, and their time in
    seconds. It must fall by ``slower`` from the first quarter to the last, and go back by at most
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
    angles = _filled(readings)
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
