"""A Cholesky factor that also solves for slightly other sets of unknowns.

References
----------
Gill, Murray, Saunders and Wright, A Schur-complement method for sparse quadratic programming, in
Reliable Numerical Computation, 1990: unknowns join or leave a factorised system.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import lapack

from minorloop.arrays import BoolArray, FloatArray, IntArray

LEAST = 500
"""Unknowns from which an update is quicker than another factorisation."""
_SHARE = 0.25
"""Changed unknowns, over those factorised, up to which it is. Each costs a triangular solution; a
third of them all cost as much as the factorisation."""


class UpdatedFactor:
    """Factor of the normal equations of some unknowns of n.

    Unknowns that leave have an equation that keeps them at zero; each has a multiplier. The Schur
    complement of the factorised part in the extended system is small and dense.

    Parameters
    ----------
    free : (n,) array of bool
        Unknowns that are factorised.
    factor : (m, m) array
        Upper Cholesky factor of their normal equations.
    """

    def __init__(self, free: BoolArray, factor: FloatArray) -> None:
        self._free, self._factor = free, factor
        self._picked = np.flatnonzero(free)
        self._place = np.cumsum(free) - 1
        self._slot = np.full(free.size, -1)
        self._count = 0
        self._half = np.empty((self._picked.size, int(_SHARE * self._picked.size)), order="F")

    def solve(
        self, right: FloatArray, free: BoolArray, block: Callable[[IntArray, IntArray], FloatArray]
    ) -> FloatArray | None:
        """(n,) solution for the ``free`` unknowns, zero for others; None after too many changes.

        Parameters
        ----------
        right : (n,) array
            Right-hand side, zero for the others.
        free : (n,) array of bool
            Unknowns.
        block : callable
            Entries (k, m) of the normal equations in rows (k,) and columns (m,).
        """
        changed = np.flatnonzero(free != self._free)
        if not self._prepare(changed[self._slot[changed] < 0], block):
            return None
        joins, half = free[changed], self._half[:, self._slot[changed]]
        joined = changed[joins]
        complement = -half.T @ half
        complement[np.ix_(joins, joins)] += block(joined, joined)
        begun = self._solved(right[self._picked], transposed=True)
        values = np.linalg.solve(complement, right[changed] - half.T @ begun)
        out = np.zeros(right.size)
        out[self._picked] = self._solved(begun - half @ values, transposed=False)
        out[changed] = np.where(joins, values, 0.0)
        return out

    def _prepare(self, new: IntArray, block: Callable[[IntArray, IntArray], FloatArray]) -> bool:
        """Keep half of the solutions for unknowns that change for the first time, if they fit."""
        count = self._count + new.size
        if count > self._half.shape[1]:
            return False
        if new.size:
            joins, leaves = np.flatnonzero(~self._free[new]), np.flatnonzero(self._free[new])
            sides = np.zeros((self._picked.size, new.size), order="F")
            sides[:, joins] = block(self._picked, new[joins])
            sides[self._place[new[leaves]], leaves] = 1.0
            self._half[:, self._count : count] = self._solved(sides, transposed=True)
            self._slot[new] = np.arange(self._count, count)
            self._count = count
        return True

    def _solved(self, values: FloatArray, *, transposed: bool) -> FloatArray:
        found, _ = lapack.dtrtrs(self._factor, values, lower=0, trans=int(transposed))
        return np.asarray(found)
