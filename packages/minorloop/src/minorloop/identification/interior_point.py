"""Least squares under bounds by an interior point on a sparse system, then block pivoting.

The predictor-corrector method of Mehrotra (SIAM J. Optim. 2, 1992) comes near the optimum in a
number of sparse factorisations that hardly depends on the problem. It shows which unknowns are at
their bounds, up to a few. Block pivoting, with the same factorisations, then meets the conditions
of optimality to rounding.
"""

from collections.abc import Callable

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.active_set import BoundedSolution, Pivoting
from minorloop.identification.everett_system import EverettSystem

_LEAST_RIDGE = 1e-8
"""Added to a diagonal of one. More of it takes more iterations; less of it fails where samples are
fewer than unknowns."""
_AT_BOUND = 1e4
"""Ridge that keeps an unknown at its bound, to a diagonal of one."""
_GAP = 1e-13
"""Complementarity at which pivoting takes over, relative. Where the samples hardly determine the
unknowns, the dual residual hardly falls from there on: the least ridge holds the unknowns back."""
_MOST, _BOUNDARY, _STUCK = 40, 0.997, 1e-3
"""Most iterations, share of the way to the boundary, and step from which there is no progress."""
_FIRST_RIDGE = 1e-6
"""Ridge of the first pivoting, to a diagonal of one, by trial. It is smaller than that of
`active_set`, as the unknowns are near the optimum."""
_CORRECTOR_STEPS, _CORRECTOR_TOLERANCE = 6, 1e-3
"""Most conjugate gradients of a Newton step, and their relative residual; by trial. The factor is
accurate, so that one is usual."""
_PIVOT_STEPS, _PIVOT_TOLERANCE = 100, 1e-13
"""The same of a pivoting step, whose error is that of the result, relative to the outputs."""


def solve(
    system: EverettSystem,
    gradient: Callable[[FloatArray], FloatArray],
    bounded: BoolArray,
    searched: BoolArray,
    scale: float,
) -> BoundedSolution:
    """Find the unknowns that meet the optimality conditions.

    Parameters
    ----------
    system : EverettSystem
        A'A with columns of about unit length.
    gradient : callable
        z -> A'(A z - y).
    bounded, scale
        As of `active_set.solve`.
    searched : (n,) array of bool
        Which of them are looked for inside their bounds; the others begin at zero.
    """
    z = _interior_point(system, gradient, bounded, searched, scale)
    return polish(system, gradient, bounded, z, scale, searched)


def polish(
    system: EverettSystem,
    gradient: Callable[[FloatArray], FloatArray],
    bounded: BoolArray,
    guess: FloatArray,
    scale: float,
    searched: BoolArray | None = None,
) -> BoundedSolution:
    """Find them by block pivoting alone, from unknowns (n,) near the optimum."""
    pivoting = _SparsePivoting(gradient, bounded, scale, searched)
    pivoting.system = system
    return pivoting.run(guess, _FIRST_RIDGE)


class _SparsePivoting(Pivoting):
    system: EverettSystem
    quick, enough = 0.0, 1e-11
    least_ridge = 1e-10
    """The accuracy of the factor: below it, conjugate gradients are many."""

    def step(self, downhill: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        self.system.factorise(np.where(free, ridge, _AT_BOUND))
        self.factorisations += 1
        enough = _PIVOT_TOLERANCE * self.scale / (float(np.linalg.norm(downhill)) or 1.0)
        return self.system.solve(downhill, free, enough, _PIVOT_STEPS)


def _interior_point(
    system: EverettSystem,
    gradient: Callable[[FloatArray], FloatArray],
    bounded: BoolArray,
    searched: BoolArray,
    scale: float,
) -> FloatArray:
    """Unknowns near the optimum; those that are probably at their bounds are zero."""
    places = np.flatnonzero(searched)
    ridge = np.where(bounded, _AT_BOUND, _LEAST_RIDGE)
    z, slack = _start(system, gradient, places, ridge)
    free = searched | ~bounded
    for _ in range(_MOST):
        dual = gradient(z)
        dual[places] -= slack
        dual[~free] = 0.0
        gap = float(z[places] @ slack)
        if gap <= _GAP * scale**2:
            break
        ridge[places] = _LEAST_RIDGE + slack / z[places]
        system.factorise(ridge)

        def direction(target: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
            """Newton step to z * slack = target, and that of the slack."""
            wanted = target / z[places] - slack  # noqa: B023
            right = -dual  # noqa: B023
            right[places] += wanted
            step = system.solve(right, free, _CORRECTOR_TOLERANCE, most)
            return step, wanted - slack / z[places] * step[places]  # noqa: B023

        step, change = direction(np.zeros(places.size), 1)
        length = min(_longest(z[places], step[places]), _longest(slack, change))
        reached = float((z[places] + length * step[places]) @ (slack + length * change))
        centre = (reached / gap) ** 3 * gap / places.size
        step, change = direction(centre - step[places] * change, _CORRECTOR_STEPS)
        length = min(_longest(z[places], step[places]), _longest(slack, change))
        if length < _STUCK:
            break
        length = min(1.0, _BOUNDARY * length)
        z, slack = z + length * step, slack + length * change
    z[places] = np.where(z[places] > slack, z[places], 0.0)
    return z


def _start(
    system: EverettSystem,
    gradient: Callable[[FloatArray], FloatArray],
    places: IntArray,
    ridge: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Unknowns and slacks inside the bounds, from a solution with a ridge; Mehrotra, section 7."""
    ridge = ridge.copy()
    ridge[places] = 1.0
    system.factorise(ridge)
    z = system.solve(
        -gradient(np.zeros(ridge.size)), ridge <= 1.0, tolerance=_CORRECTOR_TOLERANCE, most=2
    )
    slack = gradient(z)[places]
    inside = z[places] + max(-1.5 * z[places].min(), 0.0)
    slack += max(-1.5 * slack.min(), 0.0)
    product = float(inside @ slack)
    tiny = np.finfo(np.float64).tiny
    z[places] = inside + 0.5 * product / max(float(slack.sum()), tiny)
    slack += 0.5 * product / max(float(inside.sum()), tiny)
    return z, slack


def _longest(values: FloatArray, change: FloatArray) -> float:
    """Largest step up to one that leaves all values non-negative."""
    falling = change < 0
    return float(min(1.0, np.min(-values[falling] / change[falling], initial=1.0)))
