"""Compiled loops over long records: they condense samples, find loops, evaluate the rough model."""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop.operators._kernels import band_of
from minorloop.operators._memory_kernels import wipes_out


@njit(cache=True, nogil=True)
def condense(levels, buckets, per_unit, past, u, y, measured, labels, out_u, out_y, out_w, out_row):
    """Condense each run of samples on one branch, in one band and of one label; return the count.

    ``past`` are the extrema before the first input, after negative saturation. ``out_u`` are
    inputs, ``out_w`` the weights of their outputs ``out_y``, zero where no output was measured, and
    ``out_row`` a sample of the run.
    """
    values = np.empty(past.size + u.size + 2)
    top, value, band, count, first = 0, levels[0], -1, 0, 0
    for x in past:  # extrema, each a reversal
        values[top] = value
        top += 1
        value = x
    for t in range(u.size):
        x = u[t]
        new = t > 0 and labels[t] != labels[t - 1]
        if x != value:
            rising = x > value
            if rising == (top & 1 == 0):
                values[top] = value
                top += 1
                new = True
            while top >= 2 and wipes_out(x, top, values[top - 2], rising):
                top -= 2
                new = True
            value = x
            here = band_of(levels, buckets, per_unit, x)
            new = new or here != band
            band = here
        if new and t > first:
            count = _put_run(u, y, measured, first, t, out_u, out_y, out_w, out_row, count)
            first = t
    return _put_run(u, y, measured, first, u.size, out_u, out_y, out_w, out_row, count)


@njit(cache=True, nogil=True)
def _put_run(u, y, measured, first, end, out_u, out_y, out_w, out_row, count):
    """Write at most three weighted samples with the moments of a run, and the run's last input.

    The weighted samples are the nodes of the Gauss quadrature of the inputs of the run, so that
    the normal equations of regressors that are quadratic in the input do not change.
    """
    if end - first <= 3:
        for t in range(first, end):
            out_u[count], out_row[count] = u[t], t
            out_w[count] = 1.0 if measured[t] else 0.0
            out_y[count] = y[t] if measured[t] else 0.0
            count += 1
        return count
    low, high, number, row = np.inf, -np.inf, 0, end - 1
    for t in range(first, end):
        if measured[t]:
            low, high, row = min(low, u[t]), max(high, u[t]), t
            number += 1
    if number:
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        nodes = quadrature(u, measured, first, end, middle, half, number)
        weight, total = np.zeros(nodes.size), np.zeros(nodes.size)
        for t in range(first, end):
            if not measured[t]:
                continue
            z = (u[t] - middle) / half if half > 0.0 else 0.0
            for k in range(nodes.size):
                share = 1.0
                for m in range(nodes.size):
                    if m != k:
                        share *= (z - nodes[m]) / (nodes[k] - nodes[m])
                weight[k] += share
                total[k] += share * y[t]
        rising = u[end - 1] >= u[first]
        for place in range(nodes.size):
            k = place if rising else nodes.size - 1 - place
            out_u[count] = min(max(middle + half * nodes[k], low), high)
            out_w[count], out_y[count], out_row[count] = weight[k], total[k] / weight[k], row
            count += 1
    if not number or out_u[count - 1] != u[end - 1]:
        out_u[count], out_w[count], out_y[count], out_row[count] = u[end - 1], 0.0, 0.0, row
        count += 1
    return count


@njit(cache=True, nogil=True)
def quadrature(u, measured, first, end, middle, half, number):
    """Up to three nodes, in increasing order, of the Gauss quadrature of some inputs.

    Golub and Welsch, Math. Comp. 23, 1969: eigenvalues of the matrix of the recurrence of the
    orthogonal polynomials.
    """
    if not half > 0.0:
        return np.zeros(1)
    a0 = 0.0
    for t in range(first, end):
        if measured[t]:
            a0 += (u[t] - middle) / half
    a0 /= number
    s1, a1 = 0.0, 0.0
    for t in range(first, end):
        if measured[t]:
            z = (u[t] - middle) / half
            p = z - a0
            s1 += p * p
            a1 += z * p * p
    b1 = s1 / number
    a1 /= s1
    s2, a2 = 0.0, 0.0
    for t in range(first, end):
        if measured[t]:
            z = (u[t] - middle) / half
            p = (z - a1) * (z - a0) - b1
            s2 += p * p
            a2 += z * p * p
    b2 = s2 / s1
    if b2 < 1e-12:
        mean, root = 0.5 * (a0 + a1), np.sqrt(0.25 * (a0 - a1) ** 2 + b1)
        return np.array([mean - root, mean + root])
    a2 /= s2
    # Eigenvalues of a symmetric matrix of three rows, by angles.
    mean = (a0 + a1 + a2) / 3.0
    c0, c1, c2 = a0 - mean, a1 - mean, a2 - mean
    size = np.sqrt((c0 * c0 + c1 * c1 + c2 * c2 + 2.0 * (b1 + b2)) / 6.0)
    half_determinant = 0.5 * (c0 * (c1 * c2 - b2) - b1 * c2) / size**3
    angle = np.arccos(min(max(half_determinant, -1.0), 1.0)) / 3.0
    high = mean + 2.0 * size * np.cos(angle)
    low = mean + 2.0 * size * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.array([low, 3.0 * mean - low - high, high])


@njit(cache=True, nogil=True)
def closed_loops(u, first, tolerance, gap, narrowest, turns, begin, end):
    """Write the first and the last sample of each closed loop; return the number of loops.

    A loop begins at a turning point and closes where the input returns to it, to within
    ``tolerance`` of the width of the loop. A loop is not written if its last sample before that is
    further away than ``gap`` of its width, or if it is narrower than ``narrowest``.
    ``first``: the first sample is a turning point. ``turns`` (T,) may hold anything.
    """
    top, way, count = 0, 0, 0
    if first:
        turns[0] = 0
        top = 1
    for k in range(1, u.size):
        step = u[k] - u[k - 1]
        if step == 0:
            continue
        if (step > 0) != (way > 0) or way == 0:
            if way != 0:
                turns[top] = k - 1
                top += 1
            way = 1 if step > 0 else -1
        while top >= 2:
            value = u[turns[top - 2]]
            width = abs(value - u[turns[top - 1]])
            left = (value - u[k]) * way
            if left > tolerance * width:
                break
            last = k if left >= 0 else k - 1
            if width >= narrowest and abs(value - u[last]) <= gap * width:
                begin[count], end[count] = turns[top - 2], last
                count += 1
            top -= 2
    return count
