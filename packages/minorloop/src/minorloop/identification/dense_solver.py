"""Least squares under bounds on dense matrices: products and solvers.

Residuals are computed from the rows A if they are given, not from A'A, so that the squared
condition number does not limit the optimality. It does limit the accuracy of the unknowns, so they
are refined on the rows. Normal equations lose half of the digits: their factor is only the
preconditioner of LSQR (Paige and Saunders, ACM Trans. Math. Softw. 8, 1982), which works on the
rows. All directions that the factor represents accurately take one step together; each direction
that is lost to rounding takes about one more.

The free part is factorised while it is small, and a few exchanges only update the factor. For a
larger part, conjugate gradients on A are cheaper: they take a few hundred steps if a penalty keeps
the condition number low.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import LinAlgError, lapack

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification import _kernels
from minorloop.identification.active_set import TOLERANCE, BoundedSolution, Pivoting, optimality
from minorloop.identification.linear_algebra import conjugate_gradients, mirror, upper_solve
from minorloop.threads import one_thread

if TYPE_CHECKING:
    from scipy.sparse import csr_array

UNSETTLED = 1e-9
"""Relative excess of the sum of squares up to which a solution counts as converged."""
_FALL = 1e-10
"""Relative decrease of the sum of squares below which the refinement stops."""
_ROUNDING = 1e-14
"""Residual over the norm of the target below which it is rounding."""
_ROUNDS, _STEPS = 6, 200
_HALF = 0.5
_ORTHOGONAL = 1e-8
_PRECISE = 1e-13
_DAMPING = 1e-7
"""Damping that keeps undetermined directions at rest; further rounds correct its other effects."""
_TOGETHER = 32
"""Number of rows of the Gram matrix that are computed at once."""
_WHOLE, _SHARE = 6000, 1 / 8
"""Most unknowns of a matrix that is computed whole, and the share of its rows from which it is. On
100 bands it takes as long as 43 % of the rows of 20,000 samples of random steps, and 69 % of 2,000;
at least half of the rows are needed in the end. On 200 bands it takes 3.2 GB and 9 s more (random
staircase of seed 1008 of ``benchmarks.fit_times``)."""
_FIRST_SWEEPS = 5
_LEAST_UPDATED = 500
"""Unknowns from which an update of the factor is quicker than another factorisation."""
_FACTORISED, _FACTORISED_SMOOTH = 5100, 2500
"""Free unknowns up to which a factorisation is cheaper: in general, and with a penalty and bounds,
where the solution need not be refined."""
_CG_TOLERANCE, _CG_STEPS = 1e-8, 3000
"""Relative residual and most steps of the conjugate gradients, by trial. A few hundred steps are
usual. They need not be exact, because the next iteration corrects them."""
_FIRST_RIDGE, _LEAST_RIDGE = 1e-4, 1e-12


class GramRows:
    """Entries of a symmetric (n, n) matrix, which computes and keeps only the requested part.

    The lower triangle of this part is kept, with unknowns in the order of the requests.

    Parameters
    ----------
    diagonal : (n,) array
        Diagonal of the matrix.
    compute : callable
        Rows (k,) of the matrix at columns (m,): (k, m).
    whole : callable
        Lower triangle of the matrix (n, n); quicker than most of its rows.
    """

    def __init__(
        self,
        diagonal: FloatArray,
        compute: Callable[[IntArray, IntArray], FloatArray],
        whole: Callable[[], FloatArray],
    ) -> None:
        self.diagonal, self._compute, self._whole = diagonal, compute, whole
        self._place = np.full(diagonal.size, -1)
        self._known = np.empty(0, dtype=np.int64)
        self._entries, self._begin = np.empty(0), np.empty(0, dtype=np.int64)
        self._is_whole = False

    @classmethod
    def of(cls, gram: FloatArray) -> GramRows:
        """Entries of a matrix given by its lower triangle; overwrites the upper triangle."""
        found = cls(gram.diagonal().copy(), lambda which, at: gram[np.ix_(which, at)], lambda: gram)
        found._take_whole()
        return found

    @property
    def all(self) -> FloatArray:
        """(n, n) matrix."""
        if not self._is_whole:
            self._take_whole()
        return self._entries.reshape(self.diagonal.size, -1)

    def block(self, rows: IntArray, columns: IntArray) -> FloatArray:
        """(k, m) entries in these rows (k,) and columns (m,)."""
        self._prepare(rows)
        self._prepare(columns)
        one, other = self._place[rows][:, None], self._place[columns]
        return np.asarray(
            self._entries[self._begin[np.maximum(one, other)] + np.minimum(one, other)]
        )

    def lower(self, picked: IntArray, ridge: float, out: FloatArray) -> None:
        """Write rows and columns ``picked``, plus a ridge, to the lower triangle of ``out``."""
        self._prepare(picked)
        _kernels.take_lower(self._entries, self._begin, self._place[picked], ridge, out)

    def _prepare(self, unknowns: IntArray) -> None:
        new = unknowns[self._place[unknowns] < 0]
        if not new.size:
            return
        before, count, size = self._known.size, self._known.size + new.size, self.diagonal.size
        if _SHARE * size < count and size <= _WHOLE:
            self._take_whole()
            return
        self._known = np.append(self._known, new)
        self._place[new] = np.arange(before, count)
        number = np.arange(count)
        self._begin = number * (number + 1) // 2
        self._entries.resize(count * (count + 1) // 2, refcheck=False)  # does not copy
        for first in range(before, count, _TOGETHER):
            last = min(first + _TOGETHER, count)
            rows = self._compute(self._known[first:last], self._known[:last])
            for k in range(first, last):
                self._entries[self._begin[k] :][: k + 1] = rows[k - first, : k + 1]

    def _take_whole(self) -> None:
        whole = self._whole()
        mirror(whole)
        self._known = self._place = np.arange(self.diagonal.size)
        self._entries, self._begin = whole.ravel(), self._known * self.diagonal.size
        self._is_whole = True


class Quadratic:
    """The cost 1/2 z'Gz + 1/2 z'Qz - b'z of unknowns z (n,), with its gradient and products.

    ``gram`` is G, whose diagonal is about one, or zero where a column is zero. With a guess, only
    entries of unknowns that become free are needed. ``linear`` is b, and ``penalty`` Q. A subclass
    may compute gradient and product without forming G.
    """

    def __init__(
        self,
        gram: GramRows,
        linear: FloatArray,
        penalty: csr_array[Any] | None = None,
    ) -> None:
        self.gram, self.linear, self.penalty = gram, linear, penalty

    @property
    def diagonal(self) -> FloatArray:
        """(n,) diagonal of G + Q."""
        penalty = 0.0 if self.penalty is None else self.penalty.diagonal()
        return np.asarray(self.gram.diagonal + penalty)

    def gradient(self, z: FloatArray) -> FloatArray:
        """(n,) gradient at ``z``."""
        return self._penalised(self.gram.all @ z - self.linear, z)

    def product(self, z: FloatArray) -> FloatArray:
        """(n,) product of G + Q with ``z``."""
        return self._penalised(self.gram.all @ z, z)

    def _penalised(self, out: FloatArray, z: FloatArray) -> FloatArray:
        """Add Q z in place."""
        if self.penalty is not None:
            out += self.penalty @ z
        return np.asarray(out)

    def block(self, ridge: float, rows: IntArray, columns: IntArray) -> FloatArray:
        """(k, m) entries of G + Q plus a ridge."""
        block = self.gram.block(rows, columns)
        block += ridge * (rows[:, None] == columns)
        self._add_penalty(rows, columns, block)
        return block

    def lower(self, picked: IntArray, ridge: float, out: FloatArray) -> None:
        """Write these rows and columns of G + Q, plus a ridge, to a lower triangle."""
        self.gram.lower(picked, ridge, out)
        self._add_penalty(picked, picked, out)

    def _add_penalty(self, rows: IntArray, columns: IntArray, out: FloatArray) -> None:
        if (penalty := self.penalty) is not None:
            place = np.full(penalty.shape[0], -1)
            place[columns] = np.arange(columns.size)
            _kernels.add_rows(penalty.indptr, penalty.indices, penalty.data, rows, place, out)


@dataclass(frozen=True)
class Rows:
    """A least-squares problem: ``apply`` is z -> A z, ``transpose`` is r -> A'r, ``target`` is y.

    A penalty consists of rows with the target zero.
    """

    apply: Callable[[FloatArray], FloatArray]
    transpose: Callable[[FloatArray], FloatArray]
    target: FloatArray

    def residual(self, z: FloatArray) -> FloatArray:
        """Target less A z."""
        return self.target - self.apply(z)


def solve(
    quadratic: Quadratic,
    bounded: BoolArray,
    scale: float,
    *,
    guess: FloatArray | None = None,
    rows: Rows | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> BoundedSolution:
    """Find the unknowns that meet the optimality conditions, or come nearest to it.

    Parameters
    ----------
    quadratic : Quadratic
        The cost.
    bounded : (n,) array of bool
        Whether an unknown must not be negative.
    scale : float
        Norm of y, to which violations are relative.
    guess : (n,) array, optional
        Start of the iteration.
    rows : Rows, optional
        Rows of A and y, then those of the penalty, for the refinement.
    say : callable
        Called with the state of the search.
    """
    solver = _DensePivoting(quadratic, bounded, scale, say)
    with one_thread():
        found = solver.run(solver.first_guess() if guess is None else guess)
        return found if rows is None else solver.refined(found, rows)


class _DensePivoting(Pivoting):
    def __init__(
        self, quadratic: Quadratic, bounded: BoolArray, scale: float, say: Callable[[str], None]
    ) -> None:
        super().__init__(quadratic.gradient, bounded, scale)
        self.quadratic, self.say, self.workspace = quadratic, say, np.empty(0)
        self.scaling: _Preconditioner | None = None
        self.updated: tuple[float, _UpdatedFactor] | None = None

    @property
    def most_factorised(self) -> int:
        """Most free unknowns whose normal equations are factorised."""
        smooth = self.quadratic.penalty is not None and self.bounded.any()
        return min(_FACTORISED, _FACTORISED_SMOOTH) if smooth else _FACTORISED

    def first_guess(self) -> FloatArray:
        z = np.zeros(self.bounded.size)
        _kernels.descend(self.quadratic.gram.all, self.gradient(z), z, self.bounded, _FIRST_SWEEPS)
        return z

    def step(self, downhill: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        picked = np.flatnonzero(free)
        if picked.size > self.most_factorised:
            return self._conjugate_gradients(downhill, free, ridge)
        if self.updated is not None and self.updated[0] == ridge:
            block = partial(self.quadratic.block, ridge)
            step = self.updated[1].solve(downhill, free, block)
            if step is not None:
                return step
        self.updated = None
        factor = self._factorise(picked, ridge).factor
        if picked.size >= _LEAST_UPDATED:
            self.updated = ridge, _UpdatedFactor(free, factor)
        found = np.zeros(free.size)
        found[picked], _ = lapack.dpotrs(factor, downhill[picked], lower=0)
        return found

    def _conjugate_gradients(self, right: FloatArray, free: BoolArray, ridge: float) -> FloatArray:
        """Step of the free unknowns without a factorisation, whose factor would be too large."""
        diagonal = self.quadratic.diagonal + ridge
        return conjugate_gradients(
            lambda z: np.where(free, self.quadratic.product(z) + ridge * z, 0.0),
            lambda r: r / diagonal,
            right,
            _CG_TOLERANCE * float(np.linalg.norm(right)),
            _CG_STEPS,
        )

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
            return found  # a bound prevents the full step
        return BoundedSolution(z, kkt, self.factorisations, settled)

    def _scaling(self, picked: IntArray) -> _Preconditioner | None:
        """Factor of the free part; the last factor if it has the same unknowns."""
        if self.scaling is not None and np.array_equal(self.scaling.picked, picked):
            return self.scaling
        if picked.size > self.most_factorised:
            if self.bounded[picked].any():
                return None
            return _Preconditioner(picked, np.sqrt(self.quadratic.diagonal[picked] + _LEAST_RIDGE))
        for ridge in (_LEAST_RIDGE, _FIRST_RIDGE):
            with suppress(LinAlgError):
                return self._factorise(picked, ridge)
        return None

    def _factorise(self, picked: IntArray, ridge: float) -> _Preconditioner:
        """Cholesky factor of the normal equations of some unknowns, with a ridge."""
        self.scaling = self.updated = None
        size = picked.size**2
        if self.workspace.size < size:  # reused: to allocate it takes longer than to fill it
            self.workspace = np.empty(size)
        matrix = self.workspace[:size].reshape(picked.size, -1)
        self.quadratic.lower(picked, ridge, matrix)
        self.factorisations += 1
        # The lower triangle in C order is the upper one in Fortran order: no copy is made.
        factor, failed = lapack.dpotrf(matrix.T, lower=0, clean=0, overwrite_a=1)
        if failed:
            raise LinAlgError("normal matrix is not positive definite")
        self.scaling = _Preconditioner(picked, factor)
        return self.scaling


class _UpdatedFactor:
    """Cholesky factor of normal equations, updated as a few unknowns become free or leave.

    An unknown that leaves has an equation that keeps it at zero, with a multiplier. The Schur
    complement of the factorised part in the extended system is small and dense (Gill, Murray,
    Saunders and Wright, A Schur-complement method for sparse quadratic programming, in Reliable
    Numerical Computation, 1990).

    ``free`` (n,) of bool: unknowns that are factorised, m of them; ``factor`` (m, m): upper
    Cholesky factor of their normal equations.
    """

    def __init__(self, free: BoolArray, factor: FloatArray) -> None:
        self._free, self._factor = free, factor
        self._picked = np.flatnonzero(free)
        self._place = np.cumsum(free) - 1
        self._slot = np.full(free.size, -1)
        self._count = 0
        # Ratio of changed to factorised unknowns up to which an update is quicker. Each change
        # costs a triangular solution; at a third, they cost as much as the factorisation
        self._half = np.empty((self._picked.size, int(0.25 * self._picked.size)), order="F")

    def solve(
        self, right: FloatArray, free: BoolArray, block: Callable[[IntArray, IntArray], FloatArray]
    ) -> FloatArray | None:
        """(n,) solution for the ``free`` unknowns, zero for others; None after too many changes.

        ``right`` (n,) is zero for the others; ``block`` returns entries (k, m) of the normal
        equations in rows (k,) and columns (m,).
        """
        changed = np.flatnonzero(free != self._free)
        if not self._prepare(changed[self._slot[changed] < 0], block):
            return None
        joins, half = free[changed], self._half[:, self._slot[changed]]
        joined = changed[joins]
        complement = -half.T @ half
        complement[np.ix_(joins, joins)] += block(joined, joined)
        begun = upper_solve(self._factor, right[self._picked], transposed=True)
        values = np.linalg.solve(complement, right[changed] - half.T @ begun)
        out = np.zeros(right.size)
        out[self._picked] = upper_solve(self._factor, begun - half @ values, transposed=False)
        out[changed] = np.where(joins, values, 0.0)
        return out

    def _prepare(self, new: IntArray, block: Callable[[IntArray, IntArray], FloatArray]) -> bool:
        """Keep half-solutions for unknowns that change for the first time, if there is room."""
        count = self._count + new.size
        if count > self._half.shape[1]:
            return False
        if new.size:
            joins, leaves = np.flatnonzero(~self._free[new]), np.flatnonzero(self._free[new])
            sides = np.zeros((self._picked.size, new.size), order="F")
            sides[:, joins] = block(self._picked, new[joins])
            sides[self._place[new[leaves]], leaves] = 1.0
            self._half[:, self._count : count] = upper_solve(self._factor, sides, transposed=True)
            self._slot[new] = np.arange(self._count, count)
            self._count = count
        return True


@dataclass(frozen=True)
class _Preconditioner:
    """Indices of the free unknowns, and their preconditioner.

    ``factor`` is the upper Cholesky factor of their normal equations, or the diagonal of one.
    """

    picked: IntArray
    factor: FloatArray

    def unscaled(self, values: FloatArray) -> FloatArray:
        """Free unknowns from scaled unknowns."""
        return self._solved(values, transposed=False)

    def scaled(self, gradient: FloatArray) -> FloatArray:
        """Gradient in the scaled free unknowns from the gradient in all unknowns."""
        return self._solved(gradient[self.picked], transposed=True)

    def _solved(self, values: FloatArray, *, transposed: bool) -> FloatArray:
        if self.factor.ndim == 1:
            return values / self.factor
        return upper_solve(self.factor, values, transposed=transposed)


def refine(rows: Rows, z: FloatArray, scaling: _Preconditioner) -> tuple[FloatArray, bool]:
    """Return unknowns of the least sum of squares over the free ones, and whether it converged.

    The iteration starts at ``z`` (n,), whose other unknowns stay unchanged.
    """
    floor = _ROUNDING * float(np.linalg.norm(rows.target))
    left = rows.residual(z)
    for _ in range(_ROUNDS):
        norm = float(np.linalg.norm(left))
        slope = float(np.linalg.norm(scaling.scaled(rows.transpose(left))))
        if norm == 0 or (norm > floor and slope <= _ORTHOGONAL * norm):
            return z, True
        trial = z.copy()
        trial[scaling.picked] += _correction(rows, left, scaling, z.size)
        remaining = rows.residual(trial)
        fallen = 1 - (float(np.linalg.norm(remaining)) / norm) ** 2
        if fallen > _FALL:
            z, left = trial, remaining
        if fallen <= _FALL or (norm <= floor and fallen < _HALF):
            return z, norm <= floor or slope**2 <= UNSETTLED * norm**2
    return z, bool(np.linalg.norm(left) <= floor)


def _correction(
    rows: Rows, left: FloatArray, scaling: _Preconditioner, unknowns: int
) -> FloatArray:
    """Step of the free unknowns that nearly minimises the residual."""
    from scipy.sparse.linalg import LinearOperator, lsqr

    spread = np.zeros(unknowns)

    def apply(values: FloatArray) -> FloatArray:
        spread[scaling.picked] = scaling.unscaled(values.ravel())
        return rows.apply(spread)

    def transpose(values: FloatArray) -> FloatArray:
        return scaling.scaled(rows.transpose(values.ravel()))

    operator = LinearOperator(
        (left.size, scaling.picked.size), matvec=apply, rmatvec=transpose, dtype=np.float64
    )
    found = lsqr(
        operator, left, damp=_DAMPING, atol=_PRECISE, btol=_PRECISE, conlim=0, iter_lim=_STEPS
    )
    return scaling.unscaled(found[0])
