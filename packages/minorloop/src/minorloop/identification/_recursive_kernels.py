"""Compiled loops of recursive identification: arrays in, arrays out."""

from __future__ import annotations

from numba import njit


@njit(cache=True, nogil=True)
def absorb(information, vector, row, y, forgetting, prior, theta):
    """Forget, add one sample, and leak towards the present unknowns, in place."""
    n = row.size
    for i in range(n):
        for j in range(n):
            information[i, j] = forgetting * information[i, j] + row[i] * row[j]
        information[i, i] += (1.0 - forgetting) * prior
        vector[i] = forgetting * vector[i] + row[i] * y + (1.0 - forgetting) * prior * theta[i]


@njit(cache=True, nogil=True)
def descend(information, vector, theta, bounded, sweeps):
    """Improve the unknowns in place by coordinate descent; bounded unknowns stay >= 0."""
    n = theta.size
    for _ in range(sweeps):
        for i in range(n):
            slack = vector[i]
            for j in range(n):
                slack -= information[i, j] * theta[j]
            moved = theta[i] + slack / information[i, i]
            theta[i] = max(moved, 0.0) if bounded[i] else moved
