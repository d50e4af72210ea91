"""Rows of a Gram matrix, each computed when it is first needed."""

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
    """Rows of a symmetric (n, n) matrix that is too large to be computed where few are needed.

    Parameters
    ----------
    diagonal : (n,) array
        Its diagonal.
    compute : callable
        Rows (k, n) of these numbers (k,), ascending.
    whole : callable
        Lower triangle of the matrix (n, n); quicker than most of its rows.
    """

    def __init__(
        self,
        diagonal: FloatArray,
        compute: Callable[[IntArray], FloatArray],
        whole: Callable[[], FloatArray],
    ) -> None:
        self.diagonal, self._compute, self._whole = diagonal, compute, whole
        self._place = np.full(diagonal.size, -1)
        self._rows, self._count = np.empty((0, diagonal.size)), 0

    @classmethod
    def of(cls, gram: FloatArray) -> GramRows:
        """Rows of a matrix that is given by its lower triangle."""
        found = cls(gram.diagonal().copy(), lambda which: gram[which], lambda: gram)
        found._take_whole()
        return found

    @property
    def all(self) -> FloatArray:
        """(n, n) matrix."""
        if not np.array_equal(self._place, np.arange(self.diagonal.size)):
            self._take_whole()
        return self._rows

    def rows(self, which: IntArray) -> FloatArray:
        """(k, n) rows of these numbers (k,)."""
        self._prepare(which)
        return np.asarray(self._rows[self._place[which]])

    def lower(self, picked: IntArray, ridge: float, out: FloatArray) -> None:
        """Write rows and columns ``picked``, plus a ridge, to the lower triangle of ``out``."""
        self._prepare(picked)
        _kernels.take_lower(self._rows, self._place, picked, ridge, out)

    def _prepare(self, which: IntArray) -> None:
        new = which[self._place[which] < 0]
        count = self._count + new.size
        if new.size and _SHARE * self.diagonal.size < count and self.diagonal.size <= _WHOLE:
            self._take_whole()
            return
        if count > len(self._rows):
            rows = np.empty((min(2 * count, self.diagonal.size), self.diagonal.size))
            rows[: self._count] = self._rows[: self._count]
            self._rows = rows
        for begin in range(0, new.size, _TOGETHER):
            some = new[begin : begin + _TOGETHER]
            first = self._count + begin
            self._rows[first : first + some.size] = self._compute(some)
        self._place[new] = np.arange(self._count, count)
        self._count = count

    def _take_whole(self) -> None:
        self._rows = self._whole()
        mirror(self._rows)
        self._count = self.diagonal.size
        self._place = np.arange(self._count)
