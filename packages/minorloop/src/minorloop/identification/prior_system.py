"""Normal equations of the unknowns of a plane with the prior, dense or sparse."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.errors import ParameterError
from minorloop.identification import active_set, interior_point
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem, quick_system
from minorloop.identification.field_prior import FieldPrior
from minorloop.identification.likelihood import (
    Evidence,
    cholesky,
    cholesky_inverse,
    triangular_inverse,
    triangular_solve,
)
from minorloop.identification.posterior import DensePosterior, Posterior, SparsePosterior
from minorloop.identification.prior import Hyperparameters, PlanePrior

MOST_DENSE_CELLS = 2100
"""Cells up to which dense matrices are quick."""
_MOST_CHEAP_CELLS = 1300
"""Cells, those of 50 bands, up to which a fit on dense matrices takes at most two seconds."""
_MOST_CELLS = 5050
"""Cells up to which they are used where the sparse system has too much fill."""
_MOST_QUICK = 300
"""Bands up to which a fit on the sparse system takes less than a minute."""
_LEAST_SPARSE = 300
"""Cells from which the sparse system is used."""
_MOST_OPERATIONS = 1e9
"""Multiplications of its factorisation up to which a fit takes seconds."""
_FILL = 0.3
"""Multiplications of its factorisation, over the cube of the cells, up to which it is quicker."""
_ACCURATE, _STEPS = 1e-10, 50
"""Relative residual of the posterior mean, and most steps to reach it."""
_STEP = 0.02
"""Relative change of a variance for a derivative."""


class PriorSystem(ABC):
    """Normal equations of the unknowns, as deviations from the mean of the prior."""

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
    def widened(self, least: FloatArray) -> Self:
        """System with least (K,) prior standard deviations of the irreversible weights."""

    @abstractmethod
    def posterior(self, unit: float, samples: int, determined: float) -> Posterior:
        """Posterior of outputs of range ``unit``."""


class _DenseSystem(PriorSystem):
    """Scaled normal equations in the unknowns."""

    def __init__(
        self,
        plane: PlanePrior,
        evidence: Evidence,
        h: Hyperparameters,
        signed: bool,
        centre: FloatArray,
    ) -> None:
        self._gram, self._slope, self._square, self._logarithm = evidence.information(h)
        self._plane, self._h, self._centre = plane, h, centre
        self._evidence, self._signed = evidence, signed
        scale, root = plane.scale(h), cholesky(plane.covariance(h))
        quadratic = scale[:, None] * self._gram * scale
        quadratic += cholesky_inverse(root)
        unit = 1 / np.sqrt(quadratic.diagonal())
        self._logarithm += 2 * float(np.log(root.diagonal() / unit).sum())
        self._scale, self._quadratic = scale * unit, unit[:, None] * quadratic * unit
        self._bounded = bounded_unknowns(plane.spec, signed)

    @cached_property
    def mean(self) -> FloatArray:
        half = triangular_solve(self._root, self._scale * self._slope)
        return self._scale * triangular_solve(self._root, half, transposed=True)

    @property
    def determined(self) -> float:
        scaled = self._scale[:, None] * self._gram * self._scale
        return float(np.sum(scaled * cholesky_inverse(self._root)))

    @property
    def likelihood(self) -> float:
        spent = self._logarithm + 2 * float(np.log(self._root.diagonal()).sum())
        return -0.5 * (self._square - float(self._slope @ self.mean) + spent)

    @cached_property
    def factor(self) -> FloatArray:
        """F, where F F' is the covariance of the unknowns."""
        return self._scale[:, None] * triangular_inverse(self._root).T

    @cached_property
    def _root(self) -> FloatArray:
        return cholesky(self._quadratic)

    def bounded(self, guess: FloatArray | None = None) -> tuple[FloatArray, float]:
        centre = self._centre / self._scale
        linear = self._scale * self._slope + self._quadratic @ centre
        solution = active_set.solve(
            np.tril(self._quadratic),
            lambda z: self._quadratic @ z - linear,
            lambda z: self._quadratic @ z,
            self._bounded,
            float(np.sqrt(self._square)) or 1.0,
            guess=None if guess is None else guess / self._scale + centre,
        )
        return solution.z * self._scale - self._centre, solution.kkt

    def variances(self, matrix: DesignMatrix) -> FloatArray:
        half = matrix.dense() @ self.factor
        return np.asarray(np.einsum("mn,mn->m", half, half))

    def widened(self, least: FloatArray) -> Self:
        plane = PlanePrior(self._plane.spec, least, self._plane.independent)
        return type(self)(plane, self._evidence, self._h, self._signed, self._centre)

    def posterior(self, unit: float, samples: int, determined: float) -> DensePosterior:
        factor = self.factor * unit
        return DensePosterior(self._plane.spec, self._h, unit, samples, determined, factor)


class _SparseSystem(PriorSystem):
    """Normal equations as a sparse system.

    Uses ``system``, which the systems for other hyperparameters use too.
    """

    def __init__(
        self,
        system: EverettSystem,
        field: FieldPrior,
        y: FloatArray,
        h: Hyperparameters,
        signed: bool,
        centre: FloatArray,
    ) -> None:
        self._centre = centre
        self._system, self._field, self._y, self._h = system, field, y, h
        self._signed, self._variance = signed, h.noise**2 + h.discrepancy**2

    def _condition(self, variance: float) -> EverettSystem:
        """Return the system with the prior for this variance of a measured output."""
        system = self._system
        precision = self._field.precision(self._h, variance)
        squares, _ = system.matrix.column_squares(system.weight)
        system.condition(precision, 1 / np.sqrt(squares + precision.own))
        return system

    def _factorise(self, variance: float) -> EverettSystem:
        if self._system.owner != (self, variance):
            self._condition(variance).factorise(0.0)
            self._system.owner = self, variance
        return self._system

    @cached_property
    def _mean_and_logarithm(self) -> tuple[FloatArray, float]:
        """Posterior mean, and the logarithm of the determinant over that of the prior."""
        system = self._factorise(self._variance)
        begin = self._gradient(np.zeros(system.scale.size))
        z = system.solve(-begin, True, _ACCURATE, _STEPS)
        assert system.precision is not None
        return system.scale * z, system.logarithm() - system.precision.logarithm

    @property
    def mean(self) -> FloatArray:
        return self._mean_and_logarithm[0]

    @property
    def determined(self) -> float:
        """Derivative of the logarithm of that ratio by that of the variance, negative."""
        here, step = self._mean_and_logarithm[1], 1 + _STEP
        system = self._factorise(self._variance * step)
        assert system.precision is not None
        return (here - system.logarithm() + system.precision.logarithm) / float(np.log(step))

    @property
    def likelihood(self) -> float:
        (mean, spent), v, weight = self._mean_and_logarithm, self._variance, self._system.weight
        left = float(weight @ (self._y * (self._y - self._system.matrix.forward(mean))))
        return -0.5 * (left / v + spent + float(weight.sum() * np.log(v)))

    def bounded(self, guess: FloatArray | None = None) -> tuple[FloatArray, float]:
        start = self.mean if guess is None else guess
        system, spec = self._condition(self._variance), self._system.matrix.spec
        size = float(np.linalg.norm(np.sqrt(system.weight) * self._y)) or 1.0
        bounded = bounded_unknowns(spec, self._signed)
        start = start + self._centre
        start = np.where(bounded, np.maximum(start, 0.0), start) / system.scale
        found = interior_point.polish(
            system, lambda z: self._gradient(system.scale * z - self._centre), bounded, start, size
        )
        return system.scale * found.z - self._centre, found.kkt

    @property
    def apart(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(K,) precisions, means and variances of the weights apart from what the field gives.

        In units of the variance of a measured output, but for the means.
        """
        system = self._factorise(self._variance)
        assert system.precision is not None
        given = system.precision.own[: system.cells]
        mean = system.precision.apart(self.mean)
        return given, mean, system.variances_apart(self._field.link_cells)

    def variances(self, matrix: DesignMatrix) -> FloatArray:
        return self._variance * self._factorise(self._variance).variances(matrix)

    def widened(self, least: FloatArray) -> Self:
        plane = self._field.plane
        field = self._field.on(PlanePrior(plane.spec, least, plane.independent))
        return type(self)(self._system, field, self._y, self._h, self._signed, self._centre)

    def posterior(self, unit: float, samples: int, determined: float) -> SparsePosterior:
        system, h = self._factorise(self._variance), self._h
        variance = self._variance * unit**2
        return SparsePosterior(system.matrix.spec, h, unit, samples, determined, system, variance)

    def _gradient(self, x: FloatArray) -> FloatArray:
        """Scaled gradient of the cost at deviations (n,)."""
        system = self._system
        assert system.precision is not None
        left = system.matrix.forward(x) - self._y
        downhill = system.matrix.adjoint(system.weight * left) + system.precision.product(x)
        return np.asarray(system.scale * downhill)


def dense_system(
    plane: PlanePrior,
    evidence: Evidence,
    h: Hyperparameters,
    signed: bool,
    centre: FloatArray | None = None,
) -> _DenseSystem:
    """Normal equations on dense matrices.

    Parameters
    ----------
    plane : PlanePrior
        Prior.
    evidence : Evidence
        Measurements, less the outputs of the mean of the prior.
    h : Hyperparameters
        Hyperparameters of the prior.
    signed : bool
        Let weights and slope be negative.
    centre : (n,) array, optional
        Mean of the prior; zero if not given.
    """
    centre = np.zeros(plane.spec.unknowns) if centre is None else centre
    return _DenseSystem(plane, evidence, h, signed, centre)


@dataclass(frozen=True, eq=False)
class SparseEvidence:
    """Scaled measurements (M,), less the outputs of the mean of the prior, and their system."""

    system: EverettSystem
    y: FloatArray

    @property
    def spec(self) -> PlaneSpec:
        """The unknowns."""
        return self.system.matrix.spec


@dataclass(frozen=True, eq=False)
class Systems:
    """Normal equations of many samples for any hyperparameters.

    Those of other hyperparameters become invalid with each call.
    """

    evidence: Evidence | SparseEvidence
    """The samples."""
    plane: PlanePrior
    """Prior."""
    field: FieldPrior
    """Its field."""
    signed: bool
    """Let weights and slope be negative."""
    centre: FloatArray
    """Shape (n,). Mean of the prior."""

    def __call__(self, h: Hyperparameters) -> PriorSystem:
        """Return the system for these hyperparameters."""
        if isinstance(self.evidence, Evidence):
            return _DenseSystem(self.plane, self.evidence, h, self.signed, self.centre)
        return sparse_system(self.evidence, self.field, h, self.signed, self.centre)

    def with_independent(self, independent: FloatArray) -> Systems:
        """Return those with other variances (K,) of the independent parts, over the nugget's."""
        plane = PlanePrior(self.plane.spec, independent=independent)
        return replace(self, plane=plane, field=self.field.on(plane))


def sparse_system(
    evidence: SparseEvidence,
    field: FieldPrior,
    h: Hyperparameters,
    signed: bool,
    centre: FloatArray,
) -> _SparseSystem:
    """Normal equations on the sparse system; parameters as of `Systems`."""
    return _SparseSystem(evidence.system, field, evidence.y, h, signed, centre)


def systems(
    matrix: DesignMatrix,
    y: FloatArray,
    weight: FloatArray,
    signed: bool,
    centre: FloatArray | None = None,
) -> Systems:
    """Normal equations of many samples, sparse where that is quicker.

    Raises a `ParameterError` if the plane is too fine for dense matrices and the record does not
    suit sparse ones.

    Parameters
    ----------
    matrix : DesignMatrix
        Regressors of M samples.
    y, weight : (M,) arrays
        Scaled outputs, less those of the mean of the prior, and how many samples each stands for.
    signed, centre
        As of `dense_system`.
    """
    plane, cells = PlanePrior(matrix.spec), matrix.spec.cells
    centre = np.zeros(matrix.spec.unknowns) if centre is None else centre
    field = FieldPrior(plane)
    system = None
    if cells >= _LEAST_SPARSE:
        most, scale = _FILL * float(cells) ** 3, np.ones(matrix.spec.unknowns)
        system = quick_system(matrix, weight, scale, most, field)
    if system is not None:
        return Systems(SparseEvidence(system, y), plane, field, signed, centre)
    if cells > _MOST_CELLS:
        raise ParameterError(
            f"the input reverses {matrix.reversals} times and the plane has {matrix.spec.bands} "
            'bands, so that the prior needs too large matrices; give at most 100 levels, or "auto" '
            "for smoothness instead"
        )
    return Systems(Evidence.of_many(matrix, y, weight), plane, field, signed, centre)


def is_cheap(matrix: DesignMatrix) -> bool:
    """Whether a fit with the prior takes little longer than smoothing."""
    if matrix.spec.bands > _MOST_QUICK:
        return False
    return matrix.spec.cells <= _MOST_CHEAP_CELLS or _few_operations(matrix)


def is_quick(matrix: DesignMatrix) -> bool:
    """Whether a fit with the prior takes seconds."""
    if matrix.spec.bands > _MOST_QUICK:
        return False
    return matrix.spec.cells <= MOST_DENSE_CELLS or _few_operations(matrix)


def _few_operations(matrix: DesignMatrix) -> bool:
    """Whether a factorisation of the sparse system takes less than a tenth of a second."""
    if matrix.spec.cells < _LEAST_SPARSE:
        return False
    ones, scale = np.ones(matrix.samples), np.ones(matrix.spec.unknowns)
    return quick_system(matrix, ones, scale, _MOST_OPERATIONS) is not None


def bounded_unknowns(spec: PlaneSpec, signed: bool) -> BoolArray:
    """(n,) unknowns that must not be negative."""
    bounded = np.full(spec.unknowns, not signed)
    if spec.offset:
        bounded[spec.cells] = False
    return bounded
