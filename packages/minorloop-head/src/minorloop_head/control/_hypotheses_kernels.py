"""Compiled loops over the hypotheses about the surroundings: arrays in, arrays out.

``branch`` is the table of the rising branch, ``low`` its first power in A^2 and ``scale`` its
points per A^2. ``around`` (4, M) has of each hypothesis the power to which its ambient is
equivalent for a hot wire, its convection, its cold resistance over the hot one, and how much
steeper than the table its branch is from where the table begins to rise.
"""

import numpy as np
from numba import njit

LEAST_RISE = 0.5
"""Degrees below which a branch counts as flat: ten times the noise of the holds behind it."""


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def place(power, low, scale, points, flat, steeper):
    """Return where a power lies in the table: index to the left, and share of the step."""
    at = flat + steeper * ((power - low) * scale - flat)
    at = min(max(at, 0.0), points - 1.000001)
    left = np.int32(at)
    return left, at - left


@njit(cache=True, nogil=True)
def last_flat(branch):
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

    Also the least cost of those that are not ``colder`` (M,), less that of those that are.
    ``ends`` are the least and the greatest angle, ``wire`` lag and latent heat; ``misses`` are the
    error that counts as one, the largest, the weight of a reading, and what a cost keeps.
    """
    unit, most, news, keep = misses
    if np.isnan(reading):
        reading, news, keep = 0.0, 0.0, 1.0
    after, costs = np.empty_like(power), np.empty_like(cost)
    flat = last_flat(branch)
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

    The branch of each hypothesis is taken to be off by its error at the present angle and by
    ``beyond`` (M,). A hotter wire has more resistance, so that its angle feeds back: the iteration
    rises from the present angle to the next equilibrium. ``stop`` are the change in degrees and
    the number of iterations that end it.
    """
    near, most = stop
    out = np.empty_like(power)
    flat = last_flat(branch)
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
