"""Posterior distribution of the unknowns of a plane, and of its outputs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem
from minorloop.identification.likelihood import LEARNT, cholesky, regressors
from minorloop.identification.prior import Hyperparameters
from minorloop.operators.memory import Start

_PROBES = 400
"""Random inputs on which a coarse plane is compared with the plane."""
_TOGETHER = 8192
"""Outputs whose dense regressors are in memory at once."""


@dataclass(frozen=True, eq=False)
class Posterior(ABC):
    """Posterior distribution of the unknowns given the measurements, in the unit of the output."""

    spec: PlaneSpec
    """The unknowns, (n,): packed weights, offset, slope."""
    hyperparameters: Hyperparameters
    """Hyperparameters of the prior, in ranges."""
    unit: float
    """Range of the measured outputs."""
    samples: int
    """Measurements that the hyperparameters were learnt from. Variances are multiplied by samples /
    (samples - 7), at most by 2, because seven hyperparameters were learnt."""
    determined: float
    """Trace of the hat matrix without sign constraints: number of unknowns that they determined."""
    centre: FloatArray | None = field(default=None, kw_only=True)
    """Shape (n,). Mean of the prior; zero if None."""
    apart: FloatArray | None = field(default=None, kw_only=True)
    """Shape (n,). Estimate less the one that the covariance is of; the square of its output is
    added to variances. None if they are the same."""

    @property
    @abstractmethod
    def factor(self) -> FloatArray:
        """F (n, n), where F F' is the covariance of the unknowns, without sign constraints."""

    @abstractmethod
    def variances(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """(M,) variances of outputs from the uncertainty of the unknowns alone."""

    @abstractmethod
    def _root(self, into: IntArray, unknowns: int) -> FloatArray:
        """F (k, m), where F F' is the covariance of sums of the unknowns; ``into`` as `sums`."""

    def coarse(self, bands: int) -> DensePosterior:
        """Return the distribution of the unknowns of a plane of at most so many bands.

        Its factor is lower triangular. The density counts as constant in each of the larger cells;
        a factor makes up for what varies within them, so that outputs for random inputs have the
        same variance on average.
        """
        spec = self.spec.coarse(bands)
        into = self.spec.sums(spec)
        root = self._root(into, spec.unknowns)
        if self.apart is not None:
            root = np.column_stack([root, np.bincount(into, self.apart, spec.unknowns)])
        root = np.asarray(np.linalg.qr(root.T, mode="r")).T
        square = np.zeros((spec.unknowns, spec.unknowns))
        square[:, : root.shape[1]] = root
        known = self.hyperparameters, self.unit, self.samples, self.determined
        found = DensePosterior(spec, *known, dense=square)
        low, high = map(float, spec.levels[[0, -1]])
        probe = np.random.default_rng(0).uniform(low, high, _PROBES)
        every = np.ones(_PROBES, dtype=np.bool_)
        mean, other = (one._known(probe, every, "negative").mean() for one in (self, found))
        return replace(found, dense=np.sqrt(mean / other) * square)

    def _known(self, u: FloatArray, wanted: BoolArray, start: Start) -> FloatArray:
        """(M,) variances of outputs from the uncertainty of the unknowns, and from `apart`."""
        known = self.variances(u, wanted, start)
        if self.apart is not None:
            known += DesignMatrix(self.spec, u, wanted, start).forward(self.apart) ** 2
        return known

    def deviation(
        self, u: FloatArray, start: Start, measured: BoolArray | None = None
    ) -> FloatArray:
        """Standard deviation of the true outputs for inputs (T,), or after some of them.

        It includes the uncertainty of the weights and the model discrepancy, but no sensor noise.
        """
        wanted = np.ones(u.size, dtype=np.bool_) if measured is None else measured
        return self._whole(self._known(u, wanted, start))

    def row_deviation(self, rows: FloatArray) -> FloatArray:
        """Standard deviation of the true outputs for regressors (T, n)."""
        known = np.einsum("tk,tk->t", *[rows @ self.factor] * 2)
        return self._whole(known if self.apart is None else known + (rows @ self.apart) ** 2)

    def _whole(self, variances: FloatArray) -> FloatArray:
        total = variances + (self.hyperparameters.discrepancy * self.unit) ** 2
        return np.sqrt(min(self.samples / max(self.samples - LEARNT, 1), 2.0) * total)


@dataclass(frozen=True, eq=False)
class DensePosterior(Posterior):
    """Posterior with a dense factor of the covariance."""

    dense: FloatArray

    @property
    def factor(self) -> FloatArray:
        """F (n, n), where F F' is the covariance of the unknowns, without sign constraints."""
        return self.dense

    def _root(self, into: IntArray, unknowns: int) -> FloatArray:
        """Sums of the rows of the factor."""
        root = np.zeros((unknowns, self.dense.shape[1]))
        np.add.at(root, into, self.dense)
        return root

    def variances(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """(M,) variances of outputs, from dense regressors."""
        places = np.flatnonzero(measured)
        out = np.empty(places.size)
        for begin in range(0, places.size, _TOGETHER):
            some = places[begin : begin + _TOGETHER]
            wanted = np.zeros(int(some[-1]) + 1, dtype=np.bool_)
            wanted[some] = True
            rows, _ = regressors(self.spec, u[: wanted.size], wanted, start)
            out[begin : begin + _TOGETHER] = np.einsum("tk,tk->t", *[rows @ self.dense] * 2)
        return out


@dataclass(frozen=True, eq=False)
class SparsePosterior(Posterior):
    """Posterior with a sparse factor of the precision."""

    system: EverettSystem
    """Factorised precision of the unknowns, times ``variance``."""
    variance: float
    """Variance of a measured output, in squared units."""

    @cached_property
    def factor(self) -> FloatArray:
        """F (n, n), where F F' is the covariance of the unknowns; for small planes only."""
        return cholesky(self.variance * self.system.inverse())

    def _root(self, into: IntArray, unknowns: int) -> FloatArray:
        """Root of the covariance of the sums, by its eigenvalues."""
        directions = (into == np.arange(unknowns)[:, None]).astype(np.float64)
        size, axes = np.linalg.eigh(self.variance * self.system.inverse(directions))
        return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))

    def variances(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """(M,) variances of outputs, from the sparse factor."""
        future = DesignMatrix(self.spec, u, measured, start)
        return self.variance * self.system.variances(future)
