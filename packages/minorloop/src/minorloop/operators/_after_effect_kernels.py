"""Compiled loops of the operator with after-effect: arrays in, arrays out.

The state is a *stack* and the creep. A row of the stack (capacity, 3 + P) describes one remembered
extremum of the effective input: its value x in units of the stretched thresholds, its band, its
fraction of that band, and the outputs there of the P planes that share the memory. Rows are ordered
as in `_kernels`. ``creep`` (P - 1,) are the outputs of the creeping planes, which follow late.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from minorloop.arrays import FloatArray, IntArray
from minorloop.operators._kernels import band_of
from minorloop.operators._memory_kernels import copy, wipes_out

VALUE, BAND, FRACTION, OUTPUTS = 0, 1, 2, 3
"""Columns of the stack; the outputs of the planes begin at the last."""
_STEPS = 200
"""Most steps of a search for an input, so that it always ends. Bisection alone needs about 60."""
_LEAST = 4e-16
"""Width of the bracket, over the input, at which a search ends: neighbouring floats."""
_POINTS = np.array(
    [-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640]
)
_SHARES = np.array(
    [
        0.2369268850561891,
        0.4786286704993665,
        0.5688888888888889,
        0.4786286704993665,
        0.2369268850561891,
    ]
)
"""Points in [-1, 1] and weights of the rule of Gauss and Legendre for polynomials of degree 9."""
POINTS, SHARES = (1.0 + _POINTS) / 2.0, _SHARES / 2.0
"""The same for [0, 1]."""
AT_ONCE = 1e-9
"""Begin of an interval, over the least time constant, that counts as an instant: what creeps in it
is wrong by so much."""
STRETCH = 1.2
"""Longest part of an interval in the logarithm of exp|w| - 1, w the distance from the input in
fluctuation fields. The integrand is analytic for pi around; five points are then good to 1e-9."""
SETTLED = 1e-11
"""Distance from the input, over one and the input in fluctuation fields, that counts as none."""


class TimedPlane(NamedTuple):
    """Planes of relays that share one effective input, in the form the loops read.

    levels (L + 1,), per_band (L,), buckets, per_unit: as in `_kernels.PlaneTables`, for the input;
    marks, per_mark, mark_buckets, per_mark_unit: the same for the stretched thresholds;
    nodes (L + 1, L + 1, P), bow (L, P): Everett values at the nodes times the swing of a relay, and
    what makes them curve in a band; reversible (L + 1, P): at the levels, what follows the input
    itself; saturation (P,): outputs with all relays off; slope: of the memoryless linear part;
    settling: time in seconds after which the effective input is the input, 0 if it is at once;
    times (P - 1,): seconds by which the outputs of the planes after the first follow late.
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
def part_of(x, end, target, mark, left, settling, least, first):
    """Return where the first part of an interval ends, and its seconds.

    In a part, the effective input passes no threshold and no extremum (``mark`` is the next of
    them), and what creeps is smooth. It goes from ``x`` to ``end`` in ``left`` seconds; ``least``
    is the least time constant. Parts are longer the more time is left after them, because all fast
    creep from them has then arrived.
    """
    seconds = least * AT_ONCE if first else (left + 4.0 * least) / 3.0
    w = abs(x - target)
    if w <= SETTLED * (1.0 + abs(target)):
        return end, 0.0
    to = end
    if seconds < left:
        to = relaxed(x, target, -math.expm1(-seconds / settling))
    else:
        seconds = left
    if first:
        return to, seconds
    short = math.log1p(math.expm1(w) * math.exp(-STRETCH))
    further = abs(mark - target) if (mark < target) == (x < target) else 0.0
    rest = max(short, further)
    if rest > abs(to - target):
        to = target - rest if x < target else target + rest
        if further >= short:
            to = mark
        passed = math.log1p(2.0 / math.expm1(rest)) - math.log1p(2.0 / math.expm1(w))
        seconds = min(settling * passed, left)
    return to, seconds


@njit(cache=True, nogil=True)
def moments_of(x, to, target, settling, times, first, still, tilt):
    """Fill what a part leaves at its end of the lag of each creep.

    ``still`` (P - 1,) is the share of creep that has not arrived of what switches in proportion to
    the way from ``x`` to ``to``; ``tilt`` (P - 1,) that of what switches as the way squared, less
    ``still``.
    """
    w, rest = abs(x - target), abs(to - target)
    if first or rest >= w or rest == 0.0:
        still[:] = 1.0
        tilt[:] = 0.0
        return
    still[:] = 0.0
    tilt[:] = 0.0
    begin, total = math.expm1(w), 0.0
    length, late = math.log(begin / math.expm1(rest)), math.log1p(2.0 / math.expm1(rest))
    for g in range(POINTS.size):
        grown = begin * math.exp(-POINTS[g] * length)
        weight = SHARES[g] * grown / (1.0 + grown)
        way = (w - math.log1p(grown)) / (w - rest)
        ahead = settling * (late - math.log1p(2.0 / grown))
        total += weight
        for k in range(times.size):
            part = weight * math.exp(-ahead / times[k])
            still[k] += part
            tilt[k] += part * (2.0 * way - 1.0)
    for k in range(times.size):
        still[k] /= total
        tilt[k] /= total


@njit(cache=True, nogil=True)
def first_beyond(marks, x, above):
    """Index of the first threshold above ``x``, or of the first that is not below it.

    By bisection; `numpy.searchsorted` would take longer to compile than all that calls it.
    """
    low, high = 0, marks.size
    while low < high:
        middle = (low + high) // 2
        if marks[middle] < x or (above and marks[middle] == x):
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def next_mark(marks, x, rising):
    """Next threshold on the way of an effective input; the last one at the end."""
    if rising:
        return marks[min(first_beyond(marks, x, True), marks.size - 1)]
    return marks[max(first_beyond(marks, x, False) - 1, 0)]


@njit(cache=True, nogil=True)
def _fill_outputs(marks, nodes, bow, saturation, stack, top, x, rising, out):
    """Fill the outputs (P,) of the planes at ``x``, which would be row ``top``."""
    if top == 0:
        copy(saturation, out)
        return
    i = min(first_beyond(marks, x, True), marks.size - 1) - 1
    s, sign = (x - marks[i]) / (marks[i + 1] - marks[i]), 1.0
    j, f = int(stack[top - 1, BAND]), stack[top - 1, FRACTION]
    if not rising:
        i, s, j, f, sign = j, f, i, s, -1.0
    for k in range(out.size):
        change = sign * _everett(nodes, bow, i, s, j, f, k)
        out[k] = stack[top - 1, OUTPUTS + k] + change


@njit(cache=True, nogil=True)
def _fill_lags(
    marks, nodes, bow, saturation, settling, times, stack, n, end, target, interval, lags
):
    """Fill by how much less creeps (P - 1,) than if all relays switched as the interval begins.

    The effective input goes from the last row to ``end``, towards ``target``. A relay that switches
    ``s`` before the end has crept by 1 - exp(-s / time) only. So the lag is the integral of
    exp(-s / time) - exp(-interval / time) over the change of the plane.
    """
    x, top, left, first = stack[n - 1, VALUE], n - 1, interval, True
    rising = end > x
    if rising == (top & 1 == 0):
        top += 1
    before, now, middle = stack[n - 1, OUTPUTS:].copy(), saturation.copy(), saturation.copy()
    still, tilt = np.empty(times.size), np.empty(times.size)
    lags[:] = 0.0
    while left > 0.0 and x != end:
        mark = next_mark(marks, x, rising)
        if top >= 2 + rising:
            extremum = stack[top - 2, VALUE]
            mark = min(mark, extremum) if rising else max(mark, extremum)
        to, seconds = part_of(x, end, target, mark, left, settling, times[0], first)
        moments_of(x, to, target, settling, times, first, still, tilt)
        _fill_outputs(marks, nodes, bow, saturation, stack, top, (x + to) / 2.0, rising, middle)
        while top >= 2 and wipes_out(to, top, stack[top - 2, VALUE], rising):
            top -= 2
        _fill_outputs(marks, nodes, bow, saturation, stack, top, to, rising, now)
        for k in range(times.size):
            switched = now[k + 1] - before[k + 1]
            bent = 2.0 * (now[k + 1] + before[k + 1] - 2.0 * middle[k + 1])
            lags[k] *= math.exp(-seconds / times[k])
            lags[k] += switched * still[k] + bent * tilt[k]
        copy(now, before)
        x, left, first = to, left - seconds, False
    for k in range(times.size):
        if left > 0.0:
            lags[k] *= math.exp(-left / times[k])
        lags[k] -= math.exp(-interval / times[k]) * (before[k + 1] - stack[n - 1, OUTPUTS + k + 1])


@njit(cache=True, nogil=True)
def simulate(plane, stack, n, creep, intervals, u, y, keep=True):
    """Fill ``y`` (T,) for inputs (T,) that last for ``intervals`` (T,); returns the rows in use.

    Unless ``keep``, the state stays as it is, and there is one input.
    """
    work = np.empty((3, plane.saturation.size))
    return _simulate(plane, stack, n, creep, intervals, u, y, work, keep)


@njit(cache=True, nogil=True)
def _simulate(plane, stack, n, creep, intervals, u, y, work, keep):
    """As `simulate`, with room for three numbers for each plane.

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
    out, share, lags, both = work[0], work[1], work[2], settling > 0.0 and planes > 1
    lags[:] = 0.0
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
            if both:
                lags[:] = 0.0
        else:
            if both:
                target = marks[at] + part * (marks[at + 1] - marks[at])
                _fill_lags(
                    marks, nodes, bow, saturation, settling, times, stack, n, x, target, last, lags
                )
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
            after = begin + share[k] * (end - begin) - lags[k - 1]
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
    """Input that brings the output to the target after an interval; the state stays as it is.

    The output is monotone in the input. The side of the input before is bracketed, and the root is
    found by inverse quadratic interpolation and bisection (Chandrupatla, Advances in Engineering
    Software 28, 1997). A target that no input reaches gives the nearer end.
    """
    held, u, y = np.array([interval]), np.empty(1), np.empty(1)
    work = np.empty((3, plane.saturation.size))
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
    """Inputs that meet the targets one after the other, and the outputs they give."""
    work = np.empty((3, plane.saturation.size))
    for t in range(targets.size):
        u[t] = before = aim(plane, stack, n, creep, before, intervals[t], targets[t])
        one = slice(t, t + 1)
        n = _simulate(plane, stack, n, creep, intervals[one], u[one], y[one], work, bool(1))
    return n
