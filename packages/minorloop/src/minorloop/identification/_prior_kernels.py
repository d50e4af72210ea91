"""Compiled loops of the prior on the plane: arrays in, arrays out."""

import numpy as np
from numba import njit

from minorloop.operators._memory_kernels import copy_extrema, push, switched_on


@njit(cache=True, nogil=True)
def walk(levels, spread, past, u, measured, rows, features):
    """Compute the fractions switched on and features of the memory after every measured input.

    ``past`` (d,) are the extrema before the first input; ``rows`` (M, K) is filled with the
    fractions, ``features`` (M, 3) with the present input and the last two extrema, from 0 to 1.
    """
    low, high = levels[0], levels[-1]
    stack = np.empty(past.size + u.size + 2)
    copy_extrema(past, past.size, stack)
    depth = past.size
    m = 0
    for t in range(u.size):
        depth = push(stack, depth, min(max(u[t], low), high))
        if not measured[t]:
            continue
        switched_on(levels, spread, stack, depth, rows[m])
        for k in range(3):
            features[m, k] = (stack[max(depth - 1 - k, 0)] - low) / (high - low)
        m += 1


@njit(cache=True, nogil=True)
def look_ahead(levels, spread, past, candidates, rows):
    """Fill ``rows`` with fractions switched on after extrema ``past`` (d,) and a candidate (m,)."""
    low, high = levels[0], levels[-1]
    stack = np.empty(past.size + 2)
    for m in range(candidates.size):
        copy_extrema(past, past.size, stack)
        depth = push(stack, past.size, min(max(candidates[m], low), high))
        switched_on(levels, spread, stack, depth, rows[m])


@njit(cache=True, nogil=True)
def overshoot(u, low, high, out):
    """Compute the overshoot (T,) beyond an end of the levels; it fades towards the other end."""
    below = above = 0.0
    for t in range(u.size):
        if u[t] <= low:
            below, above = max(below, low - u[t]), 0.0
        elif u[t] >= high:
            below, above = 0.0, max(above, u[t] - high)
        inside = min(max(u[t], low), high)
        out[t] = (below * (high - inside) + above * (inside - low)) / (high - low)


@njit(cache=True, nogil=True)
def closed_travel(u, near, farthest, out):
    """Compute the travel in closed loops (T,) since the input last was more than ``near`` away.

    It is the travel minus the shortest travel through the same inputs, at most ``farthest``.
    """
    places = np.empty(u.size, np.int64)  # of the inputs that differ from the previous input
    count = 0
    for t in range(u.size):
        if t == 0 or u[t] != u[places[count - 1]]:
            places[count] = t
            count += 1
        way, low, high = 0.0, u[t], u[t]
        k = count - 1
        while k > 0 and abs(u[places[k - 1]] - u[t]) <= near and way < 2.0 * farthest:
            way += abs(u[places[k]] - u[places[k - 1]])
            k -= 1
            low, high = min(low, u[places[k]]), max(high, u[places[k]])
        shortest = 2.0 * (high - low) - abs(u[places[k]] - u[t])
        out[t] = min(max(way - shortest, 0.0), farthest)
