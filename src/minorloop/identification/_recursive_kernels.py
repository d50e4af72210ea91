"""Compiled loops of recursive identification: arrays in, arrays out."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def switched_on(levels, extrema, spread, out):
    """Fraction of every cell that is switched on, packed row by row.

    The memory is a staircase: between two minima, all relays up to the maximum after the first
    of them are on. Each step of it covers a rectangle of every cell it crosses, and a corner of
    the triangles on the diagonal.
    """
    bands = levels.size - 1
    out[:] = 0.0
    steps = extrema.size // 2
    for k in range(steps):
        low, top = extrema[2 * k], extrema[2 * k + 1]
        high = extrema[2 * k + 2] if 2 * k + 2 < extrema.size else top
        for j in range(bands):
            p, q = max(low, levels[j]), min(high, levels[j + 1])
            if q <= p:
                continue
            width = levels[j + 1] - levels[j]
            for i in range(j, bands):
                if top <= levels[i]:
                    break
                height = levels[i + 1] - levels[i]
                t = min(top, levels[i + 1])
                cell = i * (i + 1) // 2 + j
                if i > j:
                    out[cell] += (q - p) * (t - levels[i]) / (width * height)
                elif spread:
                    end = min(q, t)
                    out[cell] += ((t - p) ** 2 - (t - end) ** 2) / height**2
                else:
                    out[cell] += (min(q, t) - p) / height


@njit(cache=True, nogil=True)
def absorb(information, vector, row, y, forgetting, prior, theta):
    """In place: forget, add one sample, and leak towards the present unknowns."""
    n = row.size
    for i in range(n):
        for j in range(n):
            information[i, j] = forgetting * information[i, j] + row[i] * row[j]
        information[i, i] += (1.0 - forgetting) * prior
        vector[i] = forgetting * vector[i] + row[i] * y + (1.0 - forgetting) * prior * theta[i]


@njit(cache=True, nogil=True)
def descend(information, vector, theta, bounded, sweeps):
    """In place: sweeps of coordinate descent on the unknowns, the bounded ones kept >= 0."""
    n = theta.size
    for _ in range(sweeps):
        for i in range(n):
            slack = vector[i]
            for j in range(n):
                slack -= information[i, j] * theta[j]
            moved = theta[i] + slack / information[i, i]
            theta[i] = max(moved, 0.0) if bounded[i] else moved
