"""Compiled loops of weighted plays: they take and return only arrays.

``positions`` (n,) are the positions of the plays; the loops update them to the positions after the
last sample. ``slopes[i]`` is the sum of the weights up to play i: the slope of the output while
exactly the plays up to i move.
"""

from __future__ import annotations

import math

from numba import njit

from minorloop.operators._memory_kernels import INSIDE


@njit(cache=True, nogil=True)
def simulate(u, radii, slopes, offset, positions, y):
    """Fill ``y`` (T,) with the output after each sample of ``u`` (T,)."""
    for t in range(u.size):
        move(u[t], radii, positions)
        y[t] = offset + weigh(slopes, positions)


@njit(cache=True, nogil=True)
def trace(u, radii, positions, out):
    """Fill ``out`` (T, n) with the positions after each sample of ``u`` (T,)."""
    for t in range(u.size):
        move(u[t], radii, positions)
        for i in range(radii.size):
            out[t, i] = positions[i]


@njit(cache=True, nogil=True)
def invert(targets, radii, slopes, offset, positions, u):
    """Fill ``u`` (T,) with the inputs that bring the output to each of ``targets`` (T,)."""
    for t in range(targets.size):
        u[t] = aim(targets[t] - offset, radii, slopes, positions)
        move(u[t], radii, positions)


@njit(**INSIDE)
def move(u, radii, positions):
    """Update the position of every play for one sample."""
    for i in range(radii.size):
        low, high = u - radii[i], u + radii[i]
        if positions[i] < low:
            positions[i] = low
        elif positions[i] > high:
            positions[i] = high


@njit(cache=True, nogil=True)
def weigh(slopes, places):
    """Return the weighted sum of places, one for each play.

    The sum is over slopes times gaps between neighbours: weights of both signs would cancel.
    """
    last = slopes.size - 1
    total = slopes[last] * places[last]
    for i in range(last):
        total += slopes[i] * (places[i] - places[i + 1])
    return total


@njit(cache=True, nogil=True)
def aim(target, radii, slopes, positions):
    """Return the input for one target, along the branch from the present state.

    On this branch the plays begin to move in the order of their radii. The pieces of the branch are
    those of the analytic inverse, but rounding errors of a flat piece do not grow on a steep piece.
    """
    last = radii.size - 1
    if math.isinf(positions[0]):
        lag = weigh(slopes, radii)
        return (target + (lag if positions[0] < 0 else -lag)) / slopes[last]
    rest = target - weigh(slopes, positions)
    side = 1.0 if rest > 0 else -1.0
    u = positions[0]
    for i in range(last):
        corner = positions[i + 1] + side * radii[i + 1]
        gain = slopes[i] * (corner - u)
        if abs(rest) <= abs(gain):
            return u + rest / slopes[i]
        rest -= gain
        u = corner
    return u + rest / slopes[last]
