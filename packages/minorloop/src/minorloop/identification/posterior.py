"""Posterior of the unknowns of a plane under the Gaussian prior, and of its outputs.

The normal equations are solved on dense matrices, or on the sparse system of `everett_system` if
that is quicker.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.errors import ParameterError
from minorloop.identification.active_set import solve_with_prior
from minorloop.identification.dense_solver import GramRows, Quadratic, solve
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem, quick_system
from minorloop.identification.likelihood import LEARNT, Evidence, ManyOutputs, regressors
from minorloop.identification.linear_algebra import (
    cholesky,
    cholesky_inverse,
    triangular_inverse,
    triangular_solve,
)
from minorloop.identification.prior import FieldPrecision, Hyperparameters, PlanePrior
from minorloop.operators.memory import Start

MOST_DENSE_CELLS = 2100
"""Cells up to which dense matrices are quick."""
_MOST_CHEAP_CELLS = 1300
"""Cells (50 bands) up to which a fit on dense matrices takes at most two seconds."""
_MOST_CELLS = 5050
"""Cells up to which dense matrices are used if the sparse system has too much fill."""
_LEAST_SPARSE = 300
"""Cells from which the sparse system is used."""
_FILL = 0.3
"""Multiplications of its factorisation, over the cube of the cells, up to which it is quicker."""
_PROBES = 400
"""Number of random inputs on which a coarse plane is compared with the plane."""
_TOGETHER = 8192
"""Number of outputs whose dense regressors are in memory at once."""


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
    """Measurements from which the hyperparameters were learnt. Variances are multiplied by samples
    / (samples - 7), at most by 2, because seven hyperparameters were learnt."""
    determined: float
    """Trace of the hat matrix without sign constraints: number of unknowns that they determine."""
    centre: FloatArray | None = field(default=None, kw_only=True)
    """Shape (n,). Mean of the prior; zero if None."""
    apart: FloatArray | None = field(default=None, kw_only=True)
    """Shape (n,). Estimate minus the estimate with this covariance; the square of its output is
    added to variances. None if both are the same."""

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
        """Return the distribution of the unknowns of a plane of at most ``bands`` bands.

        Its factor is lower triangular. The density counts as constant in each of the larger cells.
        A scale factor corrects for variations within them, so that outputs for random inputs have
        the same variance on average.
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

    def _known(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """(M,) variances of outputs from the uncertainty of the unknowns, and from `apart`."""
        known = self.variances(u, measured, start)
        if self.apart is not None:
            known += DesignMatrix(self.spec, u, measured, start).forward(self.apart) ** 2
        return known

    def deviation(
        self, u: FloatArray, start: Start, measured: BoolArray | None = None
    ) -> FloatArray:
        """Standard deviation of the true outputs after all inputs (T,), or after ``measured`` ones.

        It includes the uncertainty of the weights and the model discrepancy, but no sensor noise.
        """
        chosen = np.ones(u.size, dtype=np.bool_) if measured is None else measured
        return self._whole(self._known(u, chosen, start))

    def _whole(self, variances: FloatArray) -> FloatArray:
        total = variances + (self.hyperparameters.discrepancy * self.unit) ** 2
        return np.sqrt(min(self.samples / max(self.samples - LEARNT, 1), 2.0) * total)


@dataclass(frozen=True, eq=False)
class DensePosterior(Posterior):
    """Posterior with a dense factor of the covariance."""

    dense: FloatArray

    @property
    def factor(self) -> FloatArray:
        """As of `Posterior`."""
        return self.dense

    def _root(self, into: IntArray, unknowns: int) -> FloatArray:
        root = np.zeros((unknowns, self.dense.shape[1]))
        np.add.at(root, into, self.dense)
        return root

    def variances(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """As of `Posterior`, from dense regressors."""
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
        """As of `Posterior`; for small planes only."""
        return cholesky(self.variance * self.system.inverse())

    def _root(self, into: IntArray, unknowns: int) -> FloatArray:
        directions = (into == np.arange(unknowns)[:, None]).astype(np.float64)
        size, axes = np.linalg.eigh(self.variance * self.system.inverse(directions))
        return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))

    def variances(self, u: FloatArray, measured: BoolArray, start: Start) -> FloatArray:
        """As of `Posterior`, from the sparse factor."""
        future = DesignMatrix(self.spec, u, measured, start)
        return self.variance * self.system.variances(future)


@dataclass(frozen=True, eq=False)
class _SparseEvidence:
    """Scaled measurements (M,) minus the outputs of the mean of the prior, and their system."""

    system: EverettSystem
    y: FloatArray


@dataclass(frozen=True, eq=False)
class _IndependentPart:
    """Posterior of the independent parts of the weights."""

    squares: FloatArray
    """Shape (K,). Mean squares."""
    determined: FloatArray
    """Shape (K,). Share of its variance that the measurements remove."""
    likelihood: float
    """Logarithm of the marginal likelihood of the measurements, up to a constant."""

    @classmethod
    def of(
        cls,
        variances: FloatArray,
        given: FloatArray,
        mean: FloatArray,
        loose: FloatArray,
        likelihood: float,
    ) -> _IndependentPart:
        """Posterior from the prior variances of weights and their precisions ``given`` the field.

        ``mean`` (K,) and ``loose`` (K,) are the mean and the variance of the weights without the
        part that the field explains.
        """
        share = variances * given
        determined = np.clip(share * (1 - given * loose), 0.0, 1.0)
        squares = (share * mean) ** 2 + variances * (1 - determined)
        return cls(squares, determined, likelihood)


@dataclass(frozen=True, eq=False)
class PriorSystem(ABC):
    """Normal equations of the unknowns (n,), as deviations from the mean of the prior."""

    evidence: Any
    """Scaled measurements minus the outputs of the mean of the prior."""
    plane: PlanePrior
    """Prior."""
    h: Hyperparameters
    """Its hyperparameters."""
    signed: bool = True
    """Whether weights and slope may be negative."""
    centre: FloatArray | float = 0.0
    """Shape (n,), or 0. Mean of the prior."""

    @property
    @abstractmethod
    def mean(self) -> FloatArray:
        """(n,) posterior mean without sign constraints."""

    @property
    @abstractmethod
    def determined(self) -> float:
        """Number of unknowns that the samples determine."""

    @property
    @abstractmethod
    def likelihood(self) -> float:
        """Logarithm of the marginal likelihood, up to a constant."""

    @abstractmethod
    def bounded(self, guess: FloatArray | None = None) -> tuple[FloatArray, float]:
        """(n,) deviations for which the unknowns keep their signs, and their KKT violation."""

    @abstractmethod
    def variances(self, matrix: DesignMatrix) -> FloatArray:
        """(M,) variances of outputs, from the uncertainty of the unknowns alone."""

    @abstractmethod
    def independent_part(self) -> _IndependentPart:
        """Posterior of the independent parts of the weights, by the field."""

    @abstractmethod
    def posterior(self, unit: float, samples: int, determined: float) -> Posterior:
        """Posterior of outputs of range ``unit``."""


@dataclass(frozen=True, eq=False)
class DenseSystem(PriorSystem):
    """Normal equations on dense matrices."""

    evidence: Evidence

    @cached_property
    def _information(self) -> tuple[FloatArray, FloatArray, float, float]:
        return self.evidence.information(self.h)

    @cached_property
    def _normal(self) -> tuple[FloatArray, FloatArray, float]:
        """Scale of the unknowns, scaled matrix, and the logarithm of the determinant of R."""
        gram, logarithm = self._information[0], self._information[3]
        scale, root = self.plane.scale(self.h), cholesky(self.plane.covariance(self.h))
        quadratic = scale[:, None] * gram * scale
        quadratic += cholesky_inverse(root)
        unit = 1 / np.sqrt(quadratic.diagonal())
        logarithm += 2 * float(np.log(root.diagonal() / unit).sum())
        return scale * unit, unit[:, None] * quadratic * unit, logarithm

    @cached_property
    def _root(self) -> FloatArray:
        return cholesky(self._normal[1])

    @cached_property
    def mean(self) -> FloatArray:
        """As of `PriorSystem`."""
        scale = self._normal[0]
        half = triangular_solve(self._root, scale * self._information[1])
        return scale * triangular_solve(self._root, half, transposed=True)

    @property
    def determined(self) -> float:
        """As of `PriorSystem`."""
        scale = self._normal[0]
        scaled = scale[:, None] * self._information[0] * scale
        return float(np.sum(scaled * cholesky_inverse(self._root)))

    @property
    def likelihood(self) -> float:
        """As of `PriorSystem`."""
        _, slope, square, _ = self._information
        spent = self._normal[2] + 2 * float(np.log(self._root.diagonal()).sum())
        return -0.5 * (square - float(slope @ self.mean) + spent)

    @cached_property
    def factor(self) -> FloatArray:
        """F, where F F' is the covariance of the unknowns."""
        return self._normal[0][:, None] * triangular_inverse(self._root).T

    def bounded(self, guess: FloatArray | None = None) -> tuple[FloatArray, float]:
        """As of `PriorSystem`."""
        (_, slope, square, _), (scale, quadratic, _) = self._information, self._normal
        centre = self.centre / scale
        linear = scale * slope + quadratic @ centre
        solution = solve(
            Quadratic(GramRows.of(quadratic.copy()), linear),
            self.plane.spec.bounded(self.signed),
            float(np.sqrt(square)) or 1.0,
            guess=None if guess is None else guess / scale + centre,
        )
        return solution.z * scale - self.centre, solution.kkt

    def variances(self, matrix: DesignMatrix) -> FloatArray:
        """As of `PriorSystem`."""
        half = matrix.dense() @ self.factor
        return np.asarray(np.einsum("mn,mn->m", half, half))

    def independent_part(self) -> _IndependentPart:
        """As of `PriorSystem`, by the normal equations of unknowns and field.

        With r the independent part, V its variances and C the covariance of the outputs, its mean
        is V A' C^-1 y and its covariance V - V A' C^-1 A V.
        """
        gram, slope, square, spent = self._information
        precision, cells = self.plane.precision(self.h, 1.0), self.plane.spec.cells
        own, given = precision.own, precision.own[:cells]
        matrix = gram.copy()
        matrix[np.diag_indices(own.size)] += own
        root = cholesky(matrix)
        inverse = cholesky_inverse(root)
        factors = precision.factors.toarray()
        linked = inverse[:, :cells] @ (given[:, None] * factors)
        of_field = cholesky(precision.field - (given[:, None] * factors).T @ linked[:cells])
        half = triangular_solve(of_field, linked.T @ slope)
        values = triangular_solve(of_field, half, transposed=True)
        mean = inverse @ slope + linked @ values
        half = triangular_solve(of_field, (linked[:cells] - factors).T)
        loose = inverse.diagonal()[:cells] + np.einsum("mk,mk->k", half, half)
        logarithms = np.log(root.diagonal()).sum() + np.log(of_field.diagonal()).sum()
        spent += 2 * float(logarithms) - precision.logarithm
        apart = mean[:cells] - factors @ values  # A' C^-1 y would be lost to rounding
        likelihood = -0.5 * (square - float(slope @ mean) + spent)
        variances = self.plane.nugget_variances(self.h)
        return _IndependentPart.of(variances, given, apart, loose, likelihood)

    def posterior(self, unit: float, samples: int, determined: float) -> DensePosterior:
        """As of `PriorSystem`."""
        factor = self.factor * unit
        return DensePosterior(self.plane.spec, self.h, unit, samples, determined, factor)


@dataclass(frozen=True, eq=False)
class _SparseSystem(PriorSystem):
    """Normal equations as a sparse system, which other hyperparameters use too."""

    evidence: _SparseEvidence

    def _condition(self, variance: float) -> tuple[EverettSystem, FieldPrecision]:
        """Return the system with the prior for this variance of a measured output."""
        system, precision = self.evidence.system, self.plane.precision(self.h, variance)
        squares, _ = system.matrix.column_squares(system.weight)
        system.condition(1 / np.sqrt(squares + precision.own), precision)
        return system, precision

    def _factorise(self, variance: float) -> tuple[EverettSystem, FieldPrecision]:
        system = self.evidence.system
        if system.owner != (self, variance):
            self._condition(variance)[0].factorise(0.0, (self, variance))
        assert system.precision is not None
        return system, system.precision

    @cached_property
    def _mean_and_logarithm(self) -> tuple[FloatArray, float]:
        """Posterior mean, and the logarithm of the determinant over that of the prior."""
        system, precision = self._factorise(self.h.variance)
        begin = system.gradient(np.zeros(system.scale.size), self.evidence.y)
        # Relative residual of the posterior mean 1e-10, within 50 steps
        z = system.solve(-begin, True, 1e-10, 50)
        return system.scale * z, system.logarithm() - precision.logarithm

    @property
    def mean(self) -> FloatArray:
        """As of `PriorSystem`."""
        return self._mean_and_logarithm[0]

    @property
    def determined(self) -> float:
        """Negative derivative of the logarithm of the determinant ratio by that of the variance."""
        # Relative change of the variance for the derivative
        here, step = self._mean_and_logarithm[1], 1 + 0.02
        system, precision = self._factorise(self.h.variance * step)
        return (here - system.logarithm() + precision.logarithm) / float(np.log(step))

    @property
    def likelihood(self) -> float:
        """As of `PriorSystem`."""
        (mean, spent), v, y = self._mean_and_logarithm, self.h.variance, self.evidence.y
        weight, matrix = self.evidence.system.weight, self.evidence.system.matrix
        left = float(weight @ (y * (y - matrix.forward(mean))))
        return -0.5 * (left / v + spent + float(weight.sum() * np.log(v)))

    def bounded(self, guess: FloatArray | None = None) -> tuple[FloatArray, float]:
        """As of `PriorSystem`."""
        start = self.mean if guess is None else guess
        system, _ = self._condition(self.h.variance)
        size = float(np.linalg.norm(np.sqrt(system.weight) * self.evidence.y)) or 1.0
        bounded = self.plane.spec.bounded(self.signed)
        start = start + self.centre
        start = np.where(bounded, np.maximum(start, 0.0), start) / system.scale
        y = self.evidence.y
        found = solve_with_prior(system, y, bounded, start, size, self.centre)
        return system.scale * found.z - self.centre, found.kkt

    def variances(self, matrix: DesignMatrix) -> FloatArray:
        """As of `PriorSystem`."""
        return self.h.variance * self._factorise(self.h.variance)[0].variances(matrix)

    def independent_part(self) -> _IndependentPart:
        """As of `PriorSystem`."""
        mean, (system, precision) = self.mean, self._factorise(self.h.variance)
        loose = system.variances_apart(self.plane.mesh.link_cells)
        given = precision.own[: self.plane.spec.cells]
        variances, v = self.plane.nugget_variances(self.h), self.h.variance
        apart = precision.apart(mean)
        return _IndependentPart.of(variances, given / v, apart, loose * v, self.likelihood)

    def posterior(self, unit: float, samples: int, determined: float) -> SparsePosterior:
        """As of `PriorSystem`."""
        system, _ = self._factorise(self.h.variance)
        known = self.plane.spec, self.h, unit, samples, determined
        return SparsePosterior(*known, system, self.h.variance * unit**2)


def system_of_many(
    matrix: DesignMatrix,
    y: FloatArray,
    weight: FloatArray,
    h: Hyperparameters,
    signed: bool,
    centre: FloatArray | float = 0.0,
) -> PriorSystem:
    """Normal equations of many samples, sparse if that is quicker.

    ``y`` (M,) are scaled outputs minus those of the mean of the prior, ``weight`` (M,) the number
    of samples that each replaces. Raises a `ParameterError` if the plane is too fine for dense
    matrices and the record does not suit sparse matrices.
    """
    plane, cells = PlanePrior(matrix.spec), matrix.spec.cells
    system = None
    if cells >= _LEAST_SPARSE:
        most, scale = _FILL * float(cells) ** 3, np.ones(matrix.spec.unknowns)
        system = quick_system(matrix, weight, scale, most, plane.mesh)
    if system is not None:
        return _SparseSystem(_SparseEvidence(system, y), plane, h, signed, centre)
    if cells > _MOST_CELLS:
        raise ParameterError(
            f"the input reverses {matrix.reversals} times and the plane has {matrix.spec.bands} "
            'bands: the matrices of the prior are too large; give at most 100 levels, or "auto" '
            "for smoothness instead"
        )
    return DenseSystem(ManyOutputs.of(matrix, y, weight), plane, h, signed, centre)


def is_cheap(matrix: DesignMatrix) -> bool:
    """Whether a fit with the prior takes little longer than smoothing."""
    return _is_small(matrix, _MOST_CHEAP_CELLS)


def is_quick(matrix: DesignMatrix) -> bool:
    """Whether a fit with the prior takes seconds."""
    return _is_small(matrix, MOST_DENSE_CELLS)


def _is_small(matrix: DesignMatrix, most: int) -> bool:
    """Whether there are few cells, or a sparse factorisation takes less than 0.1 s."""
    cells = matrix.spec.cells
    # Bands up to which a fit on the sparse system takes less than a minute
    if matrix.spec.bands > 300 or cells <= most:
        return cells <= most
    if cells < _LEAST_SPARSE:
        return False
    ones, scale = np.ones(matrix.samples), np.ones(matrix.spec.unknowns)
    # Multiplications of its factorisation up to which a fit takes seconds
    return quick_system(matrix, ones, scale, 1e9) is not None
