"""Compiled loops of the operator with after-effect: arrays in, arrays out.

The state is a *stack* and the creep. A row of the stack (capacity, 3 + P) describes one remembered
extremum of the effective input: its value x in units of the stretched thresholds, its band, its
fraction of that band, and the outputs there of the P planes that share the memory. Rows are ordered
as in `_kernels`. ``creep`` (P - 1,) are the outputs of the creeping planes, which follow slowly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from minorloop.arrays import FloatArray, IntArray
from minorloop.operators._kernels import band_of
from minorloop.operators._memory_kernels import wipes_out

VALUE, BAND, FRACTION, OUTPUTS = 0, 1, 2, 3
"""Columns of the stack; the outputs of the planes begin at the last."""
_STEPS = 200
"""Most steps of a search for an input, so that it always ends. Bisection alone needs about 60."""
_LEAST = 4e-16
"""Width of the bracket, over the input, at which a search ends: neighbouring floats."""


class TimedPlane(NamedTuple):
    """Planes of relays that share one effective input, in the format of the loops.

    levels (L + 1,), per_band (L,), buckets, per_unit: as in `_kernels.PlaneTables`, for the input;
    marks, per_mark, mark_buckets, per_mark_unit: the same for the stretched thresholds;
    nodes (L + 1, L + 1, P), bow (L, P): Everett values at the nodes times the swing of a relay, and
    their curvature in a band; reversible (L + 1, P): the part that follows the input itself, at the
    levels; saturation (P,): outputs with all relays off; slope: of the memoryless linear part;
    settling: time in seconds after which the effective input equals the input, 0 without delay;
    times (P - 1,): time constants of the planes after the first, in seconds; empty if ``settling``
    is positive.
    """

    levels: FloatArray
    per_band: FloatArray
    buckets: IntArray
    per_unit: float
    marks: FloatArray
    per_mark: FloatArray
    mark_buckets: IntArray
    per_mark_unit: float
    nodes: FloatArray
    bow: FloatArray
    reversible: FloatArray
    saturation: FloatArray
    slope: float
    settling: float
    times: FloatArray


@njit(cache=True, nogil=True)
def relaxed(x, target, lost):
    """Effective input after an interval with a constant input, both in stretched units.

    Solution of dx/dt = sinh(target - x) / settling; ``lost`` is 1 - exp(-interval / settling). With
    w = x - target, tanh(w / 2) decays exponentially. It is written with 1 - tanh, which does not
    cancel far from the target.
    """
    w = x - target
    far = math.exp(-abs(w))
    short = (2.0 * far + (1.0 - far) * lost) / (1.0 + far)
    left = math.log((2.0 - short) / short)
    return target + left if w > 0.0 else target - left


@njit(cache=True, nogil=True)
def _everett(nodes, bow, i, s, j, f, k):
    """Everett value of plane k, as `_kernels.everett_inside`."""
    if i == j:
        x = s - f
        return nodes[i + 1, i, k] * x - bow[i, k] * x * (1.0 - x)
    lower = nodes[i, j, k] + f * (nodes[i, j + 1, k] - nodes[i, j, k])
    upper = nodes[i + 1, j, k] + f * (nodes[i + 1, j + 1, k] - nodes[i + 1, j, k])
    return lower + s * (upper - lower) - bow[i, k] * s * (1.0 - s) - bow[j, k] * f * (1.0 - f)


@njit(cache=True, nogil=True)
def simulate(plane, stack, n, creep, intervals, u, y, keep=True):
    """Fill ``y`` (T,) for inputs (T,) that last for ``intervals`` (T,); return the rows in use.

    Without ``keep``, the state does not change, and there is one input.
    """
    work = np.empty((2, plane.saturation.size))
    return _simulate(plane, stack, n, creep, intervals, u, y, work, keep)


@njit(cache=True, nogil=True)
def _simulate(plane, stack, n, creep, intervals, u, y, work, keep):
    """As `simulate`, with ``work``, memory for two numbers of each plane.

    One loop with all arrays in local variables: numba counts references to the arrays of each call,
    and compiles the loop anew for a ``keep`` that is written in a call: `bool` hides it.
    """
    levels, per_band, buckets, per_unit = (
        plane.levels,
        plane.per_band,
        plane.buckets,
        plane.per_unit,
    )
    marks, per_mark, mark_buckets = plane.marks, plane.per_mark, plane.mark_buckets
    per_mark_unit, nodes, bow = plane.per_mark_unit, plane.nodes, plane.bow
    reversible, saturation, slope = plane.reversible, plane.saturation, plane.slope
    settling, times = plane.settling, plane.times
    planes = saturation.size
    out, share = work[0], work[1]
    last, lost, top = -1.0, 1.0, n - 1
    for t in range(u.size):
        if intervals[t] != last:
            last = intervals[t]
            for k in range(1, planes):
                share[k] = -math.expm1(-last / times[k - 1])
            if settling > 0.0:
                lost = -math.expm1(-last / settling)
        x = min(max(u[t], levels[0]), levels[-1])
        at = band_of(levels, buckets, per_unit, x)
        part = (x - levels[at]) * per_band[at]
        band, fraction = at, part
        top = n - 1
        value = stack[top, VALUE]
        if settling > 0.0:
            x = relaxed(value, marks[at] + part * (marks[at + 1] - marks[at]), lost)
            x = min(max(x, marks[0]), marks[-1])
            band = band_of(marks, mark_buckets, per_mark_unit, x)
            fraction = (x - marks[band]) * per_mark[band]
        if x == value:
            for k in range(planes):
                out[k] = stack[top, OUTPUTS + k]
        else:
            rising = x > value
            if rising == (top & 1 == 0):
                top += 1
            while top >= 2 and wipes_out(x, top, stack[top - 2, VALUE], rising):
                top -= 2
            if top == 0:
                for k in range(planes):
                    out[k] = saturation[k]
            else:
                i, s, sign = band, fraction, 1.0
                j, f = int(stack[top - 1, BAND]), stack[top - 1, FRACTION]
                if not rising:
                    i, s, j, f, sign = j, f, i, s, -1.0
                for k in range(planes):
                    change = sign * _everett(nodes, bow, i, s, j, f, k)
                    out[k] = stack[top - 1, OUTPUTS + k] + change
            if keep:
                stack[top, VALUE], stack[top, BAND], stack[top, FRACTION] = x, band, fraction
                for k in range(planes):
                    stack[top, OUTPUTS + k] = out[k]
                n = top + 1
        low, high = reversible[at], reversible[at + 1]
        total = slope * u[t] + out[0] + low[0] + part * (high[0] - low[0])
        for k in range(1, planes):
            begin = creep[k - 1]
            end = out[k] + low[k] + part * (high[k] - low[k])
            after = begin + share[k] * (end - begin)
            total += after
            if keep:
                creep[k - 1] = after
        y[t] = total
    return n


@njit(cache=True, nogil=True)
def begin(plane, stack):
    """Set negative saturation; returns the rows in use."""
    stack[0, VALUE], stack[0, BAND], stack[0, FRACTION] = plane.marks[0], 0.0, 0.0
    for k in range(plane.saturation.size):
        stack[0, OUTPUTS + k] = plane.saturation[k]
    return 1


@njit(cache=True, nogil=True)
def aim(plane, stack, n, creep, before, interval, target):
    """Input that brings the output to the target after an interval; the state does not change.

    The output is monotone in the input. The bracket is the side of the previous input that contains
    the root, which is found by inverse quadratic interpolation and bisection (Chandrupatla,
    Advances in Engineering Software 28, 1997). A target out of reach gives the nearer end.
    """
    held, u, y = np.array([interval]), np.empty(1), np.empty(1)
    work = np.empty((2, plane.saturation.size))
    u[0] = a = min(max(before, plane.levels[0]), plane.levels[-1])
    _simulate(plane, stack, n, creep, held, u, y, work, bool(0))
    fa = y[0] - target
    if fa == 0.0:
        return a
    u[0] = b = plane.levels[0] if fa > 0.0 else plane.levels[-1]
    _simulate(plane, stack, n, creep, held, u, y, work, bool(0))
    fb = y[0] - target
    if fb == 0.0 or (fa > 0.0) == (fb > 0.0):
        return b
    c, fc, share = a, fa, 0.5
    for _ in range(_STEPS):
        u[0] = x = a + share * (b - a)
        _simulate(plane, stack, n, creep, held, u, y, work, bool(0))
        fx = y[0] - target
        if (fx > 0.0) == (fa > 0.0):
            c, fc = a, fa
        else:
            c, fc, b, fb = b, fb, a, fa
        a, fa = x, fx
        wide, size = abs(b - a), max(abs(a), abs(b))
        if fa == 0.0 or wide <= _LEAST * size:
            break
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        share = 0.5
        if phi * phi < xi and (1.0 - phi) * (1.0 - phi) < 1.0 - xi:
            share = fa / (fb - fa) * fc / (fb - fc)
            share += (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        least = 0.5 * _LEAST * size / wide
        share = min(max(share, least), 1.0 - least)
    return a if abs(fa) < abs(fb) else b


@njit(cache=True, nogil=True)
def invert(plane, stack, n, creep, before, intervals, targets, u, y):
    """Inputs that meet the targets one after the other, and the outputs for these inputs."""
    work = np.empty((2, plane.saturation.size))
    for t in range(targets.size):
        u[t] = before = aim(plane, stack, n, creep, before, intervals[t], targets[t])
        one = slice(t, t + 1)
        n = _simulate(plane, stack, n, creep, intervals[one], u[one], y[one], work, bool(1))
    return n
