"""Compiled steps of Newmark, each with Newton's method, for an oscillator with a force of plays.

The method has the constants 1/2 and 1/4, and neither damps nor amplifies. ``plays`` is a
tuple of radii (n,), weights (n,), offset, and two arrays that are updated: the positions (n,)
and their derivatives (n, P). ``state`` (3,) is displacement, velocity and acceleration. Other
arguments are those of `_oscillator_kernels`.
"""

from numba import njit

from minorloop.dynamics._oscillator_kernels import keep
from minorloop.operators._play_kernels import move

_ITERATIONS = 30
"""Most steps of Newton's method; two or three are usual."""
_ROUNDING = 1e-14
"""Relative change of the acceleration at which Newton's method ends."""
_FAR = 1e100
"""Displacement from which a simulation counts as unstable; its square is still finite."""


@njit(cache=True, nogil=True)
def march(force, h, mass, damping, spring, plays, state, slopes, y_out, gradient):
    """Fill ``y_out`` and ``gradient``; return whether all displacements are finite."""
    radii, weights, offset, positions, _ = plays
    y, v, a = state
    quarter = h * h / 4
    y_out[0] = y
    keep(slopes, gradient, 0)
    for k in range(len(force)):
        y_free, v_free = y + h * v + quarter * a, v + h / 2 * a
        for _ in range(_ITERATIONS):
            y_next, v_next = y_free + quarter * a, v_free + h / 2 * a
            z, stiffness = offset, 0.0
            for i in range(radii.size):
                place = min(max(positions[i], y_next - radii[i]), y_next + radii[i])
                z += weights[i] * place
                if place != positions[i]:
                    stiffness += weights[i]
            restoring = 0.0
            power = 1.0
            for i in range(spring.size):
                stiffness += (i + 1) * spring[i] * power
                power *= y_next
                restoring += spring[i] * power
            rest = mass * a + damping * v_next + restoring + z - force[k, 2]
            change = rest / (mass + damping * h / 2 + stiffness * quarter)
            a -= change
            if abs(change) <= _ROUNDING * abs(a) or not abs(y_next) < _FAR:
                break
        y, v = y_free + quarter * a, v_free + h / 2 * a
        if not abs(y) < _FAR:
            return False
        if slopes.shape[1] > 0:
            _carry(y, v, a, h, mass, damping, spring, stiffness, plays, slopes)
            keep(slopes, gradient, k + 1)
        move(y, radii, positions)
        y_out[k + 1] = y
    state[0], state[1], state[2] = y, v, a
    return True


@njit(cache=True, nogil=True)
def _carry(y, v, a, h, mass, damping, spring, stiffness, plays, slopes):
    """Update the derivatives of the state, and those of the plays, from implicit derivatives.

    Parameters are mass, damping, spring and weights. The plays have not moved yet.
    """
    radii, weights, _, positions, play_slopes = plays
    first = 2 + spring.size
    quarter = h * h / 4
    factor = mass + damping * h / 2 + stiffness * quarter
    for j in range(slopes.shape[1]):
        y_free = slopes[0, j] + h * slopes[1, j] + quarter * slopes[2, j]
        v_free = slopes[1, j] + h / 2 * slopes[2, j]
        direct = damping * v_free + stiffness * y_free
        if j == 0:
            direct += a
        elif j == 1:
            direct += v
        elif j < first:
            direct += y ** (j - 1)
        for i in range(radii.size):
            place = min(max(positions[i], y - radii[i]), y + radii[i])
            if place == positions[i]:
                direct += weights[i] * play_slopes[i, j]
            if first + i == j:
                direct += place
        slopes[2, j] = -direct / factor
        slopes[1, j] = v_free + h / 2 * slopes[2, j]
        slopes[0, j] = y_free + quarter * slopes[2, j]
        for i in range(radii.size):
            if min(max(positions[i], y - radii[i]), y + radii[i]) != positions[i]:
                play_slopes[i, j] = slopes[0, j]
