"""Compiled loops of an oscillator with hysteresis: they take and return only arrays.

The state is displacement y, velocity v and hysteretic force z. The law of z is that of
`operators._differential_kernels`. A ``plant`` is a tuple of mass, damping, the coefficients (n,) of
y, y^2, ... in the restoring force, and levels and values of that law. ``force`` (K, 3) is the force
at the beginning, in the middle and at the end of each of K steps of length h.

Pass whole numbers as `np.int64`: numba compiles a function again for each literal in its call.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from minorloop.operators._differential_kernels import corner, piece, slope

_EVENTS = 16
"""Most parts of one step; a step that needs more is too long for its input."""
_FAR = 1e100
"""Displacement from which a simulation counts as unstable; its square is still finite."""


@njit(cache=True, nogil=True)
def respond(force, h, plant, state, slopes, y_out, gradient):
    """Fill ``y_out`` (K + 1,) with the displacements; return whether all of them are finite.

    ``gradient`` (K + 1, P) receives their derivatives with respect to the P parameters: mass,
    damping, spring and values, in this order. ``state`` (3,) and its derivatives ``slopes`` (3, P)
    are at first those of the beginning, and are updated. With P = 0, there are no derivatives.
    """
    levels = plant[3]
    now = (state[0], state[1], state[2])
    with_slopes = slopes.shape[1] > 0
    stages = np.zeros((5, 3, slopes.shape[1]))
    y_out[0] = now[0]
    keep(slopes, gradient, 0)
    for k in range(len(force)):
        pulse = (force[k, 0], force[k, 1], force[k, 2], h)
        done = 0.0
        for count in range(_EVENTS):
            whole = count == _EVENTS - 1
            # A part of the step ends where the velocity changes its sign or the law has a corner.
            branch = _branch(now, _between(pulse, done), plant)
            part, turned, edge = 1.0 - done, False, math.inf
            after = _step(now, pulse, done, part, plant, branch)
            if branch[0] * after[1] < 0 and not whole:
                turned = True
                part, after = _find(now, after, np.int64(1), 0.0, pulse, done, part, plant, branch)
            up = after[2] > now[2]
            near = corner(branch[1], up, levels)
            if ((after[2] > near) if up else (after[2] < near)) and not whole:
                turned, edge = False, near
                part, after = _find(now, after, np.int64(2), near, pulse, done, part, plant, branch)
            if with_slopes:
                _carry(now, slopes, stages, pulse, done, part, plant, branch)
            done += part
            if turned:
                now = (after[0], 0.0, after[2])
            elif edge < math.inf:
                now = (after[0], after[1], edge)
            else:
                now = after
                break
        y_out[k + 1] = now[0]
        if not (abs(now[0]) < _FAR and abs(now[2]) < _FAR):
            return False
        keep(slopes, gradient, k + 1)
    state[0], state[1], state[2] = now
    return True


@njit(cache=True, nogil=True)
def keep(slopes, gradient, k):
    """Copy the derivatives of the displacement; a slice takes numba a second to compile."""
    for j in range(slopes.shape[1]):
        gradient[k, j] = slopes[0, j]


@njit(cache=True, nogil=True)
def _between(pulse, x):
    """Return the force at the share x of a step, by the parabola through its three samples."""
    f0, f1, f2, _ = pulse
    return f0 + x * (4 * f1 - 3 * f0 - f2 + x * 2 * (f0 - 2 * f1 + f2))


@njit(cache=True, nogil=True)
def _branch(state, force, plant):
    """Return the direction of the motion from a state, and the piece of its law."""
    y, v, z = state
    a, _ = _rates(y, v, z, force, plant, (1.0, np.int64(0)))
    side = 1.0 if v > 0 or (v == 0 and a > 0) else -1.0
    f, _ = slope(z, side, piece(z, True, plant[3]), plant[3], plant[4])
    return side, piece(z, side * f > 0, plant[3])


@njit(cache=True, nogil=True)
def _rates(y, v, z, force, plant, branch):
    """Return acceleration and rate of the hysteretic force."""
    mass, damping, spring, levels, values = plant
    restoring = 0.0
    for i in range(spring.size - 1, -1, -1):
        restoring = (restoring + spring[i]) * y
    f, _ = slope(z, branch[0], branch[1], levels, values)
    return (force - damping * v - restoring - z) / mass, f * v


@njit(cache=True, nogil=True)
def _step(state, pulse, begin, part, plant, branch):
    """Return the state after a part of a step, by the classical method of Runge and Kutta."""
    y, v, z = state
    length = part * pulse[3]
    half = length / 2
    middle = _between(pulse, begin + part / 2)
    a1, z1 = _rates(y, v, z, _between(pulse, begin), plant, branch)
    v2 = v + half * a1
    a2, z2 = _rates(y + half * v, v2, z + half * z1, middle, plant, branch)
    v3 = v + half * a2
    a3, z3 = _rates(y + half * v2, v3, z + half * z2, middle, plant, branch)
    v4 = v + length * a3
    end = _between(pulse, begin + part)
    a4, z4 = _rates(y + length * v3, v4, z + length * z3, end, plant, branch)
    return (
        y + length / 6 * (v + 2 * v2 + 2 * v3 + v4),
        v + length / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
        z + length / 6 * (z1 + 2 * z2 + 2 * z3 + z4),
    )


@njit(cache=True, nogil=True)
def _find(before, after, which, goal, pulse, begin, part, plant, branch):
    """Return a part of a step after which component ``which`` of the state equals ``goal``.

    Also return the state at its end. The method is regula falsi with the Illinois correction, to
    rounding.
    """
    low, high = 0.0, part
    at_low, at_high = before[which] - goal, after[which] - goal
    small = 1e-13 * (abs(at_low) + abs(at_high))
    found, there = high, after
    for _ in range(40):  # most steps to find the end of a part; five or six are usual
        found = (low * at_high - high * at_low) / (at_high - at_low)
        there = _step(before, pulse, begin, found, plant, branch)
        value = there[which] - goal
        if abs(value) <= small:
            break
        if value * at_high < 0:
            low, at_low = high, at_high
        else:
            at_low /= 2
        high, at_high = found, value
    return found, there


@njit(cache=True, nogil=True)
def _carry(state, slopes, stages, pulse, begin, part, plant, branch):
    """Update the derivatives of the state over a part of a step: the derivatives of `_step`."""
    y, v, z = state
    length = part * pulse[3]
    now = stages[4]
    dy, dv, dz = 0.0, 0.0, 0.0
    for stage in range(4):
        share = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        ahead = share * length
        before = stages[max(stage - 1, 0)]
        for i in range(3):
            for j in range(slopes.shape[1]):
                now[i, j] = slopes[i, j] if stage == 0 else slopes[i, j] + ahead * before[i, j]
        ys, vs, zs = y + ahead * dy, v + ahead * dv, z + ahead * dz
        dv, dz = _rates(ys, vs, zs, _between(pulse, begin + share * part), plant, branch)
        dy = vs
        _slope_rates(ys, vs, zs, dv, now, stages[stage], plant, branch)
    for i in range(3):
        for j in range(slopes.shape[1]):
            middle = stages[1, i, j] + stages[2, i, j]
            slopes[i, j] += length / 6 * (stages[0, i, j] + 2 * middle + stages[3, i, j])


@njit(cache=True, nogil=True)
def _slope_rates(y, v, z, a, now, out, plant, branch):
    """Fill ``out`` (3, P) with the rates of the derivatives ``now`` (3, P) of the state."""
    mass, damping, spring, levels, values = plant
    stiffness, power = 0.0, 1.0
    for i in range(spring.size):
        stiffness += (i + 1) * spring[i] * power
        power *= y
    f, bend = slope(z, branch[0], branch[1], levels, values)
    for j in range(now.shape[1]):
        out[0, j] = now[1, j]
        out[1, j] = -(stiffness * now[0, j] + damping * now[1, j] + now[2, j]) / mass
        out[2, j] = f * now[1, j] + v * bend * now[2, j]
    out[1, 0] -= a / mass
    out[1, 1] -= v / mass
    power = y
    for i in range(spring.size):
        out[1, 2 + i] -= power / mass
        power *= y
    _law_rates(v, z, branch, levels, values, out[2, 2 + spring.size :])


@njit(cache=True, nogil=True)
def _law_rates(v, z, branch, levels, values, out):
    """Add to ``out`` the derivatives of the rate of z with respect to the values of its law."""
    side, index = branch
    n = levels.size
    if n == 0:
        sign = 1.0 if index == 1 else -1.0
        size = max(sign * z, 0.0)
        power = size ** values[3]
        out[0] += v
        out[1] -= v * side * sign * power
        out[2] -= v * power
        if size > 0:
            out[3] -= v * (values[1] * side * sign + values[2]) * power * math.log(size)
        return
    first = 0 if side > 0 else n
    if index == 0:
        out[first] += v
    elif index == n:
        out[first + n - 1] += v
    else:
        share = (z - levels[index - 1]) / (levels[index] - levels[index - 1])
        out[first + index - 1] += v * (1 - share)
        out[first + index] += v * share
