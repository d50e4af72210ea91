"""Least squares under bounds: block pivoting inside a proximal-point iteration.

Minimise ``1/2 |y - A z|^2 + 1/2 z'Qz`` with some unknowns not below zero. Block pivoting (Portugal,
Judice and Vicente, Math. Comp. 63, 1994) guesses which unknowns are at the bound, solves for
the others, and exchanges all that are on the wrong side. For a well-conditioned problem of any size
that takes about a dozen factorisations of the free part. A plane that the data barely determine is
ill-conditioned. The proximal-point iteration (Rockafellar, SIAM J. Control Optim. 14, 1976) adds a
ridge about the present solution, reduces it step by step, and raises it again if the pivoting does
not settle.

Either a dense solver (`dense_solver`) or the sparse system solves for the free unknowns. With the
sparse system, the predictor-corrector method of Mehrotra (SIAM J. Optim. 2, 1992) first comes near
the optimum, in a number of sparse factorisations that hardly depends on the problem. It shows which
unknowns are at their bounds, with a few exceptions. Block pivoting, with the same factorisations,
then meets the conditions of optimality to rounding. With a prior, a single factorisation is enough
to come near the optimum.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.everett_system import EverettSystem

TOLERANCE = 1e-12
"""Relative violation of the optimality conditions at which the iteration stops."""
ACCEPTABLE = 1e-6
"""Relative violation up to which a result counts as converged."""

_FIRST_RIDGE, _LEAST_RIDGE, _MOST_RIDGE = 1e-4, 1e-12, 1e2
_OUTER, _PIVOTS, _PATIENCE, _LATE = 80, 40, 3, 8
_JOINS, _FEW = 0.1, 100
"""Most unknowns that become free together: this share of the free unknowns, or this number. If a
few thousand become free at once, most leave again, but dense factors are large until then."""
_QUICK = 0.01
"""Ratio of a violation to the previous one up to which the ridge stays, so that a dense factor is
used again."""
_LEAST_SPARSE_RIDGE = 1e-9
"""Accuracy of the factor: a smaller ridge takes many steps of conjugate gradients."""
_SPLITTING, _ALTERNATIONS, _RELAXATION = 0.1, 15, 1.6
"""Penalty of the alternating directions for a diagonal of one, their number, and over-relaxation,
by trial. About one unknown in a hundred is then on the wrong side of its bound."""
_AT_BOUND = 1e4
"""Ridge that keeps an unknown of a sparse system at its bound, for a diagonal of one."""
_PIVOT_STEPS, _PIVOT_TOLERANCE = 100, 1e-13
"""Most steps of conjugate gradients for a sparse step, and their error over the norm of the
outputs, which is that of the result."""
_INTERIOR_RIDGE = 1e-8
"""Ridge of the interior point, for a diagonal of one. A larger ridge takes more iterations; a
smaller one fails if there are fewer samples than unknowns."""
_GAP = 1e-13
"""Relative complementarity at which pivoting takes over. If the samples hardly determine the
unknowns, the dual residual hardly falls below it, because of the ridge of the interior point."""
_MOST, _BOUNDARY, _FALLS = 40, 0.997, 0.95
"""Most iterations; share of the way to the boundary; and ratio of the sum of complementarity and
gradient to its least value so far, below which an iteration counts as progress."""
_CORRECTOR_STEPS, _CORRECTOR_TOLERANCE = 6, 1e-3
"""Most steps of conjugate gradients for a Newton step, and their relative residual; by trial. The
factor is accurate, so one step usually suffices."""


@dataclass(frozen=True)
class BoundedSolution:
    """Unknowns, their violation of the optimality conditions, and the number of factorisations.

    ``settled`` is false if the sum of squares was still falling.
    """

    z: FloatArray
    kkt: float
    factorisations: int
    settled: bool = True


def optimality(z: FloatArray, gradient: FloatArray, bounded: BoolArray, scale: float) -> float:
    """Largest violation of the optimality conditions, relative to ``scale``.

    The violation is the gradient for a free unknown, its negative part for an unknown at its bound,
    and the distance for an unknown below its bound.
    """
    at_bound = bounded & (z <= 0)
    violation = np.where(at_bound, np.maximum(-gradient, 0.0), np.abs(gradient))
    below = np.where(bounded, np.maximum(-z, 0.0), 0.0)
    return float(max(violation.max(initial=0.0), below.max(initial=0.0)) / scale)


class Pivoting(ABC):
    """Proximal-point iteration with block pivoting.

    ``gradient`` is z -> A'(A z - y) + Q z. Unknowns ``bounded`` (n,) must not be negative; unknowns
    outside ``searched`` (n,) that are at their bounds stay there. Violations are relative to
    ``scale``, the norm of y. The iteration ends at a violation of `TOLERANCE`, or some steps after
    one of ``enough``. A subclass solves for the free unknowns.
    """

    least_ridge = _LEAST_RIDGE
    joins = _JOINS
    quick = _QUICK
    enough = TOLERANCE

    def __init__(
        self,
        gradient: Callable[[FloatArray], FloatArray],
        bounded: BoolArray,
        scale: float,
        searched: BoolArray | None = None,
    ) -> None:
        self.gradient, self.bounded, self.scale = gradient, bounded, scale
        self.searched = bounded if searched is None else searched
        self.factorisations = 0
        self.say: Callable[[str], None] = lambda stage: None

    @abstractmethod
    def step(self, downhill: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        """(n,) Newton step of the free unknowns, zero for the others."""

    def run(self, z: FloatArray, ridge: float = _FIRST_RIDGE) -> BoundedSolution:
        """Iterate from z and a first ridge to the best solution, converged or not.

        The ridge is reduced only while the violation falls slowly. If the pivoting does not settle,
        the ridge stays higher until the set of free unknowns is the same for a number of steps,
        which doubles with each failure. Successive solutions with one ridge change little and in
        one direction, so each begins at the minimum along the previous change.
        """
        free, least = ~self.bounded | (z > 0), self.least_ridge
        best, before, last = BoundedSolution(z, np.inf, 0), z, np.inf
        settled, pivots, steps, late, rests, failures = False, 0, 0, 0, 0, 0
        for _ in range(_OUTER):
            gradient = self.gradient(z)
            kkt = optimality(z, gradient, self.bounded, self.scale)
            if kkt < best.kkt:
                best = BoundedSolution(z, kkt, self.factorisations)
            late += best.kkt <= self.enough
            grows, slow, wide = kkt > last, kkt > self.quick * last, ridge
            if (
                kkt <= TOLERANCE
                or late > _LATE
                or (grows and steps < 2 and ridge <= self.least_ridge)
            ):
                break
            if settled and slow:
                ridge = max(ridge * (0.01 if pivots <= 4 else 0.1), least)
            steps = steps + 1 if settled and slow and not grows and ridge == wide else 0
            last = kkt
            self.say(f"{np.count_nonzero(free):,} of {free.size:,} unknowns are not zero")
            centre = z
            if steps > 1:
                centre, gradient = self._farther(z, gradient, z - before)
            trial, settled, pivots = self._pivot(centre, gradient, free, ridge)
            if not settled:
                if ridge >= _MOST_RIDGE:
                    break
                ridge = least = 10.0 * ridge
                rests, failures = 0, failures + 1
                continue
            rests += np.array_equal(free, trial[1])
            if rests >= 2 ** (failures - 1):
                least, rests = max(0.1 * least, self.least_ridge), 0
            free, before = trial[1], z
            z = np.where(self.bounded, np.maximum(trial[0], 0.0), trial[0])
        return BoundedSolution(best.z, best.kkt, self.factorisations)

    def _farther(
        self, z: FloatArray, gradient: FloatArray, change: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Minimum along a change within the bounds, and the gradient there."""
        # Longest search, in lengths of the change; bounds usually end it earlier
        length = _longest(z[self.bounded], change[self.bounded], 1e6)
        end = self.gradient(z + length * change)
        slope, last = float(gradient @ change), float(end @ change)
        share = slope / (slope - last) if slope < 0 < last else float(slope < 0)
        there = z + share * length * change
        return there, self.gradient(there)

    def _pivot(
        self, z: FloatArray, gradient: FloatArray, free: BoolArray, ridge: float
    ) -> tuple[tuple[FloatArray, BoolArray], bool, int]:
        """Minimise with a ridge about z, exchanging unknowns that are on the wrong side.

        Unknowns at their bounds with the steepest descent are exchanged first.
        """
        fewest, patience = free.size + 1, _PATIENCE
        x = z
        for pivots in range(1, _PIVOTS + 1):
            try:
                x = self._solve_free(z, gradient, free, ridge)
            except LinAlgError:
                break
            slack = self.gradient(x) + ridge * (x - z)
            tiny = 1e-13 * self.scale
            wrong = self.searched & np.where(free, x < -tiny, slack < -tiny)
            count = int(np.count_nonzero(wrong))
            if count == 0:
                return (x, free), True, pivots
            if count < fewest:
                fewest, patience = count, _PATIENCE
            elif patience == 0:
                break
            else:
                patience -= 1
            joins = np.flatnonzero(wrong & ~free)
            most = max(self.joins * np.count_nonzero(free), _FEW)
            if joins.size > most:
                wrong[joins[np.argpartition(slack[joins], int(most))[int(most) :]]] = False
            free = free ^ wrong
        return (x, free), False, _PIVOTS

    def _solve_free(
        self, z: FloatArray, gradient: FloatArray, free: BoolArray, ridge: float
    ) -> FloatArray:
        """Minimise over the free unknowns; the others are zero."""
        x = np.where(free, z, 0.0)
        if not np.array_equal(x, z):
            gradient = self.gradient(x) + ridge * (x - z)
        return x + self.step(-np.where(free, gradient, 0.0), free, ridge)


class _SparsePivoting(Pivoting):
    """Pivoting with a sparse system, for outputs ``y`` (M,).

    ``centre`` is the part of the unknowns that the outputs do not contain, in units of the columns.
    """

    joins, quick, enough = np.inf, 0.0, 7e-11
    least_ridge = _LEAST_SPARSE_RIDGE

    def __init__(
        self,
        system: EverettSystem,
        y: FloatArray,
        bounded: BoolArray,
        scale: float,
        searched: BoolArray | None = None,
        centre: FloatArray | float = 0.0,
    ) -> None:
        def gradient(z: FloatArray) -> FloatArray:
            return system.gradient(system.scale * z - centre, y)

        super().__init__(gradient, bounded, scale, searched)
        self.system = system

    def step(self, downhill: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        self.system.factorise(np.where(free, ridge, _AT_BOUND))
        self.factorisations += 1
        enough = _PIVOT_TOLERANCE * self.scale / (float(np.linalg.norm(downhill)) or 1.0)
        found = self.system.solve(downhill, free, enough, _PIVOT_STEPS)
        left = np.where(free, downhill - self.system.product(found) - ridge * found, 0.0)
        if np.linalg.norm(left) > 10 * _PIVOT_TOLERANCE * self.scale:
            raise LinAlgError("the ridge is below the accuracy of the factor")
        return found

    def alternate(self, z: FloatArray) -> FloatArray:
        """Unknowns near the optimum of a regular system, from a guess, with one factorisation.

        Alternating directions: Boyd, Parikh, Chu, Peleato and Eckstein, Foundations and Trends in
        Machine Learning 3, 2011, sections 3.4.3 and 5.2.
        """
        self.system.factorise(_SPLITTING)
        right, multiplier = -self.gradient(np.zeros(z.size)), np.zeros(z.size)
        for _ in range(_ALTERNATIONS):
            free = self.system.rough(right + _SPLITTING * (z - multiplier))
            multiplier += _RELAXATION * free + (1 - _RELAXATION) * z
            z = np.where(self.bounded, np.maximum(multiplier, 0.0), multiplier)
            multiplier -= z
        return z


def solve_sparse(
    system: EverettSystem,
    y: FloatArray,
    bounded: BoolArray,
    varying: BoolArray,
    scale: float,
    fine: FloatArray,
) -> BoundedSolution:
    """Find the unknowns (n,) that meet the optimality conditions for outputs ``y`` (M,).

    ``system`` has columns of about unit length, so that an optimum with small unknowns is found if
    there are many. Pivoting uses the column factors ``fine`` (n,), which give columns without their
    mean about unit length: a cell that hardly switches is determined to as many digits as the
    others. The system and the solution keep these factors. Bounded unknowns that are not
    ``varying`` stay at zero.
    """
    searched = bounded & varying
    z = _interior_point(system, y, bounded, searched, scale) * system.scale / fine
    system.condition(fine)
    return _SparsePivoting(system, y, bounded, scale, searched).run(z)


def solve_with_prior(
    system: EverettSystem,
    y: FloatArray,
    bounded: BoolArray,
    guess: FloatArray,
    scale: float,
    centre: FloatArray | float = 0.0,
) -> BoundedSolution:
    """Find the same from a guess (n,) where a prior determines them, so that the system is regular.

    ``centre`` is as of `_SparsePivoting`.
    """
    pivoting = _SparsePivoting(system, y, bounded, scale, centre=centre)
    return pivoting.run(pivoting.alternate(guess), _LEAST_SPARSE_RIDGE)


def _interior_point(
    system: EverettSystem, y: FloatArray, bounded: BoolArray, searched: BoolArray, scale: float
) -> FloatArray:
    """Unknowns near the optimum; those that are probably at their bounds are zero."""
    places = np.flatnonzero(searched)
    ridge = np.where(bounded, _AT_BOUND, _INTERIOR_RIDGE)
    z, slack = _start(system, y, places, ridge)
    free, least, since = searched | ~bounded, np.inf, 0
    for _ in range(_MOST):
        dual = system.gradient(system.scale * z, y)
        dual[places] -= slack
        dual[~free] = 0.0
        gap = float(z[places] @ slack)
        left = gap + scale * float(np.linalg.norm(dual))
        since = 0 if left < _FALLS * least else since + 1
        if gap <= _GAP * scale**2 or since > _PATIENCE:
            break
        least = min(left, least)
        ridge[places] = _INTERIOR_RIDGE + slack / z[places]
        system.factorise(ridge)

        def direction(target: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
            """Newton steps of the unknowns and of the slack, to z * slack = target."""
            required = target / z[places] - slack  # noqa: B023
            right = -dual  # noqa: B023
            right[places] += required
            step = system.solve(right, free, _CORRECTOR_TOLERANCE, most)
            return step, required - slack / z[places] * step[places]  # noqa: B023

        step, change = direction(np.zeros(places.size), 1)
        length = min(_longest(z[places], step[places]), _longest(slack, change))
        reached = float((z[places] + length * step[places]) @ (slack + length * change))
        centre = (reached / gap) ** 3 * gap / places.size
        step, change = direction(centre - step[places] * change, _CORRECTOR_STEPS)
        length = min(_longest(z[places], step[places]), _longest(slack, change))
        length = min(1.0, _BOUNDARY * length)
        z, slack = z + length * step, slack + length * change
    z[places] = np.where(z[places] > slack, z[places], 0.0)
    return z


def _start(
    system: EverettSystem, y: FloatArray, places: IntArray, ridge: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unknowns and slacks inside the bounds, from a solution with a ridge; Mehrotra, section 7."""
    ridge = ridge.copy()
    ridge[places] = 1.0
    system.factorise(ridge)
    z = system.solve(
        -system.gradient(np.zeros(ridge.size), y), ridge <= 1.0, _CORRECTOR_TOLERANCE, most=2
    )
    slack = system.gradient(system.scale * z, y)[places]
    inside = z[places] + max(-1.5 * z[places].min(), 0.0)
    slack += max(-1.5 * slack.min(), 0.0)
    product = float(inside @ slack)
    tiny = np.finfo(np.float64).tiny
    z[places] = inside + 0.5 * product / max(float(slack.sum()), tiny)
    slack += 0.5 * product / max(float(inside.sum()), tiny)
    return z, slack


def _longest(values: FloatArray, change: FloatArray, most: float = 1.0) -> float:
    """Return the largest step, up to ``most``, that leaves all values non-negative."""
    falling = change < 0
    return float(np.min(-values[falling] / change[falling], initial=most))
