"""Compiled loops under the prior on the plane: arrays in, arrays out."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def remember(stack, depth, u, low):
    """Let an input act on the alternating extrema ``stack[:depth]``; the new depth.

    ``stack[0]`` is ``low``, negative saturation; the last is the present input.
    """
    if u == stack[depth - 1]:
        return depth
    rising = u > stack[depth - 1]
    if depth == 1 or rising != (depth % 2 == 0):
        stack[depth] = u
        depth += 1
    else:
        stack[depth - 1] = u
    while depth >= 4:
        wiped = stack[depth - 1] >= stack[depth - 3]
        if depth % 2 == 1:
            wiped = stack[depth - 1] <= stack[depth - 3]
        if not wiped:
            break
        stack[depth - 3] = stack[depth - 1]
        depth -= 2
    if depth == 3 and stack[2] <= low:
        depth = 1
    return depth


@njit(cache=True, nogil=True)
def fractions(levels, uniform, stack, depth, row):
    """Fill ``row`` (K,) with the share of every cell that is switched on."""
    bands = levels.size - 1
    row[:] = 0.0
    k = 1
    while k < depth:
        top, begin = stack[k], stack[k - 1]
        end = stack[k + 1] if k + 1 < depth else top
        for j in range(bands):
            p, q = max(begin, levels[j]), min(end, levels[j + 1])
            if q <= p:
                continue
            width = levels[j + 1] - levels[j]
            for i in range(j + 1, bands):
                if top <= levels[i]:
                    break
                height = levels[i + 1] - levels[i]
                share = min(top - levels[i], height) / height
                row[i * (i + 1) // 2 + j] += share * (q - p) / width
            if uniform:
                t = min(top, levels[j + 1])
                r = min(q, t)
                if r > p:
                    row[j * (j + 1) // 2 + j] += ((t - p) ** 2 - (t - r) ** 2) / width**2
        k += 2
    if not uniform:
        now = stack[depth - 1]
        for i in range(bands):
            share = (now - levels[i]) / (levels[i + 1] - levels[i])
            row[i * (i + 1) // 2 + i] = min(max(share, 0.0), 1.0)


@njit(cache=True, nogil=True)
def walk(levels, uniform, past, u, measured, rows, marks):
    """Shares switched on and what is remembered best, after every measured input.

    ``past`` (d,) are the extrema before the first input; ``rows`` (M, K) is filled with the
    shares, ``marks`` (M, 3) with the present input and the last two extrema, all from 0 to 1.
    """
    low, high = levels[0], levels[-1]
    stack = np.empty(past.size + u.size + 2)
    stack[: past.size] = past
    depth = past.size
    m = 0
    for t in range(u.size):
        depth = remember(stack, depth, min(max(u[t], low), high), low)
        if not measured[t]:
            continue
        fractions(levels, uniform, stack, depth, rows[m])
        for k in range(3):
            marks[m, k] = (stack[max(depth - 1 - k, 0)] - low) / (high - low)
        m += 1


@njit(cache=True, nogil=True)
def matern(x, y, at_x, at_y, out):
    """Product of two Matern kernels of order 3/2 between points (K,), into ``out`` (K, K)."""
    root = math.sqrt(3.0)
    for i in range(x.size):
        for j in range(i + 1):
            a = root * abs(x[i] - x[j]) / at_x
            b = root * abs(y[i] - y[j]) / at_y
            value = (1.0 + a) * (1.0 + b) * math.exp(-a - b)
            out[i, j] = value
            out[j, i] = value


@njit(cache=True, nogil=True)
def look_ahead(levels, uniform, past, candidates, rows):
    """Shares switched on after each candidate (m,) is applied to the extrema ``past`` (d,)."""
    low, high = levels[0], levels[-1]
    stack = np.empty(past.size + 2)
    for m in range(candidates.size):
        stack[: past.size] = past
        depth = remember(stack, past.size, min(max(candidates[m], low), high), low)
        fractions(levels, uniform, stack, depth, rows[m])
