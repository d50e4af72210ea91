"""Entries of a Gram matrix, computed for unknowns that are needed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification import _kernels

_TOGETHER = 32
"""Rows that are computed at once."""
_WHOLE, _SHARE = 6000, 1 / 3
"""Most unknowns of a matrix that is computed whole from some share of its rows on, as it is then
quicker; on 100 bands, from 35 % of 20,000 samples of random steps, and 60 % of 2,000. On 200 bands
it takes 3.2 GB and 9 s more (random staircase of seed 1008 of ``benchmarks.fit_times``)."""


def mirror(matrix: FloatArray) -> None:
    """Copy the lower triangle of a matrix (n, n) to the upper one, some rows at a time."""
    for first in range(0, len(matrix), _TOGETHER):
        last = first + _TOGETHER
        corner = np.tril(matrix[first:last, first:last])
        matrix[first:last, first:last] = corner + np.tril(corner, -1).T
        matrix[:first, first:last] = matrix[first:last, :first].T


def scale_symmetric(matrix: FloatArray, scale: FloatArray) -> None:
    """Multiply rows and columns of a matrix (n, n) by a scale (n,), in place."""
    for first in range(0, len(matrix), _TOGETHER):
        matrix[first : first + _TOGETHER] *= scale[first : first + _TOGETHER, None] * scale


class GramRows:
    """Entries of a symmetric (n, n) matrix that is too large to be computed where few are needed.

    The lower triangle of the part that was needed is kept, in the order in which it was.

    Parameters
    ----------
    diagonal : (n,) array
        Its diagonal.
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

    @classmethod
    def of(cls, gram: FloatArray) -> GramRows:
        """Entries of a matrix that is given by its lower triangle."""
        found = cls(gram.diagonal().copy(), lambda which, at: gram[np.ix_(which, at)], lambda: gram)
        found._take_whole()
        return found

    @property
    def all(self) -> FloatArray:
        """(n, n) matrix."""
        if not np.array_equal(self._place, np.arange(self.diagonal.size)):
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

    def _prepare(self, which: IntArray) -> None:
        new = which[self._place[which] < 0]
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
