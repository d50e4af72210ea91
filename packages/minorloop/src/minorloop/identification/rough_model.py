"""A rough model of any hysteresis: polynomials of a few plays, fitted robustly in milliseconds.

It predicts each reading without a fit on the plane, and so shows readings that contradict the
others.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.curves import Curves
from minorloop.operators import _play_kernels

_ROUNDS = 12
_MOST = 800
"""Most samples to fit the rough model to; more hardly change its few unknowns."""
_RIDGE = 1e-7
_OVERSHOOT = 0.5
"""Least distance of an outlier from both neighbouring readings, over its error."""


def beyond_neighbours(error: FloatArray, y: FloatArray, limit: float) -> BoolArray:
    """Return whether each reading (N,) is an isolated outlier: its error exceeds both neighbours'.

    Errors must differ by more than ``limit``. The reading must also be beyond both neighbours by
    half of this difference, unlike a reading beside a jump of the output that the model smears. The
    first and the last reading do not count.
    """
    found = np.zeros(error.size, dtype=np.bool_)
    alone = _above_neighbours(error)
    found[1:-1] = (alone > limit) & (_above_neighbours(y) > _OVERSHOOT * alone)
    return found


def _above_neighbours(values: FloatArray) -> FloatArray:
    """(N - 2,) distance from the nearer neighbour if both are on the same side, else 0."""
    before, after = values[1:-1] - values[:-2], values[1:-1] - values[2:]
    return np.where(before * after > 0, np.minimum(np.abs(before), np.abs(after)), 0.0)


@dataclass(frozen=True, eq=False)
class RoughRecord:
    """A record with its rough model; ``places`` are the indices of measured samples."""

    u: FloatArray
    y: FloatArray
    places: IntArray
    basis: Basis
    rough: FloatArray
    span: float
    lag: int
    curves: Curves

    @classmethod
    def of(
        cls, u: FloatArray, y: FloatArray, known: BoolArray, curves: Curves, lag: int
    ) -> RoughRecord:
        """Fit the rough model to the known samples."""
        applied = curves.delayed(u, lag)
        places = np.flatnonzero(known)
        basis = Basis.of(applied, curves, places.size)
        low, high = np.percentile(y[places], [2, 98])
        rough = _robust_fit(basis, y, known)
        span = float(high - low) or float(np.ptp(y[places])) or 1.0
        return cls(applied, y, places, basis, rough, span, lag, curves)

    @property
    def values(self) -> FloatArray:
        """The measured outputs."""
        return self.y[self.places]


def few(places: IntArray) -> IntArray:
    """At most 800 of the places, one from each part."""
    return places[one_of_each(places.size, _MOST)]


def one_of_each(size: int, most: int) -> IntArray:
    """Return one random row of each of ``most`` blocks, in order; all rows if there are no more.

    Every n-th row of a periodic record might always be at the same phase.
    """
    if size <= most:
        return np.arange(size)
    edges = np.arange(most + 1) * size // most
    return np.asarray(np.random.default_rng(0).integers(edges[:-1], edges[1:]))


@dataclass(frozen=True, eq=False)
class Basis:
    """Polynomials of plays along the input, and a constant.

    ``plays`` (T, P): scaled plays; ``degree``: degree of their polynomials.
    """

    plays: FloatArray
    degree: int

    @classmethod
    def of(cls, u: FloatArray, curves: Curves, samples: int) -> Basis:
        """Plays along the inputs, more of them for more samples.

        ``u`` (T,): inputs; ``curves``: memory before the first input and before each curve; a
        `Memory` counts as ``"negative"``; ``samples``: number of measured outputs.
        """
        plays, degree = (5, 8) if samples >= 200 else (5, 4) if samples >= 100 else (4, 2)
        low, high = float(u.min()), float(u.max())
        x = np.ascontiguousarray((2 * u - low - high) / ((high - low) or 1.0))
        radii = np.linspace(0, 1, plays + 1)[:-1] ** 1.5
        begin = {"positive": radii + 1, "demagnetised": 0 * radii}
        start = curves.start if isinstance(curves.start, str) else "negative"
        traced = np.empty((u.size, plays))
        for first, end in pairwise([*curves.begins.tolist(), u.size]):
            places = begin.get(start, -radii - 1)
            _play_kernels.trace(x[first:end], radii, places.copy(), traced[first:end])
        traced /= np.maximum(np.abs(traced).max(axis=0), 0.05)
        return cls(traced, degree)

    def rows(self, places: IntArray | slice) -> FloatArray:
        """(N, Q) polynomials at some samples."""
        plays = self.plays[places]
        powers = np.polynomial.chebyshev.chebvander(plays, self.degree)[:, :, 1:]
        return np.column_stack([np.ones(len(plays)), powers.reshape(len(plays), -1)])

    @property
    def columns(self) -> int:
        """Q."""
        return 1 + int(self.plays.shape[1]) * self.degree


def _robust_fit(basis: Basis, y: FloatArray, known: BoolArray) -> FloatArray:
    """Outputs of the rough model with the least absolute error on the known samples, (T,)."""
    places = few(np.flatnonzero(known))
    rows, wanted = basis.rows(places), y[places]
    low, middle, high = np.percentile(wanted, [5, 50, 95])
    reach = 2 * max(high - low, 1e-9 * float(np.ptp(wanted)), 1e-150)  # a dead meter has range 0
    near = np.clip(wanted, low - reach, high + reach)
    smallest = 1e-6 * reach
    weights = np.ones(near.size)
    found = np.zeros(basis.columns)
    for _ in range(_ROUNDS):
        found = weighted(rows, near - middle, weights)
        weights = 1 / np.maximum(np.abs(rows @ found - near + middle), smallest)
        weights /= weights.mean()
    coefficients = found[1:].reshape(-1, basis.degree)
    return _chebyshev_sums(basis.plays, coefficients, found[0] + middle)


def _chebyshev_sums(x: FloatArray, coefficients: FloatArray, constant: float) -> FloatArray:
    """For each row of x (T, P), the constant plus sums of Chebyshev polynomials, degrees 1 to D.

    ``coefficients`` (P, D): of each column. Clenshaw, Math. Tables Aids Comput. 9, 1955.
    """
    total = np.full(x.shape[0], constant)
    for z, terms in zip(x.T, coefficients, strict=True):
        one = two = np.zeros(z.size)
        for term in terms[::-1]:
            one, two = term + 2.0 * z * one - two, one
        total += z * one - two
    return total


def least_error(matrix: FloatArray, y: FloatArray) -> float:
    """Root-mean-square error of the rough model fitted by least squares."""
    centre = y - y.mean()
    found = weighted(matrix, centre, np.ones(y.size))
    return float(np.sqrt(np.mean((matrix @ found - centre) ** 2)))


def weighted(rows: FloatArray, wanted: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the coefficients (Q,) of rows (N, Q) of least weighted squared error, with a ridge."""
    heavy = rows * weights[:, None]
    gram = rows.T @ heavy
    gram[np.diag_indices_from(gram)] += _RIDGE * np.trace(gram)
    return np.asarray(np.linalg.solve(gram, heavy.T @ wanted))
