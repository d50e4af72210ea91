"""Refinement of a least-squares solution on its rows instead of its normal equations.

Normal equations lose half of the digits: their condition number is the square of that of the rows.
Here their factor is only the preconditioner of LSQR (Paige and Saunders, ACM Trans. Math. Softw. 8,
1982), which works on the rows. Directions that the factor represents accurately take one step
together; each direction lost in its rounding takes about one more.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from minorloop.arrays import FloatArray, IntArray

FALL = 1e-10
"""Relative decrease of the sum of squares below which the refinement stops."""
UNSETTLED = 1e-9
"""Relative excess of the sum of squares up to which a solution counts as converged."""
ROUNDING = 1e-14
"""Residual, over the norm of the target, up to which it is rounding."""

_ROUNDS, _STEPS = 6, 200
_HALF = 0.5
_ORTHOGONAL = 1e-8
_PRECISE = 1e-13
_DAMPING = 1e-7
"""Keeps undetermined directions at rest; the rounds correct its effect on the others."""


@dataclass(frozen=True)
class Rows:
    """A least-squares problem: ``apply`` is z -> A z, ``transpose`` is r -> A'r, ``target`` is y.

    A penalty is rows whose target is zero.
    """

    apply: Callable[[FloatArray], FloatArray]
    transpose: Callable[[FloatArray], FloatArray]
    target: FloatArray

    def residual(self, z: FloatArray) -> FloatArray:
        """Target less A z."""
        return self.target - self.apply(z)


@dataclass(frozen=True)
class Preconditioner:
    """Indices of the free unknowns, and their preconditioner.

    ``picked`` are their indices. ``factor`` is the upper Cholesky factor of their normal
    equations, or the diagonal of one.
    """

    picked: IntArray
    factor: FloatArray

    def unscaled(self, values: FloatArray) -> FloatArray:
        """Free unknowns from scaled ones."""
        return self._solved(values, transposed=False)

    def scaled(self, gradient: FloatArray) -> FloatArray:
        """Gradient in the scaled free unknowns from that in all unknowns."""
        return self._solved(gradient[self.picked], transposed=True)

    def _solved(self, values: FloatArray, *, transposed: bool) -> FloatArray:
        if self.factor.ndim == 1:
            return values / self.factor
        solved, _ = lapack.dtrtrs(self.factor, values, lower=0, trans=int(transposed))
        return np.asarray(solved)


def refine(rows: Rows, z: FloatArray, scaling: Preconditioner) -> tuple[FloatArray, bool]:
    """Minimise the sum of squares over the free unknowns; also says whether it has converged.

    Parameters
    ----------
    rows : Rows
        The problem.
    z : (n,) array
        Start; unknowns that are not free stay unchanged.
    scaling : Preconditioner
        Free unknowns and their preconditioner.
    """
    floor = ROUNDING * float(np.linalg.norm(rows.target))
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
        if fallen > FALL:
            z, left = trial, remaining
        if fallen <= FALL or (norm <= floor and fallen < _HALF):
            return z, norm <= floor or slope**2 <= UNSETTLED * norm**2
    return z, bool(np.linalg.norm(left) <= floor)


def _correction(rows: Rows, left: FloatArray, scaling: Preconditioner, unknowns: int) -> FloatArray:
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
