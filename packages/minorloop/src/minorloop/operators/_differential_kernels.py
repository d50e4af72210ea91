"""Compiled loops of operators of differential type: they take and return only numbers and arrays.

The slope ``dz/du`` of these operators depends on the output z and on the direction of the input.
There are two kinds. With ``levels`` (n,) of z, ``values`` (2n,) are the slopes at the levels, for
rising inputs first; the slope is linear between levels and constant beyond them. Without levels the
law is that of Bouc and Wen, with ``values`` alpha, gamma, delta and the exponent.
"""

from __future__ import annotations

import math

from numba import njit

_SMOOTH = 0.02
"""Step of an integration for exponents other than 1, over the length on which the slope changes:
the fourth-order error of such a step is below 1e-10."""
_LINEAR = 1e-300
"""Exponents below which the exponential is a straight line; the reciprocal is finite."""
_PARTS = 64
_PLACES = (0.046910077030668, 0.2307653449471585, 0.5, 0.7692346550528415, 0.953089922969332)
_WEIGHTS = (
    0.1184634425280945,
    0.2393143352496832,
    0.2844444444444444,
    0.2393143352496832,
    0.1184634425280945,
)
"""Parts of an integral, and the rule of Gauss with five points on each: its error is rounding."""


@njit(cache=True, nogil=True)
def piece(z, up, levels):
    """Return the index of the piece of the slope in which z moves up or down.

    Without levels, 0 is the piece of negative z and 1 that of positive z.
    """
    if levels.size == 0:
        return 1 if z > 0 or (z == 0 and up) else 0
    low, high = 0, levels.size
    while low < high:
        middle = (low + high) // 2
        if levels[middle] < z or (levels[middle] == z and up):
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def corner(index, up, levels):
    """Return the upper or the lower end of a piece; infinite at the first and the last."""
    if up:
        if levels.size == 0:
            return 0.0 if index == 0 else math.inf
        return levels[index] if index < levels.size else math.inf
    if levels.size == 0:
        return 0.0 if index == 1 else -math.inf
    return levels[index - 1] if index > 0 else -math.inf


@njit(cache=True, nogil=True)
def slope(z, side, index, levels, values):
    """Return the slope at z on a piece, and its derivative to z.

    ``side`` is 1 for rising inputs and -1 for falling ones. The piece is continued beyond its ends.
    """
    n = levels.size
    if n == 0:
        alpha, gamma, delta, exponent = values[0], values[1], values[2], values[3]
        sign = 1.0 if index == 1 else -1.0
        pull = gamma * side * sign + delta
        if exponent == 1.0:
            return alpha - pull * sign * z, -pull * sign
        size = max(sign * z, 0.0)
        steep = exponent * size ** (exponent - 1) if size > 0 else 0.0
        return alpha - pull * size**exponent, -pull * sign * steep
    first = 0 if side > 0 else n
    if index == 0:
        return values[first], 0.0
    if index == n:
        return values[first + n - 1], 0.0
    begin, end = values[first + index - 1], values[first + index]
    b = (end - begin) / (levels[index] - levels[index - 1])
    return begin + b * (z - levels[index - 1]), b


@njit(cache=True, nogil=True)
def advance(z, change, levels, values):
    """Return the output after the input has changed monotonically by ``change``."""
    side = 1.0 if change > 0 else -1.0
    rest = abs(change)
    while rest > 0:
        f, _ = slope(z, side, piece(z, True, levels), levels, values)
        if f == 0:
            return z
        up = side * f > 0
        index = piece(z, up, levels)
        ahead = corner(index, up, levels)
        if levels.size == 0 and values[3] != 1.0:
            z, rest = _integrate(z, side, rest, index, ahead, levels, values)
            continue
        b = slope(z, side, index, levels, values)[1]
        # z moves by f (exp(b x) - 1) / b, where x is the change of the input.
        length = _length(f, b, ahead - z)
        if length <= rest:
            z, rest = ahead, rest - length
        else:
            x = side * b * rest
            z += side * f * rest * (1.0 if abs(x) < _LINEAR else math.expm1(x) / x)
            rest = 0.0
    return z


@njit(cache=True, nogil=True)
def distance(z, target, levels, values):
    """Return the change of the input that brings z to ``target``; infinite if there is none."""
    if target == z:
        return 0.0
    side = 1.0 if target > z else -1.0
    total = 0.0
    while z != target:
        index = piece(z, side > 0, levels)
        f, b = slope(z, side, index, levels, values)
        if f <= 0:
            return math.inf
        ahead = corner(index, side > 0, levels)
        end = target if (target - ahead) * side <= 0 else ahead
        if levels.size == 0 and values[3] != 1.0:
            total += _quadrature(z, end, side, index, levels, values)
        else:
            total += _length(f, b, end - z)
        if total == math.inf:
            return math.inf
        z = end
    return side * total


@njit(cache=True, nogil=True)
def simulate(u, y, z, levels, values, out):
    """Fill ``out`` (T,) for inputs ``u`` (T,) from input y and output z; return the last output."""
    for t in range(u.size):
        z = advance(z, u[t] - y, levels, values)
        y = u[t]
        out[t] = z
    return z


@njit(cache=True, nogil=True)
def _length(f, b, ahead):
    """Return the change of the input that moves z by ``ahead``; infinite if there is none."""
    if math.isinf(ahead):
        return math.inf
    x = b * ahead / f
    if x <= -1:
        return math.inf
    return abs(ahead / f) * (1.0 if abs(x) < _LINEAR else math.log1p(x) / x)


@njit(cache=True, nogil=True)
def _integrate(z, side, rest, index, ahead, levels, values):
    """Return z, and the remaining input, after one step of Runge and Kutta or at a corner."""
    f, b = slope(z, side, index, levels, values)
    pull = abs(values[1]) + abs(values[2])
    # The slope changes over the input that moves z to the bend of the law.
    bend = (pull / abs(values[0])) ** (1 / values[3]) * abs(values[0])
    step = min(rest, _SMOOTH / max(abs(b), bend))
    h = side * step
    k2, _ = slope(z + h / 2 * f, side, index, levels, values)
    k3, _ = slope(z + h / 2 * k2, side, index, levels, values)
    k4, _ = slope(z + h * k3, side, index, levels, values)
    after = z + h / 6 * (f + 2 * k2 + 2 * k3 + k4)
    if not math.isinf(ahead) and (after - ahead) * (z - ahead) <= 0:
        return ahead, rest - min(step, abs(_quadrature(z, ahead, side, index, levels, values)))
    return after, rest - step


@njit(cache=True, nogil=True)
def _quadrature(z, end, side, index, levels, values):
    """Return the change of the input between two outputs: the integral of one over the slope."""
    total = 0.0
    width = (end - z) / _PARTS
    for i in range(_PARTS):
        for place, weight in zip(_PLACES, _WEIGHTS):  # noqa: B905 - compiled
            f, _ = slope(z + (i + place) * width, side, index, levels, values)
            if f == 0:
                return math.inf
            total += weight * width / f
    return abs(total)


@njit(cache=True, nogil=True)
def invert(targets, y, z, low, high, share, levels, values, u, reachable):
    """Fill ``u`` (T,) with inputs that bring the output to ``targets`` (T,), from input y.

    The output moves only a ``share`` of the way to a target at or beyond ``low`` or ``high``.
    """
    for t in range(targets.size):
        target = targets[t]
        change = distance(z, target, levels, values)
        reachable[t] = not math.isinf(change)
        if not reachable[t]:
            end = high if target > z else low
            target = z + share * (end - z)
            change = distance(z, target, levels, values)
        y += change
        z = target
        u[t] = y
