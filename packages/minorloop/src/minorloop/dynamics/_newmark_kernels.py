"""Compiled steps of Newmark, with Newton in each, for an oscillator with any hysteretic force.

The method is the one with the constants 1/2 and 1/4, which neither damps nor amplifies. ``law`` is
a `PlayLaw` or a `PlaneLaw`; its memory is updated. ``state`` (3,) is
displacement, velocity and acceleration. Other arguments are those of `_oscillator_kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit
from numba.extending import overload

from minorloop.arrays import FloatArray, IntArray
from minorloop.dynamics._oscillator_kernels import keep
from minorloop.operators import _kernels as planes
from minorloop.operators._play_kernels import move

_ITERATIONS = 30
"""Most steps of Newton; two or three are usual."""
_ROUNDING = 1e-14
"""Relative change of the acceleration at which they end."""
_FAR = 1e100
"""Displacement from which a simulation counts as unstable; its square is still finite."""


class PlayLaw(NamedTuple):
    """Plays (n,): radii, weights, offset, positions, and their derivatives (n, P)."""

    radii: FloatArray
    weights: FloatArray
    offset: float
    positions: FloatArray
    slopes: FloatArray


class PlaneLaw(NamedTuple):
    """A Preisach plane, its stack, rows in use (1,), and space for a trial."""

    plane: planes.PlaneTables
    stack: FloatArray
    rows: IntArray
    scratch: FloatArray
    signal: FloatArray


@njit(cache=True, nogil=True)
def march(force, h, mass, damping, spring, law, state, slopes, y_out, gradient):
    """Fill ``y_out`` and ``gradient``; return whether all displacements are finite."""
    y, v, a = state
    quarter = h * h / 4
    y_out[0] = y
    keep(slopes, gradient, 0)
    for k in range(len(force)):
        y_free, v_free = y + h * v + quarter * a, v + h / 2 * a
        for _ in range(_ITERATIONS):
            y_next, v_next = y_free + quarter * a, v_free + h / 2 * a
            z, tangent = _trial(y_next, law)
            restoring, stiffness = 0.0, tangent
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
            _carry(y, v, a, h, mass, damping, spring, stiffness, law, slopes)
            keep(slopes, gradient, k + 1)
        _commit(y, law)
        y_out[k + 1] = y
    state[0], state[1], state[2] = y, v, a
    return True


def _trial(y, law):
    """Return force and tangent at a displacement; the memory stays as it is."""
    raise NotImplementedError


def _commit(y, law):
    """Move the memory to a displacement."""
    raise NotImplementedError


def _carry(y, v, a, h, mass, damping, spring, stiffness, law, slopes):
    """Update the derivatives of the state and of the memory, which has not moved yet."""
    raise NotImplementedError


def _trial_plays(y, law):
    """Return force and tangent."""
    radii, weights, offset, positions, _ = law
    z, tangent = offset, 0.0
    for i in range(radii.size):
        place = min(max(positions[i], y - radii[i]), y + radii[i])
        z += weights[i] * place
        if place != positions[i]:
            tangent += weights[i]
    return z, tangent


def _commit_plays(y, law):
    move(y, law[0], law[3])


def _carry_plays(y, v, a, h, mass, damping, spring, stiffness, law, slopes):
    """Update the derivatives of the state, and those of the plays, from implicit derivatives.

    Parameters are mass, damping, spring and weights. The plays have not moved yet.
    """
    radii, weights, _, positions, play_slopes = law
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


def _trial_preisach(y, law):
    """Return force and tangent, which is that of the chord from the present input."""
    plane, stack, rows, scratch, signal = law
    top = rows[0] - 1
    for k in range(rows[0]):
        for i in range(4):
            scratch[k, i] = stack[k, i]
    signal[0] = y
    planes.simulate(plane, scratch, rows[0], signal[:1], signal[1:])
    before = stack[top, planes.VALUE]
    lowest, highest = plane.levels[0], plane.levels[-1]
    inside = min(max(y, lowest), highest)
    z = signal[1]
    if inside == before:
        return z, plane.slope
    output = z - plane.slope * y
    return z, plane.slope + (output - stack[top, planes.OUTPUT]) / (inside - before)


def _commit_preisach(y, law):
    plane, stack, rows, _, signal = law
    signal[0] = y
    rows[0] = planes.simulate(plane, stack, rows[0], signal[:1], signal[1:])


def _no_derivatives(y, v, a, h, mass, damping, spring, stiffness, law, slopes):
    """Leave the derivatives as they are: these kinds have none."""


_KINDS = {
    PlayLaw: (_trial_plays, _commit_plays, _carry_plays),
    PlaneLaw: (_trial_preisach, _commit_preisach, _no_derivatives),
}
"""Functions of each kind of law. Numba chooses them by the type; a loop that is made anew for each
kind would be compiled in every process, because numba finds no closure in its cache."""


@overload(_trial)
def _choose_trial(y, law):
    return _KINDS[law.instance_class][0]


@overload(_commit)
def _choose_commit(y, law):
    return _KINDS[law.instance_class][1]


@overload(_carry)
def _choose_carry(y, v, a, h, mass, damping, spring, stiffness, law, slopes):
    return _KINDS[law.instance_class][2]
