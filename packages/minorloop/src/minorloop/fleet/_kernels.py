"""Compiled loops over many operators that share a plane (`PlaneTables`): arrays in, arrays out.

Each operator has its own stack of bounded length, as `minorloop.operators._kernels` describes it.
If a stack is full, the two extrema whose loss changes the output least are dropped.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop.operators._kernels import BAND, FRACTION, OUTPUT, VALUE, everett_inside, simulate


@njit(cache=True, nogil=True)
def between(nodes, bow, high, low):
    """Weight of the relays between two rows of a stack, times their swing."""
    return everett_inside(
        nodes, bow, int(high[BAND]), high[FRACTION], int(low[BAND]), low[FRACTION]
    )


@njit(cache=True, nogil=True)
def loss(nodes, bow, stack, k):
    """Change of the output, in absolute weights, if rows k and k + 1 are dropped."""
    a, b, c, d = stack[k - 1], stack[k], stack[k + 1], stack[k + 2]
    if k & 1:
        total = between(nodes, bow, b, a) - between(nodes, bow, b, c)
        total += between(nodes, bow, d, c) - between(nodes, bow, d, a)
    else:
        total = between(nodes, bow, a, b) - between(nodes, bow, c, b)
        total += between(nodes, bow, c, d) - between(nodes, bow, a, d)
    return abs(total)


@njit(cache=True, nogil=True)
def _drop_smallest(plane, sizes, size_bow, stack, n):
    """Drop the pair of past extrema with the least loss.

    Returns the rows in use, the loss, and the two inputs between which the loss lasts.
    """
    least, smallest = 1, np.inf
    for k in range(1, n - 3):
        found = loss(sizes, size_bow, stack, k)
        if found < smallest:
            least, smallest = k, found
    after, before = stack[least + 2], stack[least - 1]
    low = min(before[VALUE], stack[least, VALUE])
    high = max(before[VALUE], stack[least, VALUE])
    if least & 1:
        output = before[OUTPUT] + between(plane.nodes, plane.bow, after, before)
    else:
        output = before[OUTPUT] - between(plane.nodes, plane.bow, before, after)
    change = after[OUTPUT] - output
    for k in range(least, n - 2):
        for column in range(stack.shape[1]):
            stack[k, column] = stack[k + 2, column]
        stack[k, OUTPUT] -= change
    return n - 2, smallest, low, high


@njit(cache=True, nogil=True)
def march(plane, sizes, size_bow, stacks, rows, lost, within, u, y, first, last):
    """Fill y with the outputs of operators first to last for their inputs (operators, T).

    A loss lasts until an input passes the wider extrema of the dropped pair.
    """
    room = stacks.shape[1]
    for k in range(first, last):
        stack, n = stacks[k], rows[k]
        for t in range(u.shape[1]):
            n = simulate(plane, stack, n, u[k, t : t + 1], y[k, t : t + 1])
            if lost[k] > 0.0 and not within[k, 0] < u[k, t] < within[k, 1]:
                lost[k] = 0.0
            if n >= room:
                n, found, low, high = _drop_smallest(plane, sizes, size_bow, stack, n)
                within[k, 0] = low if lost[k] == 0.0 else min(low, within[k, 0])
                within[k, 1] = high if lost[k] == 0.0 else max(high, within[k, 1])
                lost[k] += found
        rows[k] = n
