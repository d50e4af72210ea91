"""Factorisation of a sparse symmetric matrix whose pattern does not change.

The matrix is quasi-definite (Vanderbei, SIAM J. Optim. 5, 1995): its unknowns have signs, and it is
positive definite on those of one sign and negative definite on the others. Then each order of
elimination is possible. The order is by least degree (Liu, ACM Trans. Math. Softw. 11, 1985),
computed by SuperLU. Columns with nearly the same rows are eliminated together (Ng and Peyton, SIAM
J. Sci. Comput. 14, 1993).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification import _sparse_kernels as _kernels

if TYPE_CHECKING:
    from scipy.sparse import csc_array

_DOMINANT = 1e3
"""Added to the diagonal where only the order of elimination is wanted, so that no pivot is zero;
its size does not matter."""
_ROUNDING = 1e-15
"""Size of a pivot, over that of its column before elimination, that counts as zero: a few times the
precision of float64."""


class SparseFactor:
    """Factor of a matrix given by its entries.

    Parameters
    ----------
    rows, columns : (E,) arrays of int
        Places of the entries, in one triangle. Entries in the same place are added.
    sign : (n,) array
        1 or -1 for each unknown.
    last : int
        Unknowns at the end that are eliminated last, because they are linked to most others.
    """

    def __init__(self, rows: IntArray, columns: IntArray, sign: FloatArray, last: int = 0) -> None:
        from scipy.sparse import coo_array

        n = sign.size
        ends = np.concatenate([rows, columns, np.arange(n)])
        others = np.concatenate([columns, rows, np.arange(n)])
        self._entries, self._sign = (rows, columns), sign
        self._pattern = coo_array((np.ones(ends.size), (ends, others)), shape=(n, n)).tocsc()
        least = _least_degree(self._pattern[: n - last, : n - last])
        self._order = np.append(least, np.arange(n - last, n))
        tree = _elimination_tree(*_permuted(self._pattern, self._order))
        self._parent, self.counts = tree
        self._data: FloatArray | None = None

    def _lay_out(self) -> FloatArray:
        """Find the panels and the places of the entries; many systems are only counted."""
        n = self._sign.size
        self._order = self._order[_kernels.postorder(self._parent)]
        first, below = _permuted(self._pattern, self._order)
        parent, counts = _elimination_tree(first, below)
        self._start, height = _kernels.panels(parent, counts)
        width = np.diff(self._start)
        self._at = np.append(0, np.cumsum(height))
        self._offset = np.append(0, np.cumsum(height * width))
        rows, self._panel_of = _kernels.panel_rows(first, below, self._start, self._at)
        # Sorted here, because numba compiles a sort for longer than all these loops.
        key = np.sort(np.repeat(np.arange(height.size), height) * n + rows)
        self._rows = key % n
        place = np.argsort(self._order)
        one, other = (place[end] for end in self._entries)
        column = np.minimum(one, other)
        panel = self._panel_of[column]
        row = np.searchsorted(key, panel * n + np.maximum(one, other)) - self._at[panel]
        self._places = self._offset[panel] + row * width[panel] + column - self._start[panel]
        self._sign = self._sign[self._order]
        return np.empty(self._offset[-1])

    def factorise(self, values: FloatArray) -> None:
        """Factorise the matrix with these (E,) values of its entries."""
        if self._data is None:
            self._data = self._lay_out()
        _kernels.factorise(
            self._start,
            self._at,
            self._rows,
            self._offset,
            self._panel_of,
            self._sign,
            self._places,
            values,
            _ROUNDING,
            self._data,
        )

    def solve(self, b: FloatArray) -> FloatArray:
        """(n,) solution of the system with the right-hand side ``b``."""
        x = b[self._order]
        _kernels.solve(self._start, self._at, self._rows, self._offset, self._sign, self._data, x)
        out = np.empty_like(b)
        out[self._order] = x
        return out

    def inverse(self) -> FloatArray:
        """(E,) inverse at the entries of the matrix."""
        out = np.empty_like(self._data)
        _kernels.invert(
            self._start,
            self._at,
            self._rows,
            self._offset,
            self._panel_of,
            self._sign,
            self._data,
            out,
        )
        return np.asarray(out[self._places])

    def logarithm(self) -> float:
        """Logarithm of the magnitude of the determinant."""
        return 2 * float(np.log(_kernels.pivots(self._start, self._offset, self._data)).sum())

    def products(self, b: FloatArray) -> FloatArray:
        """(r, r) products b' M^-1 b with the inverse of the matrix, for columns ``b`` (n, r)."""
        x = self._half(b)
        return np.asarray((x.T * self._sign) @ x)

    def squares(self, b: FloatArray) -> FloatArray:
        """(r,) diagonal of `products`."""
        x = self._half(b)
        return np.asarray(np.einsum("n,nr,nr->r", self._sign, x, x))

    def _half(self, b: FloatArray) -> FloatArray:
        """Solution of half the system, L X = B."""
        x = np.ascontiguousarray(b[self._order])
        _kernels.solve_half(self._start, self._at, self._rows, self._offset, self._data, x)
        return x


def _least_degree(pattern: csc_array[Any]) -> IntArray:
    """Order of elimination with little fill."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import spilu

    count = pattern.shape[0]
    dominant = csc_array(pattern + diags_array(np.full(count, _DOMINANT)))
    incomplete = spilu(  # drops all entries, so that it costs little more than the order
        dominant,
        drop_tol=1.0,
        fill_factor=1,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(incomplete.perm_c)


def _permuted(pattern: csc_array[Any], order: IntArray) -> tuple[IntArray, IntArray]:
    """Columns of a permuted pattern: where each begins, and its rows."""
    moved = pattern[order][:, order]
    return moved.indptr.astype(np.int64), moved.indices.astype(np.int64)


def _elimination_tree(first: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Parent of each column in the elimination tree, -1 for a root, and the size of each column."""
    n = first.size - 1
    parent, count = np.full(n, -1), np.ones(n, dtype=np.int64)
    _kernels.elimination_tree(first, rows, parent, np.full(n, -1), count)
    return parent, count
