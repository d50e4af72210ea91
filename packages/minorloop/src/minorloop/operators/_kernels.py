"""Compiled loops of the Preisach operator: arrays in, arrays out.

The state is a *stack*, a (capacity, 4) array whose row k describes one remembered extremum:

    0  value      the input there
    1  output     the output of the relays there
    2  band       its band of the plane
    3  fraction   its place in this band, from 0 at the lower threshold to 1 at the upper

Even rows are minima, odd rows maxima, row 0 is negative saturation, and the last row is the
present input. Between two reversals the output differs from that at the last reversal by a
single Everett value, so one sample takes one look-up, for any number of bands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from minorloop.arrays import FloatArray, IntArray
from minorloop.operators._memory_kernels import INSIDE, wipes_out

VALUE, OUTPUT, BAND, FRACTION = 0, 1, 2, 3
"""Columns of the stack of extrema: input, output, band of the levels, and share of that band."""
_CROWDED = 8  # more thresholds than this in one bucket are searched by bisection


class PlaneTables(NamedTuple):
    """A Preisach plane in the format of the loops.

    levels (L + 1,); per_band (L,): reciprocal height of each band; buckets: for equal slices
    of the input range, the last band that begins before the slice; per_unit: slices per unit of
    input; nodes (L + 1, L + 1): Everett values at
    the nodes times the swing of a relay; bow (L,): curvature of the surface inside a band;
    saturation: output of the relays when all are off; slope: of the memoryless linear part.
    """

    levels: FloatArray
    per_band: FloatArray
    buckets: IntArray
    per_unit: float
    nodes: FloatArray
    bow: FloatArray
    saturation: float
    slope: float


Plane = PlaneTables
"""Name by which caches of kernels that were compiled before know it; they fail to load without."""


@njit(**INSIDE)
def band_of(levels, buckets, per_unit, u):
    """Band that contains u, for u inside the grid: find a bucket, then search in it.

    An input that is not a number gives the first bucket.
    """
    place = (u - levels[0]) * per_unit
    bucket = int(place) if place > 0.0 else 0
    low, high = buckets[bucket], buckets[bucket + 1]
    while high - low > _CROWDED:
        middle = (low + high) // 2
        if levels[middle] <= u:
            low = middle
        else:
            high = middle - 1
    while low < high and levels[low + 1] <= u:
        low += 1
    return low


@njit(**INSIDE)
def everett_inside(nodes, bow, i, s, j, f):
    """Everett value at alpha = fraction s of band i, beta = fraction f of band j <= i.

    It is bilinear in the nodes, minus a bow in each band if the density is spread over the
    triangles of the diagonal (piecewise uniform density).
    """
    if i == j:
        x = s - f
        return nodes[i + 1, i] * x - bow[i] * x * (1.0 - x)
    lower = nodes[i, j] + f * (nodes[i, j + 1] - nodes[i, j])
    upper = nodes[i + 1, j] + f * (nodes[i + 1, j + 1] - nodes[i + 1, j])
    return lower + s * (upper - lower) - bow[i] * s * (1.0 - s) - bow[j] * f * (1.0 - f)


@njit(cache=True, nogil=True)
def simulate(plane, stack, n, u, y):
    """Fill y with the outputs for a whole input; return the rows in use at the end.

    An input that is not a number gives such an output, and does not change the memory.

    Reduced memory sequence: Mayergoyz, Mathematical Models of Hysteresis, 1991, chapter 1.

    The present input and the last extremum (the pivot) are in local variables, not on the stack:
    to read them back would take longer than all the arithmetic.
    """
    levels, per_band, buckets, per_unit, nodes, bow, saturation, slope = plane
    lowest, highest = levels[0], levels[-1]
    top = n - 1
    value, output = stack[top, VALUE], stack[top, OUTPUT]
    band, fraction = int(stack[top, BAND]), stack[top, FRACTION]
    pivot = max(top - 1, 0)
    pivot_output = stack[pivot, OUTPUT]
    pivot_band, pivot_fraction = int(stack[pivot, BAND]), stack[pivot, FRACTION]
    for t in range(u.size):
        x = u[t]
        if x < lowest:
            x = lowest
        elif x > highest:
            x = highest
        if x != value and not math.isnan(x):
            rising = x > value
            if rising == (top & 1 == 0):  # a reversal: the present extremum becomes the pivot
                stack[top, VALUE], stack[top, OUTPUT] = value, output
                stack[top, BAND], stack[top, FRACTION] = band, fraction
                pivot_output, pivot_band, pivot_fraction = output, band, fraction
                top += 1
            before = top
            while top >= 2 and wipes_out(x, top, stack[top - 2, VALUE], rising):
                top -= 2
            if top < before and top > 0:
                pivot_output = stack[top - 1, OUTPUT]
                pivot_band, pivot_fraction = int(stack[top - 1, BAND]), stack[top - 1, FRACTION]
            value = x
            band = band_of(levels, buckets, per_unit, x)
            fraction = (x - levels[band]) * per_band[band]
            if top == 0:
                output = saturation
            elif rising:
                change = everett_inside(nodes, bow, band, fraction, pivot_band, pivot_fraction)
                output = pivot_output + change
            else:
                change = everett_inside(nodes, bow, pivot_band, pivot_fraction, band, fraction)
                output = pivot_output - change
        y[t] = output + slope * u[t]
    stack[top, VALUE], stack[top, OUTPUT] = value, output
    stack[top, BAND], stack[top, FRACTION] = band, fraction
    return top + 1


@njit(cache=True, nogil=True)
def push_balance(plane, stack, n, gap, stiff, drag, solves, u, y):
    """Move the input by du, the output by dy, where stiff du + drag dy = gap; return the rows used.

    ``u`` (1,) and ``y`` (1,) are changed. The slope dy / du is found by ``solves`` fixed-point
    iterations, on a copy of the stack.
    """
    change, before, spare = gap / stiff, y[0], np.empty((n + 2, stack.shape[1]))
    there = np.empty(1)
    for _ in range(solves if drag > 0.0 else 0):
        for row in range(n):
            for column in range(stack.shape[1]):
                spare[row, column] = stack[row, column]
        there[0] = u[0] + change
        simulate(plane, spare, n, there, y)
        change = gap / (stiff + drag * (y[0] - before) / change)
    u[0] += change
    return simulate(plane, stack, n, u, y)


@njit(cache=True, nogil=True)
def everett(plane, alpha, beta, out):
    """Everett values for pairs alpha >= beta inside the grid."""
    levels, per_band, buckets, per_unit, nodes, bow, _, _ = plane
    for k in range(alpha.size):
        i = band_of(levels, buckets, per_unit, alpha[k])
        j = band_of(levels, buckets, per_unit, beta[k])
        s, f = (alpha[k] - levels[i]) * per_band[i], (beta[k] - levels[j]) * per_band[j]
        out[k] = everett_inside(nodes, bow, i, s, j, f)


@njit(cache=True, nogil=True)
def along(levels, nodes, bow, slope, pivot, rising, band, fraction):
    """Output, slope included, on the branch that leaves the pivot, a row of the stack."""
    u = levels[band] + fraction * (levels[band + 1] - levels[band])
    i, s = int(pivot[BAND]), pivot[FRACTION]
    if rising:
        change = everett_inside(nodes, bow, band, fraction, i, s)
    else:
        change = -everett_inside(nodes, bow, i, s, band, fraction)
    return pivot[OUTPUT] + change + slope * u


@njit(cache=True, nogil=True)
def _smallest_root(c0, c1, c2):
    """Smallest x >= 0 with c0 + c1 x + c2 x^2 = 0, given c0 <= 0 and a rise somewhere in [0, 1].

    The formula avoids cancellation: the root is c0 over the larger of two sums. Coefficients are
    divided by the largest, so that no square overflows or vanishes.
    """
    if c0 >= 0.0:
        return 0.0
    size = max(-c0, abs(c1), abs(c2))
    c0, c1, c2 = c0 / size, c1 / size, c2 / size
    below = c1 + np.sqrt(max(c1 * c1 - 4.0 * c2 * c0, 0.0))
    if below <= 0.0:
        return 1.0
    return min(-2.0 * c0 / below, 1.0)


@njit(cache=True, nogil=True)
def _branch_input(levels, nodes, bow, slope, pivot, rising, band, target):
    """Input in ``band`` at which the branch from the pivot meets the target.

    Inside a band the branch is quadratic; three of its points determine it exactly.
    """
    start, end, sign = (0.0, 1.0, 1.0) if rising else (1.0, 0.0, -1.0)
    if band == int(pivot[BAND]):
        start = pivot[FRACTION]
    middle = 0.5 * (start + end)
    y0 = sign * (along(levels, nodes, bow, slope, pivot, rising, band, start) - target)
    yh = sign * (along(levels, nodes, bow, slope, pivot, rising, band, middle) - target)
    y1 = sign * (along(levels, nodes, bow, slope, pivot, rising, band, end) - target)
    if y1 < 0.0:  # beyond the far end; the sums below may overflow
        return levels[band + 1] if rising else levels[band]
    x = _smallest_root(y0, -3.0 * y0 + 4.0 * yh - y1, 2.0 * (y0 + y1 - 2.0 * yh))
    fraction = start + x * (end - start)
    if fraction == 1.0:
        return levels[band + 1]
    return levels[band] + fraction * (levels[band + 1] - levels[band])


@njit(cache=True, nogil=True)
def _branch_band(levels, nodes, bow, slope, pivot, rising, near, stop, target):
    """First band from ``near`` to ``stop`` at whose far end the target is reached."""
    if rising:
        low, high = near, stop
        while low < high:
            middle = (low + high) >> 1
            if along(levels, nodes, bow, slope, pivot, True, middle, 1.0) >= target:
                high = middle
            else:
                low = middle + 1
        return low
    low, high = stop, near
    while low < high:
        middle = (low + high + 1) >> 1
        if along(levels, nodes, bow, slope, pivot, False, middle, 0.0) <= target:
            low = middle
        else:
            high = middle - 1
    return low


@njit(cache=True, nogil=True)
def aim(plane, stack, n, target):
    """Nearest input that brings the output to the target; the stack does not change.

    A target that is not a number gives such an input.

    Tan, Venkataraman and Krishnaprasad, Proc. IEEE CDC 2001: go from breakpoint to breakpoint until
    the target lies before the next one, then solve the piece. Breakpoints are the thresholds and
    the remembered extrema. An input that passes an extremum wipes it out; its output is on the
    stack.
    """
    levels, _, _, _, nodes, bow, _, slope = plane
    value = stack[n - 1, VALUE]
    here = stack[n - 1, OUTPUT] + slope * value
    if target == here:
        return value
    if math.isnan(target):
        return target
    rising = target > here
    sign = 1.0 if rising else -1.0
    top = n - 1
    if rising == (top & 1 == 0):
        top += 1
    limit, stop = (levels[-1], levels.size - 2) if rising else (levels[0], 0)
    while top >= 2 + rising:
        ahead = stack[top - 2]
        if sign * (target - ahead[OUTPUT] - slope * ahead[VALUE]) <= 0.0:
            limit, stop = ahead[VALUE], int(ahead[BAND])
            break
        top -= 2
    if top == 0:
        return levels[0]
    pivot = stack[top - 1]
    near = int(stack[n - 1, BAND])
    band = _branch_band(levels, nodes, bow, slope, pivot, rising, near, stop, target)
    u = _branch_input(levels, nodes, bow, slope, pivot, rising, band, target)
    if rising:
        return min(max(u, value), limit)
    return max(min(u, value), limit)


@njit(cache=True, nogil=True)
def invert(plane, stack, n, targets, u, y):
    """Inputs that meet the targets one after the other, and the outputs for these inputs."""
    for t in range(targets.size):
        u[t] = aim(plane, stack, n, targets[t])
        n = simulate(plane, stack, n, u[t : t + 1], y[t : t + 1])
    return n
