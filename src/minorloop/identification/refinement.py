"""Last digits of a least-squares solution, from its rows and not from its normal equations.

Normal equations lose half of the digits: their condition is the square of that of the rows. Here
a factor of them is only the preconditioner of LSQR (Paige and Saunders, ACM Trans. Math. Softw. 8,
1982), which works on the rows themselves. Directions that the factor holds well cost one step,
and each one that is lost in its rounding costs about one more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from minorloop.arrays import FloatArray, IntArray

FALL = 1e-10
"""Share of the sum of squares below which a fall is not worth having."""
UNSETTLED = 1e-9
"""And the share that a solution which has converged may be away from the least."""
ROUNDING = 1e-14
"""Share of the norm of the target up to which a residual is rounding."""

_ROUNDS, _STEPS = 6, 200
_HALF = 0.5
_ORTHOGONAL = 1e-8
_PRECISE = 1e-13
_DAMPING = 1e-7
"""Keeps still what the rows do not determine at all; the rounds make up for it elsewhere."""


@dataclass(frozen=True)
class Rows:
    """A least-squares problem: ``apply`` is z -> A z, ``transpose`` is r -> A'r, ``target`` is y.

    A penalty is rows whose target is zero.
    """

    apply: Callable[[FloatArray], FloatArray]
    transpose: Callable[[FloatArray], FloatArray]
    target: FloatArray

    def residual(self, z: FloatArray) -> FloatArray:
        """What z leaves of the target."""
        return self.target - self.apply(z)


@dataclass(frozen=True)
class Preconditioner:
    """The free unknowns and how to scale them.

    ``picked`` are their indices. ``factor`` is the upper Cholesky factor of their normal
    equations, or the diagonal of one.
    """

    picked: IntArray
    factor: FloatArray

    def unscaled(self, values: FloatArray) -> FloatArray:
        """Free unknowns for scaled ones."""
        return self._solved(values, transposed=False)

    def scaled(self, gradient: FloatArray) -> FloatArray:
        """Gradient by the scaled free unknowns, for that by all unknowns."""
        return self._solved(gradient[self.picked], transposed=True)

    def _solved(self, values: FloatArray, *, transposed: bool) -> FloatArray:
        if self.factor.ndim == 1:
            return values / self.factor
        solved, _ = lapack.dtrtrs(self.factor, values, lower=0, trans=int(transposed))
        return np.asarray(solved)


def refine(rows: Rows, z: FloatArray, scaling: Preconditioner) -> tuple[FloatArray, bool]:
    """Free unknowns that minimise the sum of squares, and whether it falls no further.

    Parameters
    ----------
    rows : Rows
        The problem.
    z : (n,) array
        Where to begin; unknowns that are not free stay as they are.
    scaling : Preconditioner
        Which unknowns are free.
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
    """Step of the free unknowns that brings the residual near to its least."""
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
