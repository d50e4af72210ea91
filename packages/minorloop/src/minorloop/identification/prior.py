"""A Gaussian prior on the weights of a Preisach plane.

Before anything is measured, weights of neighbouring cells are correlated and decay with the
distance from the diagonal. How strongly they do is learnt from the measurements (`likelihood`). The
sum of all weights is about the range of the output, whatever the number of cells.

All quantities are scaled: inputs from 0 to 1 over the levels, outputs to a range of 1.

References
----------
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 4.2.1: the Matern
kernels.
"""

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.operators.plane import cell_areas, swing

LEVEL_VARIANCE = 4.0
"""Prior variance of offset and slope, in squared ranges of the output: twice the range."""


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
    """Independent over correlated variance of a weight: near 0 on smooth planes, above 1 where
    neighbouring weights are unrelated."""
    noise: float = 0.003
    """Standard deviation of a measured output."""


class PlanePrior:
    """Prior covariance of the unknowns of a plane, for any hyperparameters.

    Parameters
    ----------
    spec : PlaneSpec
        The unknowns, (n,): K packed weights, offset, slope.
    least : (K,) array, optional
        Least standard deviations of the irreversible weights, in ranges of the output.
    independent : (K,) array, optional
        Variances of the independent parts of the weights, over those of the nugget; 1 if not given.
    """

    def __init__(
        self,
        spec: PlaneSpec,
        least: FloatArray | None = None,
        independent: FloatArray | None = None,
    ) -> None:
        self.spec, self.least = spec, least
        self.independent = np.ones(spec.cells) if independent is None else independent
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

    def deviations(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray]:
        """(K,) standard deviations of the irreversible weights, and (L,) of the reversible ones."""
        bulk = self._unit * self._bulk(h)
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
        """Standard deviations of offset and slope, where fitted."""
        span = float(self.spec.levels[-1] - self.spec.levels[0])
        units = [1.0] * self.spec.offset + [1.0 / span] * self.spec.slope
        return np.asarray(np.sqrt(LEVEL_VARIANCE) * np.array(units))

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

        Parameters
        ----------
        h : Hyperparameters
            Where to differentiate.
        weight : (n, n) array
            Symmetric; of the covariance of the unknowns, in their unit.
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

    def _reversible_correlation(self, h: Hyperparameters) -> FloatArray:
        """(L, L) correlation of the reversible weights."""
        return matern(self.middle, self._none, h.along, 1.0)

    def _correlation(self, along: float, across: float) -> FloatArray:
        """Return the (K, K) Matern correlation, kept while other hyperparameters change."""
        if (along, across) not in self._correlations:
            if len(self._correlations) > 1:
                del self._correlations[next(iter(self._correlations))]
            self._correlations[along, across] = matern(self.along, self.across, along, across)
        return self._correlations[along, across]

    def _bulk(self, h: Hyperparameters) -> FloatArray:
        """(K,) standard deviations of the irreversible weights of bipolar relays."""
        decay = np.exp(-self.across / h.decay) * self.area
        return np.asarray(h.bulk * decay / decay.sum())


def matern(x: FloatArray, y: FloatArray, at_x: float, at_y: float) -> FloatArray:
    """(K, K) products of two Matern kernels of order 3/2 between points (K,).

    Parameters
    ----------
    x, y : (K,) arrays
        Coordinates of the points.
    at_x, at_y : float
        Correlation lengths.
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
