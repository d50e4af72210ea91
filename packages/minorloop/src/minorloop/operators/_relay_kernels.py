"""Compiled loops of the relay-by-relay model: arrays in, arrays out.

``on`` is the (N, N) array of relay states, 1 or 0, and ``level`` the index of the highest
level at or below the input, the marker; both belong to the caller and ``on`` is changed.
Outputs are the weight that is switched on.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def move(levels, on, level, u):
    """Move the input to u, one level at a time; return the highest level that it reaches."""
    while level + 1 < levels.size and u >= levels[level + 1]:
        level += 1
        on[level, : level + 1] = 1.0
    while level >= 0 and u < levels[level]:
        on[level:, level] = 0.0
        level -= 1
    return level


@njit(cache=True, nogil=True)
def total(weights, on):
    """Return the weight that is switched on."""
    out = 0.0
    for a in range(weights.shape[0]):
        for b in range(a + 1):
            out += weights[a, b] * on[a, b]
    return out


@njit(cache=True, nogil=True)
def simulate(levels, weights, on, level, u, y):
    """Fill y with the outputs for an input signal."""
    for t in range(u.size):
        level = move(levels, on, level, u[t])
        y[t] = total(weights, on)


@njit(cache=True, nogil=True)
def stepping_inverse(levels, weights, on, level, targets, u, y, reachable):
    """Step level by level until each target is passed; fill inputs, outputs and ``reachable``."""
    for t in range(targets.size):
        now = total(weights, on)
        way = 1 if targets[t] > now else -1
        trial = on.copy()
        k = max(level, 0)
        y[t] = now
        while way * (targets[t] - y[t]) > 0 and 0 <= k + way < levels.size:
            k += way
            move(levels, trial, k - way, levels[k])
            y[t] = total(weights, trial)
        u[t] = levels[k]
        level = move(levels, on, level, u[t])
        y[t] = total(weights, on)
        reachable[t] = way * (targets[t] - y[t]) <= 0
