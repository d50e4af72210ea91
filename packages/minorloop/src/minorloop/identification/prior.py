"""Priors of an identification: assumptions about a plane before the record.

Under the Gaussian prior, weights of neighbouring cells are correlated and decay with the distance
from the diagonal. The measurements determine how strongly (`likelihood`). The sum of all weights is
about the range of the output, for any number of cells. All quantities are scaled: inputs from 0 to
1 over the levels, outputs to a range of 1.

The covariance is dense. A field on the vertices of a coarse mesh makes the precision sparse. It has
the covariance of the correlated part there, and this part is interpolated from it. The variance
that interpolation loses is added to the independent part, so that the variance of each weight does
not change. Given the field, the weights are independent: the precision of weights and field
together is sparse except for the small block of the field.

References
----------
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 4.2.1: the Matern
kernels. Lindgren, Rue and Lindstrom, An explicit link between Gaussian fields and Gaussian Markov
random fields, JRSS B 73, 2011: fields interpolated on a mesh. Snelson and Ghahramani, Sparse
Gaussian processes using pseudo-inputs, NIPS 18, 2006: the variance added.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np

from minorloop.arrays import FloatArray, IntArray, check_option
from minorloop.errors import ParameterError
from minorloop.identification.design_matrix import PlaneSpec, corners
from minorloop.operators.plane import cell_areas, swing

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Mean: TypeAlias = Literal["zero", "ridge"]

_MESH_BANDS = 20
"""Most bands of the mesh."""


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian prior, under which weights of neighbouring cells are correlated.

    Raises a `ParameterError` if there is no such mean.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200))
    >>> found = ml.identify(u, u, ml.Plane(4, lag=0), prior=ml.Gaussian())
    >>> found.predict([0.5], bands=0.9).sd.shape
    (1,)
    """

    mean: Mean = "zero"
    """Mean of the prior, about which the weights vary. ``"ridge"``: a parametric ridge fitted to
    the record, of the kind of greatest marginal likelihood, or zero if zero is more likely. A ridge
    helps if the record leaves much of the plane undetermined, such as one major loop."""

    def __post_init__(self) -> None:
        check_option("mean", self.mean, get_args(Mean))


@dataclass(frozen=True)
class Smooth:
    """A penalty on differences between neighbouring cells.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200))
    >>> ml.identify(u, u, ml.Plane(4, lag=0), prior=ml.Smooth(1e-5)).smoothness
    1e-05
    """

    strength: float | Literal["auto"] = "auto"
    """Strength of the penalty as in `minorloop.identification.least_squares`; 0.0 for none.
    ``"auto"`` chooses by prediction of contiguous held-out segments of the fitted samples."""


Prior: TypeAlias = Literal["auto"] | Gaussian | Smooth
"""``"auto"``: `Gaussian`, except in four cases: the output jumps; the samples determine a plane
that reproduces them to rounding; there are more than 300 bands; or the input reverses so often that
a plane of more than 64 levels would need large dense matrices. With such an input and 51 to 64
levels, it is `Gaussian` only if there are fewer than three samples per unknown or more than a tenth
of the cells is not excited."""


def prior_of(
    prior: str = "auto", smoothness: float | Literal["auto"] = "auto", mean: Mean = "zero"
) -> Prior:
    """Return the prior for options of front ends: "auto", "gaussian" or "none", and a mean.

    ``smoothness`` is the strength of `Smooth`. Raises a `ParameterError` if there is no prior of
    this name, or options contradict each other.
    """
    check_option("prior", prior, ("auto", "gaussian", "none"))
    plain = prior == "none" or smoothness != "auto"
    if mean != "zero" and plain:
        other = 'prior "none"' if prior == "none" else f"smoothness {smoothness!r}"
        raise ParameterError(
            f"mean is {mean!r}, the mean of a prior, and cannot be combined with {other}; "
            "omit one of them"
        )
    if prior == "gaussian" and smoothness != "auto":
        raise ParameterError(
            f'smoothness is {smoothness!r} and prior is "gaussian"; give one of them'
        )
    if plain:
        return Smooth(smoothness)
    return Gaussian(mean) if prior == "gaussian" or mean != "zero" else "auto"


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of the prior, in ranges of input and output."""

    decay: float = 0.3
    """Distance alpha - beta over which weights decay by a factor of e."""
    along: float = 0.3
    across: float = 0.4
    """``along`` and ``across``: correlation lengths in (alpha + beta) / 2 and in alpha - beta."""
    bulk: float = 0.15
    """Standard deviation of the sum of the irreversible weights."""
    reversible: float = 0.3
    """Standard deviation of the sum of the reversible weights."""
    discrepancy: float = 0.006
    """Standard deviation of the model discrepancy, which no weights can reproduce."""
    nugget: float = 0.3
    """Ratio of independent to correlated variance of a weight: near 0 on smooth planes, above 1 if
    neighbouring weights are unrelated."""
    noise: float = 0.003
    """Standard deviation of a measured output."""

    @property
    def variance(self) -> float:
        """Variance of a measured output if the discrepancy is independent."""
        return self.noise**2 + self.discrepancy**2


class PlanePrior:
    """Prior of the unknowns (n,) of a plane, for any hyperparameters: K packed weights, and levels.

    ``least`` (K,) are the least standard deviations of the irreversible weights, in ranges of the
    output, or None. ``independent`` (K,) are the variances of the independent parts of the weights,
    over those of the nugget. The ``mesh`` has at most ``bands`` bands.
    """

    def __init__(self, spec: PlaneSpec, bands: int = _MESH_BANDS) -> None:
        self.spec, self._bands = spec, bands
        self.least: FloatArray | None = None
        self.independent = np.ones(spec.cells)
        self.grid = (spec.levels - spec.levels[0]) / (spec.levels[-1] - spec.levels[0])
        middle, width = (self.grid[1:] + self.grid[:-1]) / 2, np.diff(self.grid)
        i, j = np.tril_indices(spec.bands)
        self.diagonal = np.flatnonzero(i == j)
        self.along = (middle[i] + middle[j]) / 2
        # The centre of a triangle is a third of its width from the diagonal.
        self.across = np.where(i == j, width[i] / 3, middle[i] - middle[j])
        self.middle, self._width = middle, width
        self.area = cell_areas(self.grid)[i, j]
        self._unit = 2.0 / swing(spec.relay)
        self._none = np.zeros(spec.bands)
        self._correlations: dict[tuple[float, float], FloatArray] = {}

    def varied(
        self, least: FloatArray | None = None, independent: FloatArray | None = None
    ) -> PlanePrior:
        """Return the prior with other least deviations, or variances of the independent parts."""
        other = copy(self)
        other.least = least
        other.independent = self.independent if independent is None else independent
        return other

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh of the field."""
        return Mesh(self, self._bands)

    def deviations(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray]:
        """(K,) standard deviations of the irreversible, and (L,) of the reversible weights."""
        decay = np.exp(-self.across / h.decay) * self.area
        bulk = np.asarray(self._unit * np.asarray(h.bulk * decay / decay.sum()))
        if self.least is not None:
            bulk = np.maximum(bulk, self.least)
        return bulk, self._unit * h.reversible * self._width

    def nugget_variances(self, h: Hyperparameters) -> FloatArray:
        """(K,) variances of the independent parts of the weights."""
        bulk, reversible = self.deviations(h)
        squares = bulk**2
        squares[self.diagonal] += reversible**2
        return h.nugget * self.independent * squares

    @property
    def level_deviations(self) -> FloatArray:
        """Standard deviations of offset and slope, if fitted."""
        span = float(self.spec.levels[-1] - self.spec.levels[0])
        units = [1.0] * self.spec.offset + [1.0 / span] * self.spec.slope
        # Prior variance of offset and slope, in squared ranges of the output: twice the range
        return np.asarray(np.sqrt(4.0) * np.array(units))

    def scale(self, h: Hyperparameters) -> FloatArray:
        """(n,) approximate prior standard deviations of the unknowns; all positive."""
        bulk, reversible = self.deviations(h)
        bulk[self.diagonal] = np.hypot(bulk[self.diagonal], reversible)
        return np.concatenate([bulk, self.level_deviations])

    def covariance(self, h: Hyperparameters) -> FloatArray:
        """(n, n) covariance of the unknowns over the products of their scales."""
        cells, n = self.spec.cells, self.spec.unknowns
        scale = self.scale(h)
        bulk, reversible = self.deviations(h)
        covariance = np.zeros((n, n))
        correlation = self._correlation(h.along, h.across)
        size = bulk / scale[:cells]
        covariance[:cells, :cells] = size[:, None] * (correlation + 1.0) * size
        nugget, each = h.nugget * self.independent, np.arange(n)
        covariance[each[:cells], each[:cells]] += size * nugget * size
        correlation, size = self._reversible_correlation(h), reversible / scale[self.diagonal]
        both = np.ix_(self.diagonal, self.diagonal)
        covariance[both] += size[:, None] * (correlation + 1.0) * size
        covariance[self.diagonal, self.diagonal] += size * nugget[self.diagonal] * size
        covariance[each[cells:], each[cells:]] = 1.0
        return covariance

    def slopes(self, h: Hyperparameters, weight: FloatArray) -> FloatArray:
        """(7,) derivatives of the sum of weighted covariances by the logs of the hyperparameters.

        ``weight`` (n, n) is symmetric, of the covariance of the unknowns in their unit.
        """
        cells = self.spec.cells
        bulk, reversible = self.deviations(h)
        weighted = bulk[:, None] * weight[:cells, :cells] * bulk
        correlation = self._correlation(h.along, h.across)
        loose = h.nugget * self.independent * weighted.diagonal()
        nugget = float(loose.sum())
        each = np.sum(weighted * (correlation + 1.0), axis=1) + loose
        both = weighted * correlation
        along = _length_slope(self.along, h.along, both)
        across = _length_slope(self.across, h.across, both)
        decay = np.exp(-self.across / h.decay) * self.area
        distance = self.across / h.decay
        by_decay = 2 * float(each @ (distance - distance @ decay / decay.sum()))
        weighted = reversible[:, None] * weight[np.ix_(self.diagonal, self.diagonal)] * reversible
        correlation = self._reversible_correlation(h)
        along += _length_slope(self.middle, h.along, weighted * correlation)
        own = float(h.nugget * self.independent[self.diagonal] @ weighted.diagonal())
        by_reversible = 2 * (float(np.sum(weighted * (correlation + 1.0))) + own)
        by_bulk = 2 * float(each.sum())
        return np.array([by_decay, along, across, by_bulk, by_reversible, 0.0, nugget + own])

    def precision(self, h: Hyperparameters, variance: float) -> FieldPrecision:
        """Precision of unknowns and field, times the variance of a measured output."""
        from scipy.sparse import csr_array

        mesh, field = self.mesh, self.mesh.field(h)
        bulk, reversible = self.deviations(h)
        loose = self.nugget_variances(h) + bulk**2 * (1.0 - field.bulk_kept)
        loose[self.diagonal] += reversible**2 * (1.0 - field.reversible_kept)
        # Least prior standard deviation of a weight, in ranges of the output: below it, rounding
        # makes pivots of the sparse factor useless
        given = variance / np.maximum(loose, 1e-6**2)
        factor = np.append(bulk[:, None] * mesh.share, reversible[:, None] * mesh.part)
        shape = self.spec.cells, mesh.unknowns
        factors = csr_array((factor, (mesh.cell, mesh.value)), shape=shape)
        own = np.append(given, variance / self.level_deviations**2)
        block = csr_array(factors.T @ factors.multiply(given[:, None]))
        return FieldPrecision(
            own,
            factors,
            variance * field.precision + block.toarray(),
            -(factor * given[mesh.cell])[mesh.link] * mesh.sign,
            float(np.log(own).sum()) + mesh.unknowns * float(np.log(variance)) + field.logarithm,
        )

    def _reversible_correlation(self, h: Hyperparameters) -> FloatArray:
        """(L, L) correlation of the reversible weights."""
        return _matern(self.middle, self._none, h.along, 1.0)

    def _correlation(self, along: float, across: float) -> FloatArray:
        """Return the (K, K) Matern correlation, cached for other hyperparameters."""
        if (along, across) not in self._correlations:
            if len(self._correlations) > 1:
                del self._correlations[next(iter(self._correlations))]
            self._correlations[along, across] = _matern(self.along, self.across, along, across)
        return self._correlations[along, across]


def _matern(x: FloatArray, y: FloatArray, at_x: float, at_y: float) -> FloatArray:
    """(K, K) products of two Matern kernels of order 3/2 between points of coordinates x, y (K,).

    ``at_x`` and ``at_y`` are the correlation lengths.
    """
    a, b = _distances(x, at_x), _distances(y, at_y)
    out = (1.0 + a) * (1.0 + b)
    a += b
    out *= np.exp(np.negative(a, out=a), out=a)
    return out


def _distances(x: FloatArray, length: float) -> FloatArray:
    """(K, K) distances between coordinates (K,), over the length of a Matern kernel."""
    return np.asarray(np.sqrt(3.0) * np.abs(x[:, None] - x) / length)


def _length_slope(x: FloatArray, length: float, weighted: FloatArray) -> float:
    """Derivative of a sum of weighted kernels (K, K) with respect to the logarithm of a length."""
    distances = _distances(x, length)
    return float(np.sum(weighted * distances**2 / (1.0 + distances)))


@dataclass(frozen=True, eq=False)
class FieldPrecision:
    """Precision of the unknowns (n,) of a plane and of the field (m,)."""

    own: FloatArray
    """Shape (n,). Diagonal of the unknowns, given the field."""
    factors: csr_array[Any]
    """(K, m) sparse array. Weights as functions of the field."""
    field: FloatArray
    """Shape (m, m). Block of the field."""
    links: FloatArray
    """Shape (E,). Entries between field and Everett nodes, at the ``places`` of the `Mesh` without
    the block of the field."""
    logarithm: float
    """Logarithm of the determinant of the precision of unknowns and field."""

    def product(self, x: FloatArray) -> FloatArray:
        """(n,) product of the precision of the unknowns alone with ``x``."""
        cells = self.factors.shape[0]
        out = self.own * x
        out[:cells] = self.own[:cells] * self.apart(x)
        return out

    def apart(self, x: FloatArray) -> FloatArray:
        """(K,) weights of unknowns ``x`` minus those of the most likely field for them."""
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
    """The part of the prior that depends only on the correlation lengths.

    ``precision`` (m, m) of the field, the logarithm of its determinant, and the variances that the
    interpolation to each cell keeps.
    """

    lengths: tuple[float, float]
    precision: FloatArray
    logarithm: float
    bulk_kept: FloatArray
    reversible_kept: FloatArray


class Mesh:
    """Coarse mesh over a plane, on which the field (m,) has its values.

    The field has a value at each vertex, for the irreversible weights, and at each threshold of the
    mesh, for the reversible weights. ``places`` (2, E) are rows and columns of the entries of the
    precision that contain the field: Everett nodes are numbered from 0, values of the field from K.
    ``link_cells`` are the cells of the entries between nodes and field.
    """

    def __init__(self, plane: PlanePrior, bands: int) -> None:
        cells, grid = plane.spec.cells, plane.grid
        ends = np.linspace(0, grid.size - 1, min(bands, grid.size - 1) + 1)
        mesh = np.interp(ends, np.arange(grid.size), grid)
        first, second = np.tril_indices(mesh.size)
        self.thresholds = mesh
        self.along, self.across = (mesh[first] + mesh[second]) / 2, mesh[first] - mesh[second]
        self.unknowns = first.size + mesh.size
        half = plane.across / 2
        self._vertex, self.share = _in_triangle(mesh, plane.along + half, plane.along - half)
        self._threshold, self.part = _in_interval(mesh, plane.middle)
        self.cell = np.append(np.repeat(np.arange(cells), 4), np.repeat(plane.diagonal, 2))
        self.value = np.append(self._vertex, first.size + self._threshold)
        linked = []
        for node, sign, there in corners(plane.spec.bands):
            link = np.flatnonzero(there[self.cell])
            linked.append((link, node[self.cell[link]], np.full(link.size, sign)))
        self.link, node, self.sign = (np.concatenate(part) for part in zip(*linked, strict=True))
        self.link_cells: IntArray = self.cell[self.link]
        block = np.tril_indices(self.unknowns)
        rows = np.append(self.value[self.link], block[0])
        self.places: IntArray = np.vstack([cells + rows, np.append(node, cells + block[1])])
        self._field: _Field | None = None

    def field(self, h: Hyperparameters) -> _Field:
        """Return the field for the correlation lengths, cached for other hyperparameters."""
        lengths = h.along, h.across
        if self._field is None or self._field.lengths != lengths:
            vertices = self.along.size
            bulk = _matern(self.along, self.across, *lengths)
            reversible = _matern(self.thresholds, np.zeros_like(self.thresholds), h.along, 1.0)
            covariance = np.zeros((self.unknowns, self.unknowns))
            covariance[:vertices, :vertices] = bulk + 1.0
            covariance[vertices:, vertices:] = reversible + 1.0
            # Variance added to the field, so that its covariance has an inverse
            covariance[np.diag_indices(self.unknowns)] += 1e-6
            self._field = _Field(
                lengths,
                np.linalg.inv(covariance),
                -float(np.linalg.slogdet(covariance)[1]),
                _kept(bulk, self._vertex, self.share),
                _kept(reversible, self._threshold, self.part),
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
