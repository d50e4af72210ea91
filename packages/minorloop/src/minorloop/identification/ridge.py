"""Ridges: parametric densities on a Preisach plane, and their fit to a record.

A ridge is a density with one maximum, at a coercive field, plus reversible weight along the
diagonal. It has five parameters of shape, and describes a plane even if a record, such as one major
loop, does not determine each cell.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

import numpy as np

from minorloop.arrays import FloatArray, Levels
from minorloop.errors import SignalError
from minorloop.identification.baseline import nrmse
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec, pack
from minorloop.operators.densities import (
    FactoredGaussianDensity,
    FactoredLorentzianDensity,
    GaussianDensity,
    LorentzianDensity,
)
from minorloop.operators.plane import Density

Kind: TypeAlias = Literal["gaussian", "lorentzian", "factored gaussian", "factored lorentzian"]
KINDS: tuple[Kind, ...] = get_args(Kind)
_PLACES = np.array([-0.5, 0.5]) / np.sqrt(3.0)
"""Points of the quadrature in each direction, from the middle of a cell: exact for cubics."""
PARAMETERS = 7
"""Most numbers in a fit of a ridge: five of its shape, and two sums of weights."""
_START = (0.2, 0.2, 0.2, 0.0, 0.3)
_LEAST, _GREATEST = (1e-3, 0.02, 0.02, -0.5, 0.02), (2.0, 5.0, 5.0, 0.5, 5.0)
"""Start and bounds of coercive field, spreads, centre and reversible width, over half the range of
the levels."""
_POSITIVE = np.array([True, True, True, False, True])
"""Whether the search uses the logarithm of each of these."""
_EVALUATIONS = 100
FEWEST_FOR_RIDGE = 8
"""Least samples to fit a ridge."""
_PRODUCTS: dict[str, Callable[..., Density]] = {
    "gaussian": GaussianDensity,
    "lorentzian": LorentzianDensity,
}
_FACTORED: dict[str, Callable[..., Density]] = {
    "factored gaussian": FactoredGaussianDensity,
    "factored lorentzian": FactoredLorentzianDensity,
}


@dataclass(frozen=True)
class Ridge:
    """Shape of a density with one maximum, and of reversible weight on the diagonal.

    References
    ----------
    Bertotti, Hysteresis in Magnetism, 1998, chapter 13; Azzerboni, Cardelli, Finocchio and La
    Foresta, IEEE Trans. Magn. 39 (2003) 3028.
    """

    kind: Kind
    """One of "gaussian", "lorentzian", "factored gaussian", "factored lorentzian": density of
    `minorloop.operators.densities`."""
    coercive: float
    """Half-width of the typical relay, in the unit of the input."""
    spread_width: float
    spread_mean: float
    """``spread_width`` and ``spread_mean``: spreads of the half-width of the thresholds, and of
    their mean. A factored density has one spread of both thresholds, the first."""
    centre: float
    """Mean threshold of the typical relay, and centre of the reversible weight."""
    reversible_width: float
    """Half-width at half-maximum of the reversible weight, a Lorentzian along the diagonal."""

    def irreversible(self, levels: Levels) -> FloatArray:
        """Return the (L, L) weights of the density, with a sum of one."""
        heights = np.diff(levels)
        points = ((levels[:-1] + levels[1:])[:, None] / 2 + heights[:, None] * _PLACES).ravel()
        length = np.repeat(heights / 2, 2)
        density = np.asarray(self._density(points[:, None], points[None, :]))
        values = density.astype(np.float64) * np.outer(length, length)
        rows = values[::2] + values[1::2]
        weights = rows[:, ::2] + rows[:, 1::2]
        total = float(weights.sum())
        return np.asarray(weights / (total or 1.0))

    def reversible(self, levels: Levels) -> FloatArray:
        """Return the (L,) weights along the diagonal, with a sum of one."""
        weights = np.diff(np.arctan((levels - self.centre) / self.reversible_width))
        return np.asarray(weights / weights.sum())

    @property
    def _density(self) -> Density:
        if self.kind in _FACTORED:
            return _FACTORED[self.kind](self.coercive, self.spread_width, centre=self.centre)
        spreads = self.spread_mean, self.spread_width
        return _PRODUCTS[self.kind](self.coercive, *spreads, centre=self.centre)


@dataclass(frozen=True, eq=False)
class _RidgeFit:
    """A ridge fitted to a record."""

    ridge: Ridge
    """Shape of the ridge."""
    x: FloatArray
    """Shape (n,). Unknowns of the plane: packed weights, offset, slope."""
    nrmse: float
    """Root-mean-square error on the fitted samples, over their range."""


def fit_ridge(matrix: DesignMatrix, y: FloatArray, kinds: tuple[Kind, ...] = KINDS) -> _RidgeFit:
    """Fit a ridge to outputs by least squares.

    A search finds the shape; for each shape, least squares gives the sums of the irreversible and
    the reversible weights, the offset and the slope.

    Raises a `SignalError` if there are fewer than eight samples.

    ``matrix``: regressors of M samples; ``y`` (M,): outputs; ``kinds``: kinds of ridges to compare;
    the ridge with the least error is returned.

    References
    ----------
    Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413: separable least squares.
    """
    if y.size < FEWEST_FOR_RIDGE:
        raise SignalError(
            f"{y.size} samples are too few for a ridge; give {FEWEST_FOR_RIDGE} or more"
        )
    return min((_fit_kind(matrix, y, kind) for kind in kinds), key=lambda fit: fit.nrmse)


def _fit_kind(matrix: DesignMatrix, y: FloatArray, kind: Kind) -> _RidgeFit:
    from scipy.optimize import least_squares

    weight = np.ones(y.size) if matrix.counts is None else np.sqrt(matrix.counts)
    unit = float(np.ptp(y)) or 1.0

    def columns(theta: FloatArray) -> FloatArray:
        return _columns(matrix.spec, _shape(matrix.spec, kind, theta))

    def error(theta: FloatArray) -> FloatArray:
        return _error(matrix, y, weight, columns(theta))[1] / unit

    bounds = _searched(_LEAST), _searched(_GREATEST)
    found = least_squares(error, _searched(_START), bounds=bounds, max_nfev=_EVALUATIONS)
    best = columns(found.x)
    x = best @ _error(matrix, y, weight, best)[0]
    ridge = _shape(matrix.spec, kind, found.x)
    return _RidgeFit(ridge, x, nrmse(matrix.forward(x) - y, y))


def _searched(values: tuple[float, ...]) -> FloatArray:
    """Return shape parameters for the search, over half the range of the levels."""
    given = np.array(values)
    given[_POSITIVE] = np.log(given[_POSITIVE])
    return given


def _shape(spec: PlaneSpec, kind: Kind, theta: FloatArray) -> Ridge:
    """Return the ridge from parameters of the search."""
    low, high = float(spec.levels[0]), float(spec.levels[-1])
    shares = theta.copy()
    shares[_POSITIVE] = np.exp(theta[_POSITIVE])
    coercive, width, mean, centre, reversible = map(float, shares * (high - low) / 2)
    return Ridge(kind, coercive, width, mean, centre + (low + high) / 2, reversible)


def _columns(spec: PlaneSpec, ridge: Ridge) -> FloatArray:
    """(n, k) unknowns of the two parts of a ridge of unit sum, and offset and slope of one."""
    columns = np.zeros((spec.unknowns, 2 + spec.unknowns - spec.cells))
    columns[: spec.cells, 0] = pack(ridge.irreversible(spec.levels))
    columns[: spec.cells, 1] = pack(np.diag(ridge.reversible(spec.levels)))
    columns[spec.cells :, 2:] = np.eye(spec.unknowns - spec.cells)
    return columns


def _error(
    matrix: DesignMatrix, y: FloatArray, weight: FloatArray, columns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least-squares sizes of the columns, the first two not negative, and weighted errors."""
    from scipy.optimize import lsq_linear

    seen = np.column_stack([matrix.forward(column) for column in columns.T]) * weight[:, None]
    least = np.full(columns.shape[1], -np.inf)
    least[:2] = 0.0
    scale = np.linalg.norm(seen, axis=0)
    scale[scale == 0] = 1.0
    sizes = lsq_linear(seen / scale, y * weight, bounds=(least, np.inf)).x / scale
    return sizes, seen @ sizes - y * weight
