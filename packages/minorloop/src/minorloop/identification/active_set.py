"""Least squares under bounds: block pivoting inside a proximal-point iteration.

Minimise ``1/2 |y - A z|^2 + 1/2 z'Qz`` with some unknowns not below zero. Block pivoting (Portugal,
Judice and Vicente, Math. Comp. 63, 1994) guesses which unknowns are at the bound, solves for
the others, and exchanges all that are on the wrong side. For a well-conditioned problem of any size
that takes about a dozen factorisations of the free part. A plane that the data barely determine is
ill-conditioned. The proximal-point iteration (Rockafellar, SIAM J. Control Optim. 14, 1976) adds a
ridge about the present solution, reduces it step by step, and raises it again if the pivoting does
not settle. Residuals are computed from A, not from A'A, so that the optimality is not limited by
the squared condition number. The accuracy of the unknowns is; if the rows of A are given,
`refinement` corrects the unknowns with them.

The free part is factorised while it is small, and few exchanges update the factor. Beyond that,
conjugate gradients on A are cheaper: a few hundred steps if a penalty keeps the condition number
low.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError, lapack

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification import _kernels
from minorloop.identification.gram_rows import GramRows
from minorloop.identification.refinement import Preconditioner, Rows, refine
from minorloop.identification.updated_factor import LEAST, UpdatedFactor
from minorloop.threads import one_thread

TOLERANCE = 1e-12
"""Relative violation of the optimality conditions at which the iteration stops."""
ACCEPTABLE = 1e-6
"""Relative violation up to which a result counts as converged."""

_FIRST_RIDGE, _LEAST_RIDGE, _MOST_RIDGE = 1e-4, 1e-12, 1e2
_OUTER, _PIVOTS, _PATIENCE, _LATE = 80, 40, 3, 4
_QUICK = 0.01
"""Ratio of a violation to the one before up to which the ridge stays, so that a dense factor is
used again."""
_FIRST_SWEEPS = 5
_FACTORISED = 5100
"""Free unknowns up to which a factorisation is cheaper."""
_CG_TOLERANCE, _CG_STEPS = 1e-8, 3000
"""Relative residual and most steps of the conjugate gradients, by trial. A few hundred steps
are usual. They need not be exact, as the next iteration corrects them."""


@dataclass(frozen=True)
class Sparse:
    """Entries of a symmetric matrix, lower triangle: rows, columns, values."""

    rows: IntArray
    columns: IntArray
    values: FloatArray


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


def solve(
    gram: FloatArray | GramRows,
    gradient: Callable[[FloatArray], FloatArray],
    hessian: Callable[[FloatArray], FloatArray],
    bounded: BoolArray,
    scale: float,
    *,
    penalty: Sparse | None = None,
    guess: FloatArray | None = None,
    rows: Rows | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> BoundedSolution:
    """Find the unknowns that meet the optimality conditions.

    Parameters
    ----------
    gram : (n, n) array or GramRows
        A'A, of an array the lower triangle. Its diagonal is about one except where a column is
        zero. Only entries of unknowns that become free are needed if there is a guess.
    gradient : callable
        z -> A'(A z - y) + Q z, evaluated without forming A'A.
    hessian : callable
        z -> A'A z + Q z, likewise.
    bounded : (n,) array of bool
        Which unknowns must not be negative.
    scale : float
        Norm of y, to which violations are relative.
    penalty : Sparse, optional
        Q.
    guess : (n,) array, optional
        Start of the iteration.
    rows : Rows, optional
        Rows of A and y, then those of the penalty, for the refinement.
    say : callable
        Called with the state of the search.

    Returns
    -------
    BoundedSolution
        The best one found, converged or not.
    """
    known = gram if isinstance(gram, GramRows) else GramRows.of(gram)
    solver = _Solver(known, gradient, hessian, bounded, scale, penalty)
    solver.say = say
    with one_thread():
        found = solver.run(solver.first_guess() if guess is None else guess)
        return found if rows is None else solver.refined(found, rows)


class Pivoting(ABC):
    """Proximal-point iteration with block pivoting.

    ``gradient``, ``bounded`` and ``scale`` as in `solve`; unknowns beyond ``searched`` that are at
    their bounds stay there. The iteration ends at a violation of `TOLERANCE`, or some steps after
    one of ``enough``. A subclass solves for the free unknowns.
    """

    least_ridge = _LEAST_RIDGE
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

        The ridge is only reduced where the violation falls slowly. Where the pivoting did not
        settle, it stays higher until the free unknowns rest; the solutions with one ridge are then
        extrapolated (Güler, SIAM J. Optim. 2, 1992), as they change little in one direction.
        """
        free, least = ~self.bounded | (z > 0), self.least_ridge
        best, before, last = BoundedSolution(z, np.inf, 0), z, np.inf
        settled, pivots, steps, late = False, 0, 0, 0
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
                centre = z + (steps - 1) / (steps + 2) * (z - before)
                gradient = self.gradient(centre)
            trial, settled, pivots = self._pivot(centre, gradient, free, ridge)
            if not settled:
                if ridge >= _MOST_RIDGE:
                    break
                ridge = least = 10.0 * ridge
                continue
            if np.array_equal(free, trial[1]):
                least = max(0.1 * least, self.least_ridge)
            free, before = trial[1], z
            z = np.where(self.bounded, np.maximum(trial[0], 0.0), trial[0])
        return BoundedSolution(best.z, best.kkt, self.factorisations)

    def _pivot(
        self, z: FloatArray, gradient: FloatArray, free: BoolArray, ridge: float
    ) -> tuple[tuple[FloatArray, BoolArray], bool, int]:
        """Minimise with a ridge about z, exchanging all unknowns that are on the wrong side."""
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


class _Solver(Pivoting):
    def __init__(
        self,
        gram: GramRows,
        gradient: Callable[[FloatArray], FloatArray],
        hessian: Callable[[FloatArray], FloatArray],
        bounded: BoolArray,
        scale: float,
        penalty: Sparse | None,
    ) -> None:
        super().__init__(gradient, bounded, scale)
        self.gram, self.hessian, self.penalty = gram, hessian, penalty
        self.workspace = np.empty(0)
        self.scaling: Preconditioner | None = None
        self.updated: tuple[float, UpdatedFactor] | None = None
        self.diagonal = gram.diagonal.copy()
        if penalty is not None:
            on = penalty.rows == penalty.columns
            np.add.at(self.diagonal, penalty.rows[on], penalty.values[on])

    def first_guess(self) -> FloatArray:
        z = np.zeros(self.bounded.size)
        _kernels.descend(self.gram.all, self.gradient(z), z, self.bounded, _FIRST_SWEEPS)
        return z

    def step(self, downhill: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        picked = np.flatnonzero(free)
        if self._is_large(picked.size):
            return self._conjugate_gradients(downhill, free, ridge)
        if self.updated is not None and self.updated[0] == ridge:
            step = self.updated[1].solve(downhill, free, partial(self._block, ridge))
            if step is not None:
                return step
        self.updated = None
        factor = self._factorise(picked, ridge).factor
        if picked.size >= LEAST:
            self.updated = ridge, UpdatedFactor(free, factor)
        found = np.zeros(free.size)
        found[picked], _ = lapack.dpotrs(factor, downhill[picked], lower=0)
        return found

    def _block(self, ridge: float, rows: IntArray, columns: IntArray) -> FloatArray:
        """(k, m) entries of the normal equations with a ridge."""
        block = self.gram.block(rows, columns)
        block += ridge * (rows[:, None] == columns)
        if self.penalty is not None:
            entries = self.penalty
            row, column = self._places(rows), self._places(columns)
            _kernels.add_block(entries.rows, entries.columns, entries.values, row, column, block)
        return block

    def _places(self, picked: IntArray) -> IntArray:
        """(n,) where each unknown is among those picked, -1 for others."""
        place = np.full(self.bounded.size, -1)
        place[picked] = np.arange(picked.size)
        return place

    def refined(self, found: BoundedSolution, rows: Rows) -> BoundedSolution:
        """Refine the solution, and compute its optimality again."""
        picked = np.flatnonzero(~self.bounded | (found.z > 0))
        scaling = self._scaling(picked) if picked.size else None
        if scaling is None:
            return found
        fine, settled = refine(rows, found.z, scaling)
        z = np.where(self.bounded, np.maximum(fine, 0.0), fine)
        kkt = optimality(z, self.gradient(z), self.bounded, self.scale)
        if kkt > max(found.kkt, TOLERANCE) and not np.array_equal(z, fine):
            return found  # a bound lies in between
        return BoundedSolution(z, kkt, self.factorisations, settled)

    def _scaling(self, picked: IntArray) -> Preconditioner | None:
        """Factor of the free part; the last one if it is of the same unknowns."""
        if self.scaling is not None and np.array_equal(self.scaling.picked, picked):
            return self.scaling
        if self._is_large(picked.size):
            if self.bounded[picked].any():
                return None
            return Preconditioner(picked, np.sqrt(self.diagonal[picked] + _LEAST_RIDGE))
        for ridge in (_LEAST_RIDGE, _FIRST_RIDGE):
            with suppress(LinAlgError):
                return self._factorise(picked, ridge)
        return None

    def _is_large(self, unknowns: int) -> bool:
        return unknowns > _FACTORISED

    def _factorise(self, picked: IntArray, ridge: float) -> Preconditioner:
        """Cholesky factor of the normal equations of some unknowns, with a ridge."""
        self.scaling = self.updated = None
        matrix = self._matrix(picked.size)
        self.gram.lower(picked, ridge, matrix)
        if self.penalty is not None:
            entries, place = self.penalty, self._places(picked)
            _kernels.add_lower(entries.rows, entries.columns, entries.values, place, matrix)
        self.factorisations += 1
        # The lower triangle in C order is the upper one in Fortran order: no copy is made.
        factor, failed = lapack.dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
        if failed:
            raise LinAlgError("normal matrix is not positive definite")
        self.scaling = Preconditioner(picked, factor)
        return self.scaling

    def _matrix(self, size: int) -> FloatArray:
        """Reused workspace for a square matrix: allocating it costs more than filling it."""
        if self.workspace.size < size**2:
            self.workspace = np.empty(size**2)
        return self.workspace[: size**2].reshape(size, size)

    def _conjugate_gradients(self, rhs: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        """Step of the free unknowns without a factorisation, which would be too large."""
        step, residual = np.zeros(rhs.size), rhs.copy()
        diagonal = self.diagonal + ridge
        direction = residual / diagonal
        rho = residual @ direction
        enough = _CG_TOLERANCE * np.sqrt(rho)
        for _ in range(_CG_STEPS):
            if not rho > enough**2:
                break
            product = np.where(free, self.hessian(direction) + ridge * direction, 0.0)
            length = rho / (direction @ product)
            step += length * direction
            residual -= length * product
            conditioned = residual / diagonal
            rho, before = residual @ conditioned, rho
            direction = conditioned + (rho / before) * direction
        return step
