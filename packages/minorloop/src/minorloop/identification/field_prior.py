"""The prior on the plane through a field on a coarse mesh, so that its precision is sparse.

The covariance of `PlanePrior` is dense. Here the correlated part of a weight is interpolated from a
field on the vertices of a coarse mesh, which has the covariance of `PlanePrior` there. The variance
that interpolation loses is added to the independent part, so that the variance of each weight is
the same. Given the field, the weights are independent: the precision of weights and field together
is sparse but for the small block of the field.

References
----------
Lindgren, Rue and Lindstrom, An explicit link between Gaussian fields and Gaussian Markov random
fields, JRSS B 73, 2011: fields interpolated on a mesh. Snelson and Ghahramani, Sparse Gaussian
processes using pseudo-inputs, NIPS 18, 2006: the variance added.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification.design_matrix import corners
from minorloop.identification.prior import Hyperparameters, PlanePrior, matern

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MESH_BANDS = 20
"""Most bands of the mesh."""
_JITTER = 1e-6
"""Variance added to the field, so that its covariance has an inverse."""
_LEAST_DEVIATION = 1e-7
"""Least prior standard deviation of a weight, in ranges of the output."""


@dataclass(frozen=True, eq=False)
class FieldPrecision:
    """Precision of the unknowns (n,) of a plane and of the field (m,)."""

    own: FloatArray
    """Shape (n,). Diagonal of the unknowns, given the field."""
    factors: csr_array[Any]
    """(K, m) sparse array. Weights that the field gives."""
    field: FloatArray
    """Shape (m, m). Block of the field."""
    links: FloatArray
    """Shape (E,). Entries between field and Everett nodes, at the ``places`` of the `FieldPrior`
    without the block of the field."""
    logarithm: float
    """Logarithm of the determinant of the precision of unknowns and field."""

    def product(self, x: FloatArray) -> FloatArray:
        """(n,) product of the precision of the unknowns alone with ``x``."""
        cells = self.factors.shape[0]
        out = self.own * x
        out[:cells] = self.own[:cells] * self.apart(x)
        return out

    def apart(self, x: FloatArray) -> FloatArray:
        """(K,) weights of unknowns ``x`` less those of the field that is most likely with them."""
        from scipy.linalg import cho_solve

        cells = self.factors.shape[0]
        field = cho_solve(self._root, self.factors.T @ (self.own * x)[:cells])
        return np.asarray(x[:cells] - self.factors @ field)

    @cached_property
    def _root(self) -> tuple[FloatArray, bool]:
        from scipy.linalg import cho_factor

        return cho_factor(self.field, check_finite=False)


@dataclass(frozen=True, eq=False)
class _Field:
    """What depends on the correlation lengths alone.

    ``precision`` (m, m) of the field, the logarithm of its determinant, and the variances ``kept``
    by the interpolation to each link of a cell.
    """

    lengths: tuple[float, float]
    precision: FloatArray
    logarithm: float
    bulk_kept: FloatArray
    reversible_kept: FloatArray


class FieldPrior:
    """Prior of the unknowns of a plane through a field, for any hyperparameters.

    The field (m,) has a value at each vertex of the mesh, for the irreversible weights, and one at
    each of its thresholds, for the reversible ones. ``places`` (2, E) are rows and columns of the
    entries of the precision that concern the field: Everett nodes are numbered from 0, values of
    the field from K.

    Parameters
    ----------
    plane : PlanePrior
        The prior that this one approximates.
    bands : int
        Most bands of the mesh.
    """

    def __init__(self, plane: PlanePrior, bands: int = MESH_BANDS) -> None:
        self.plane = plane
        cells, grid = plane.spec.cells, plane.grid
        ends = np.linspace(0, grid.size - 1, min(bands, grid.size - 1) + 1)
        mesh = np.interp(ends, np.arange(grid.size), grid)
        first, second = np.tril_indices(mesh.size)
        self.thresholds = mesh
        self.along, self.across = (mesh[first] + mesh[second]) / 2, mesh[first] - mesh[second]
        self.unknowns = first.size + mesh.size
        half = plane.across / 2
        self._vertex, self._share = _in_triangle(mesh, plane.along + half, plane.along - half)
        self._threshold, self._part = _in_interval(mesh, plane.middle)
        self._cell = np.append(np.repeat(np.arange(cells), 4), np.repeat(plane.diagonal, 2))
        self._value = np.append(self._vertex, first.size + self._threshold)
        linked = []
        for node, sign, there in corners(plane.spec.bands):
            link = np.flatnonzero(there[self._cell])
            linked.append((link, node[self._cell[link]], np.full(link.size, sign)))
        self._link, node, self._sign = (np.concatenate(part) for part in zip(*linked, strict=True))
        self.link_cells: IntArray = self._cell[self._link]
        block = np.tril_indices(self.unknowns)
        rows = np.append(self._value[self._link], block[0])
        self.places: IntArray = np.vstack([cells + rows, np.append(node, cells + block[1])])
        self._field: _Field | None = None

    def on(self, plane: PlanePrior) -> FieldPrior:
        """Return the prior of the same unknowns with another covariance."""
        other = copy(self)
        other.plane = plane
        return other

    def precision(self, h: Hyperparameters, variance: float) -> FieldPrecision:
        """Precision for these hyperparameters, times the variance of a measured output."""
        from scipy.sparse import csr_array

        plane, field = self.plane, self._at(h)
        bulk, reversible = plane.deviations(h)
        loose = plane.nugget_variances(h) + bulk**2 * (1.0 - field.bulk_kept)
        loose[plane.diagonal] += reversible**2 * (1.0 - field.reversible_kept)
        given = variance / np.maximum(loose, _LEAST_DEVIATION**2)
        shares = bulk[:, None] * self._share, reversible[:, None] * self._part
        factor = np.append(*shares)
        shape = plane.spec.cells, self.unknowns
        factors = csr_array((factor, (self._cell, self._value)), shape=shape)
        own = np.append(given, variance / plane.level_deviations**2)
        block = csr_array(factors.T @ factors.multiply(given[:, None]))
        return FieldPrecision(
            own,
            factors,
            variance * field.precision + block.toarray(),
            -(factor * given[self._cell])[self._link] * self._sign,
            float(np.log(own).sum()) + self.unknowns * float(np.log(variance)) + field.logarithm,
        )

    def _at(self, h: Hyperparameters) -> _Field:
        """Return the field for the correlation lengths, kept while others change."""
        lengths = h.along, h.across
        if self._field is None or self._field.lengths != lengths:
            vertices = self.along.size
            bulk = matern(self.along, self.across, *lengths)
            reversible = matern(self.thresholds, np.zeros_like(self.thresholds), h.along, 1.0)
            covariance = np.zeros((self.unknowns, self.unknowns))
            covariance[:vertices, :vertices] = bulk + 1.0
            covariance[vertices:, vertices:] = reversible + 1.0
            covariance[np.diag_indices(self.unknowns)] += _JITTER
            self._field = _Field(
                lengths,
                np.linalg.inv(covariance),
                -float(np.linalg.slogdet(covariance)[1]),
                _kept(bulk, self._vertex, self._share),
                _kept(reversible, self._threshold, self._part),
            )
        return self._field


def _kept(covariance: FloatArray, place: IntArray, share: FloatArray) -> FloatArray:
    """(P,) variances of values interpolated from places (P, k) with these shares."""
    around = covariance[place[:, :, None], place[:, None, :]]
    return np.asarray(np.einsum("pa,pab,pb->p", share, around, share))


def _in_interval(mesh: FloatArray, x: FloatArray) -> tuple[IntArray, FloatArray]:
    """(P, 2) ends of the interval of the mesh (m,) around each point, and their shares."""
    lower = np.clip(np.searchsorted(mesh, x, side="right") - 1, 0, mesh.size - 2)
    part = (x - mesh[lower]) / (mesh[lower + 1] - mesh[lower])
    return np.column_stack([lower, lower + 1]), np.column_stack([1 - part, part])


def _in_triangle(
    mesh: FloatArray, alpha: FloatArray, beta: FloatArray
) -> tuple[IntArray, FloatArray]:
    """(P, 4) vertices around each point of the plane, and their shares.

    Interpolation is bilinear in a square of the mesh, and linear in a triangle of its diagonal.
    """
    (a, p), (b, q) = (_in_interval(mesh, x) for x in (alpha, beta))
    up, right = p[:, 1], q[:, 1]
    square = a[:, 0] > b[:, 0]
    shares = np.column_stack([
        np.where(square, (1 - up) * (1 - right), 1 - up),
        np.where(square, up * (1 - right), up - right),
        np.where(square, (1 - up) * right, 0.0),
        np.where(square, up * right, right),
    ])  # fmt: skip
    i, j = a[:, [0, 1, 0, 1]], b[:, [0, 0, 1, 1]]
    j = np.minimum(i, j)
    return i * (i + 1) // 2 + j, shares
