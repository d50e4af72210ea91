"""Learn the hyperparameters of the prior from measurements.

They maximise the marginal likelihood times a weak prior of their own. No actuator is exactly a
Preisach operator, so a model discrepancy is added to the noise. With few samples, it is correlated
between samples of similar present inputs and last extrema, so that repeated measurements do not
make the model overconfident.

References
----------
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 5.4.
Kennedy and O'Hagan, Bayesian calibration of computer models, JRSS B 63, 2001: the discrepancy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, writable
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.linear_algebra import (
    cholesky,
    cholesky_inverse,
    mirror,
    triangular_solve,
)
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import relay_outputs
from minorloop.operators.preisach import Preisach

_CORRELATED_SHARE = 0.8
"""Share of the variance of the discrepancy that is correlated; the rest is independent."""
MOST_SEARCH_BANDS = 20
"""Most bands of the plane on which hyperparameters are searched. The time of a search step grows
with their sixth power, because it factors a matrix of the cells."""

_NAMES = ("decay", "along", "across", "bulk", "reversible", "discrepancy", "nugget")
LEARNT = len(_NAMES)
"""Number of learnt hyperparameters, without the noise."""
_CENTRES = np.log([getattr(Hyperparameters(), name) for name in (*_NAMES, "noise")])
_SPREADS = np.array([0.8, 0.6, 0.6, 1.0, 1.0, 1.0, 2.0, 1.0])
"""Normal prior of the logarithms of the hyperparameters, the noise last. It is wide: a spread of 1
is a factor of e."""
_HEAVY = np.array([False] * LEARNT + [True])
"""Whether a hyperparameter has the tail of a t distribution: the noise only."""
_DEGREES_OF_FREEDOM = 3.0
_FURTHEST = 4.0
_FURTHEST_HEAVY = 5.0
"""Bounds of the search, in spreads from the centre."""
_STARTS, _STEEP = 3, 1.0
"""Most searches in a row; another search begins at the end of the last if the slope of the cost, or
the distance from the bounds, is this large: after a poor first step a search may stop anywhere."""


@dataclass(frozen=True, eq=False)
class Evidence(ABC):
    """Scaled measurements, in the form that the likelihood needs."""

    spec: PlaneSpec
    """The unknowns (n,)."""
    count: float
    """Number of measurements."""
    square: float
    """Sum of their squares."""

    @abstractmethod
    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """A'R^-1 A, A'R^-1 y, y'R^-1 y and the logarithm of the determinant of R."""


@dataclass(frozen=True, eq=False)
class FewOutputs(Evidence):
    """Few measurements (M,), rotated so that discrepancies are independent."""

    rows: FloatArray
    y: FloatArray
    shares: FloatArray
    """``rows``, ``y`` and ``shares``: (M, n), (M,) and (M,) arrays. Regressors, outputs, and the
    variance of each over that of the discrepancy."""

    @classmethod
    def of(cls, spec: PlaneSpec, y: FloatArray, dense: tuple[FloatArray, FloatArray]) -> FewOutputs:
        """Evidence of outputs (M,) with the regressors and features from `regressors`."""
        shares, axes = np.linalg.eigh(_correlated(dense[1]))
        shares = np.maximum(shares, 0.0) + 1 - _CORRELATED_SHARE
        return cls(spec, y.size, float(y @ y), axes.T @ dense[0], axes.T @ y, shares)

    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """As of `Evidence`."""
        variance = self.variances(h)
        white = self.rows / variance[:, None]
        square = float(self.y @ (self.y / variance))
        return white.T @ self.rows, white.T @ self.y, square, float(np.log(variance).sum())

    def variances(self, h: Hyperparameters) -> FloatArray:
        """(M,) variances of the measurements: discrepancy and noise."""
        return h.discrepancy**2 * self.shares + h.noise**2


@dataclass(frozen=True, eq=False)
class ManyOutputs(Evidence):
    """Many measurements, whose discrepancy is independent."""

    gram: FloatArray
    slope: FloatArray
    """``gram`` and ``slope``: shape (n, n) and (n,). A'A and A'y."""

    @classmethod
    def of(
        cls, matrix: DesignMatrix, y: FloatArray, weight: FloatArray, within: float = 0.0
    ) -> ManyOutputs:
        """Evidence of outputs (M,), each with a weight (M,).

        ``within`` is the mean square of the samples about the outputs that replace them.
        """
        gram, count = matrix.gram(weight), float(weight.sum())
        mirror(gram)
        square = float(weight @ y**2) + within * count
        return cls(matrix.spec, count, square, gram, matrix.adjoint(weight * y))

    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """As of `Evidence`."""
        own = h.variance
        logarithm = self.count * float(np.log(own))
        return self.gram / own, self.slope / own, self.square / own, logarithm


def regressors(
    spec: PlaneSpec, u: FloatArray, measured: BoolArray, start: Start
) -> tuple[FloatArray, FloatArray]:
    """Dense regressors (M, n) and features (M, 3) of a record of inputs (T,).

    The features are the present input and the last two extrema, from 0 to 1 over the levels.
    """
    blank = Preisach(spec.levels, np.zeros((spec.bands, spec.bands)), diagonal=spec.diagonal)
    memory: Memory = blank.memory(start)
    count = int(np.count_nonzero(measured))
    shares, features = np.empty((count, spec.cells)), np.empty((count, 3))
    past = np.array(memory.extrema, dtype=np.float64)
    levels, uniform = writable(spec.levels), spec.diagonal == "uniform"
    _kernels.walk(levels, uniform, past, writable(u), measured, shares, features)
    columns = [relay_outputs(spec.relay, shares)]
    if spec.offset:
        columns.append(np.ones((count, 1)))
    if spec.slope:
        columns.append(u[measured][:, None])
    return np.hstack(columns), features


def disturbance(features: FloatArray, h: Hyperparameters) -> FloatArray:
    """(M, M) covariance of discrepancy plus noise of few measurements."""
    independent = (1 - _CORRELATED_SHARE) * h.discrepancy**2 + h.noise**2
    covariance: FloatArray = h.discrepancy**2 * _correlated(features)
    covariance[np.diag_indices(len(features))] += independent
    return covariance


def _correlated(features: FloatArray) -> FloatArray:
    """(M, M) correlated part of the discrepancy, over its variance."""
    # Lengths over which the discrepancy is correlated: in the present input and the last two
    # extrema, as shares of the range
    distance = (features[:, None, :] - features[None, :, :]) / np.array((0.25, 0.35, 0.7))
    return np.asarray(_CORRELATED_SHARE * np.exp(-0.5 * np.sum(distance**2, axis=2)))


def search(
    evidence: Evidence, noise: float | None, guess: Hyperparameters | None = None
) -> Hyperparameters:
    """Find the hyperparameters of greatest posterior probability.

    Correlated discrepancy and white noise may explain the same errors, and each is a local optimum.
    If the first search ends with more discrepancy than noise, a second search begins with all of it
    as noise. The better of the two counts.
    """
    from scipy.optimize import minimize

    count = LEARNT + (noise is None)
    centres, spreads = _CENTRES[:count], _SPREADS[:count]
    plane = PlanePrior(evidence.spec)

    def cost(theta: FloatArray) -> tuple[float, FloatArray]:
        penalty, steepness = _penalty((theta - centres) / spreads)
        value, slopes = likelihood(plane, evidence, _as_hyper(theta, noise))
        return penalty - value, steepness / spreads - slopes[: theta.size]

    furthest = np.where(_HEAVY[:count], _FURTHEST_HEAVY, _FURTHEST) * spreads
    bounds = list(zip(centres - furthest, centres + furthest, strict=True))
    # Most steps of the search, which takes 11 to 22 for 12 to 56 holds
    options: Any = {"maxiter": 60, "ftol": 1e-7}

    def best_from(begin: FloatArray) -> Any:
        low, high = np.transpose(bounds)
        for _ in range(_STARTS):
            begin = np.clip(begin, low, high)
            answer = minimize(
                cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options
            )
            begin = answer.x
            if np.abs(begin - np.clip(begin - answer.jac, low, high)).max() < _STEEP:
                break
        return answer

    answer = best_from(centres if guess is None else _as_theta(guess, noise))
    found = _as_hyper(answer.x, noise)
    few = isinstance(evidence, FewOutputs)
    if noise is None and few and found.noise < found.discrepancy:
        all_noise = float(np.hypot(found.noise, found.discrepancy))
        white = replace(found, discrepancy=Hyperparameters().discrepancy, noise=all_noise)
        answer = min(answer, best_from(_as_theta(white, noise)), key=lambda one: float(one.fun))
    return _as_hyper(answer.x, noise)


def _penalty(distance: FloatArray) -> tuple[float, FloatArray]:
    """Negative logarithm of the prior density of hyperparameters, and its derivatives.

    Distances are in spreads from the centres.

    The noise has a t distribution: most sensors are good, but the data must be able to show that a
    sensor is fifty times worse. The discrepancy has a normal distribution: on rough planes a heavy
    tail would let it explain errors that further holds can reduce.
    """
    heavy, more = _HEAVY[: distance.size], _DEGREES_OF_FREEDOM + 1
    squares = distance**2
    tails = more / 2 * np.log1p(squares[heavy] / _DEGREES_OF_FREEDOM)
    steepness = np.where(heavy, more * distance / (_DEGREES_OF_FREEDOM + squares), distance)
    return float(0.5 * np.sum(squares[~heavy]) + np.sum(tails)), steepness


def likelihood(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Logarithm of the marginal likelihood, up to a constant, and its derivatives.

    The derivatives (8,) are with respect to the logarithms of the hyperparameters, the noise last.

    References
    ----------
    Rasmussen and Williams 2006, eq. 5.9. With C the covariance of the outputs and W = C^-1 y y'
    C^-1 - C^-1, a derivative is half the sum of W times the derivative of C.
    """
    if isinstance(evidence, FewOutputs) and len(evidence.rows) <= evidence.spec.unknowns:
        return _by_outputs(plane, evidence, h)
    return _by_unknowns(plane, evidence, h)


def likelihood_of_few(plane: PlanePrior, evidence: FewOutputs, h: Hyperparameters) -> float:
    """Logarithm of the marginal likelihood of few measurements, without derivatives."""
    outer = _outputs_factor(plane, evidence, h)
    half = triangular_solve(outer, evidence.y)
    return -0.5 * float(half @ half) - float(np.log(outer.diagonal()).sum())


def _outputs_factor(plane: PlanePrior, evidence: FewOutputs, h: Hyperparameters) -> FloatArray:
    """(M, M) Cholesky factor of the covariance of few outputs."""
    rows = evidence.rows * plane.scale(h)
    covariance = rows @ plane.covariance(h) @ rows.T
    covariance[np.diag_indices(len(rows))] += evidence.variances(h)
    return cholesky(covariance)


def _by_outputs(
    plane: PlanePrior, evidence: FewOutputs, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Likelihood through the (M, M) covariance of the outputs."""
    y, outer = evidence.y, _outputs_factor(plane, evidence, h)
    inverse = cholesky_inverse(outer)
    solved = inverse @ y
    value = -0.5 * float(y @ solved) - float(np.log(outer.diagonal()).sum())
    weight = np.outer(solved, solved) - inverse
    slopes = np.append(plane.slopes(h, evidence.rows.T @ weight @ evidence.rows), 0.0)
    own = weight.diagonal()
    slopes[5] = 2 * h.discrepancy**2 * float(evidence.shares @ own)
    slopes[7] = 2 * h.noise**2 * float(own.sum())
    return value, 0.5 * slopes


def _by_unknowns(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Likelihood through the (n, n) posterior covariance P of the unknowns.

    A'W A is (A'R^-1 e)(A'R^-1 e)' - G + G P G with G = A'R^-1 A and the residual e of the posterior
    mean.
    """
    gram, slope, square, logarithm = evidence.information(h)
    root = cholesky(plane.covariance(h)) * plane.scale(h)[:, None]
    gram_root = gram @ root
    inner = _inner_factor(gram, root, gram_root)
    half = triangular_solve(inner, gram_root.T)  # half' half is G P G
    part = triangular_solve(inner, root.T @ slope)
    spent = 2 * float(np.log(inner.diagonal()).sum())
    value = -0.5 * (square - float(part @ part) + spent + logarithm)
    left = slope - half.T @ part
    slopes = np.append(plane.slopes(h, np.outer(left, left) - gram + half.T @ half), 0.0)
    mean = root @ triangular_solve(inner, part, transposed=True)
    if isinstance(evidence, FewOutputs):
        variance = evidence.variances(h)
        spread = triangular_solve(inner, (evidence.rows @ root).T)
        left = (evidence.y - evidence.rows @ mean) / variance
        weight = left**2 - (1 - np.einsum("nm,nm->m", spread, spread) / variance) / variance
        by_discrepancy, by_noise = float(evidence.shares @ weight), float(weight.sum())
    else:
        error = square - 2 * float(mean @ slope) + float(mean @ gram @ mean)
        determined = inner.shape[0] - float(np.trace(cholesky_inverse(inner)))
        by_discrepancy = by_noise = (error - evidence.count + determined) / h.variance
    slopes[5] = 2 * h.discrepancy**2 * by_discrepancy
    slopes[7] = 2 * h.noise**2 * by_noise
    return value, 0.5 * slopes


def _inner_factor(gram: FloatArray, root: FloatArray, gram_root: FloatArray) -> FloatArray:
    """(n, n) Cholesky factor of the unit matrix plus root' gram root."""
    one = np.eye(root.shape[0])
    try:
        return cholesky(one + root.T @ gram_root)
    except np.linalg.LinAlgError:  # with little noise, the unit matrix is lost to rounding
        values, axes = np.linalg.eigh(gram)
        values[values < np.finfo(float).eps * values.size * values[-1]] = 0.0
        half = np.sqrt(values)[:, None] * (axes.T @ root)
        factor: FloatArray = np.asarray(np.linalg.qr(np.vstack([one, half]), mode="r")).T
        return factor * np.sign(factor.diagonal())


def _as_hyper(theta: FloatArray, noise: float | None) -> Hyperparameters:
    values = np.exp(theta)
    last = float(values[-1]) if noise is None else noise
    named = dict(zip(_NAMES, map(float, values[:LEARNT]), strict=True))
    return Hyperparameters(**named, noise=last)


def _as_theta(h: Hyperparameters, noise: float | None) -> FloatArray:
    names = [*_NAMES, "noise"] if noise is None else _NAMES
    return np.log([getattr(h, name) for name in names])
