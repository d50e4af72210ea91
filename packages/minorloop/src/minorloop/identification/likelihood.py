"""Learn the hyperparameters of the prior from measurements.

They are those of greatest marginal likelihood, times a weak prior of their own. No actuator is
exactly a Preisach operator, so a model discrepancy is added to the noise. Among few samples it is
correlated where the present inputs and the last extrema are similar, so that repeated measurements
do not make the model overconfident.

References
----------
Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, sections 2.2 and 5.4.
Kennedy and O'Hagan, Bayesian calibration of computer models, JRSS B 63, 2001: the discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, writable
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.gram_rows import mirror
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import relay_outputs
from minorloop.operators.preisach import Preisach

CORRELATION_LENGTHS = (0.25, 0.35, 0.7)
"""Lengths over which the discrepancy is correlated: in the present input and the last two extrema,
as shares of the range."""
CORRELATED_SHARE = 0.8
"""Share of the variance of the discrepancy that is correlated; the rest is independent."""
MOST_SEARCH_BANDS = 20
"""Bands of the plane on which hyperparameters are searched; each search step costs their sixth
power, as it factors a matrix of the cells."""

_NAMES = ("decay", "along", "across", "bulk", "reversible", "discrepancy", "nugget")
LEARNT = len(_NAMES)
"""Number of hyperparameters that are learnt, without the noise."""
_CENTRES = np.log([0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.3])
_SPREADS = np.array([0.8, 0.6, 0.6, 1.0, 1.0, 1.0, 2.0])
"""Normal prior of the logarithms of the hyperparameters. Wide: a spread of 1 is a factor of e."""
_NOISE_CENTRE, _NOISE_SPREAD = float(np.log(0.003)), 1.0
_HEAVY = np.array([False] * LEARNT + [True])
"""Which of them have the tail of a t distribution: the noise only."""
_DEGREES_OF_FREEDOM = 3.0
_FURTHEST = 4.0
_FURTHEST_HEAVY = 5.0
"""Bounds of the search, in spreads from the centre."""
_ITERATIONS = 60
"""Most steps of the search, which takes 11 to 22 for 12 to 56 holds."""
_STARTS, _STEEP = 3, 1.0
"""Most searches one after the other, and slope of the cost, or distance from the bounds, from which
another one begins where the last ended: after a poor first step a search may stop anywhere."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Scaled measurements, in the form that the likelihood needs."""

    spec: PlaneSpec
    """The unknowns (n,)."""
    count: float
    """Number of measurements."""
    square: float
    """Sum of their squares."""
    rows: FloatArray | None = None
    y: FloatArray | None = None
    shares: FloatArray | None = None
    """``rows``, ``y`` and ``shares``: (M, n), (M,) and (M,) arrays. Of few measurements:
    regressors, outputs, and the variance of each over that of the discrepancy, rotated so that
    discrepancies are independent."""
    gram: FloatArray | None = None
    slope: FloatArray | None = None
    """``gram`` and ``slope``: shape (n, n) and (n,). Of many measurements, whose discrepancy is
    independent: A'A and A'y."""

    @classmethod
    def of_few(
        cls, spec: PlaneSpec, y: FloatArray, dense: tuple[FloatArray, FloatArray]
    ) -> Evidence:
        """Evidence of outputs (M,) with the regressors and features that `regressors` gives."""
        shares, axes = np.linalg.eigh(_correlated(dense[1]))
        shares = np.maximum(shares, 0.0) + 1 - CORRELATED_SHARE
        square = float(y @ y)
        return cls(spec, y.size, square, axes.T @ dense[0], axes.T @ y, shares)

    @classmethod
    def of_many(
        cls, matrix: DesignMatrix, y: FloatArray, weight: FloatArray, within: float = 0.0
    ) -> Evidence:
        """Evidence of outputs (M,), each with a weight (M,).

        ``within`` is the mean square of the samples about those that stand for them.
        """
        gram, count = matrix.gram(weight), float(weight.sum())
        mirror(gram)
        square = float(weight @ y**2) + within * count
        return cls(matrix.spec, count, square, gram=gram, slope=matrix.adjoint(weight * y))

    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """A'R^-1 A, A'R^-1 y, y'R^-1 y and the logarithm of the determinant of R."""
        if self.rows is None or self.y is None:
            assert self.gram is not None
            assert self.slope is not None
            own = h.noise**2 + h.discrepancy**2
            logarithm = self.count * float(np.log(own))
            return self.gram / own, self.slope / own, self.square / own, logarithm
        variance = self.variances(h)
        white = self.rows / variance[:, None]
        square = float(self.y @ (self.y / variance))
        return white.T @ self.rows, white.T @ self.y, square, float(np.log(variance).sum())

    def variances(self, h: Hyperparameters) -> FloatArray:
        """(M,) variances of few measurements: discrepancy and noise."""
        assert self.shares is not None
        return h.discrepancy**2 * self.shares + h.noise**2


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
    independent = (1 - CORRELATED_SHARE) * h.discrepancy**2 + h.noise**2
    covariance: FloatArray = h.discrepancy**2 * _correlated(features)
    covariance[np.diag_indices(len(features))] += independent
    return covariance


def _correlated(features: FloatArray) -> FloatArray:
    """(M, M) correlated part of the discrepancy, over its variance."""
    distance = (features[:, None, :] - features[None, :, :]) / np.array(CORRELATION_LENGTHS)
    return np.asarray(CORRELATED_SHARE * np.exp(-0.5 * np.sum(distance**2, axis=2)))


def search(
    evidence: Evidence, noise: float | None, guess: Hyperparameters | None = None
) -> Hyperparameters:
    """Find the hyperparameters of greatest posterior probability.

    Correlated discrepancy and white noise may each explain the same errors, and either is a local
    optimum. Where the first search ends with more discrepancy than noise, a second one begins with
    all of it as noise, and the better of the two counts.
    """
    from scipy.optimize import minimize

    centres, spreads = _CENTRES, _SPREADS
    if noise is None:
        centres, spreads = np.append(centres, _NOISE_CENTRE), np.append(spreads, _NOISE_SPREAD)
    plane = PlanePrior(evidence.spec)

    def cost(theta: FloatArray) -> tuple[float, FloatArray]:
        penalty, steepness = _penalty((theta - centres) / spreads)
        value, slopes = likelihood(plane, evidence, _as_hyper(theta, noise))
        return penalty - value, steepness / spreads - slopes[: theta.size]

    furthest = np.where(_HEAVY[: centres.size], _FURTHEST_HEAVY, _FURTHEST) * spreads
    bounds = list(zip(centres - furthest, centres + furthest, strict=True))
    options: Any = {"maxiter": _ITERATIONS, "ftol": 1e-7}

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
    if noise is None and evidence.rows is not None and found.noise < found.discrepancy:
        usual = float(np.exp(_CENTRES[_NAMES.index("discrepancy")]))
        all_noise = float(np.hypot(found.noise, found.discrepancy))
        white = replace(found, discrepancy=usual, noise=all_noise)
        answer = min(answer, best_from(_as_theta(white, noise)), key=lambda one: float(one.fun))
    return _as_hyper(answer.x, noise)


def _penalty(distance: FloatArray) -> tuple[float, FloatArray]:
    """Negative logarithm of the prior density of hyperparameters, and its derivatives.

    Distances are in spreads from the centres.

    The noise has a t distribution: most sensors are good, but the data must be able to show that
    one is fifty times worse. The discrepancy has a normal one: on rough planes a heavy tail would
    let it explain what further holds can still determine.
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
    C^-1 - C^-1, a derivative is half the sum of W times that of C.
    """
    if evidence.rows is not None and len(evidence.rows) <= evidence.spec.unknowns:
        return _by_outputs(plane, evidence, h)
    return _by_unknowns(plane, evidence, h)


def likelihood_of_few(plane: PlanePrior, evidence: Evidence, h: Hyperparameters) -> float:
    """Logarithm of the marginal likelihood of few measurements, without derivatives."""
    outer = _outputs_factor(plane, evidence, h)
    assert evidence.y is not None
    half = triangular_solve(outer, evidence.y)
    return -0.5 * float(half @ half) - float(np.log(outer.diagonal()).sum())


def _outputs_factor(plane: PlanePrior, evidence: Evidence, h: Hyperparameters) -> FloatArray:
    """(M, M) Cholesky factor of the covariance of few outputs."""
    assert evidence.rows is not None
    rows = evidence.rows * plane.scale(h)
    covariance = rows @ plane.covariance(h) @ rows.T
    covariance[np.diag_indices(len(rows))] += evidence.variances(h)
    return cholesky(covariance)


def _by_outputs(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Likelihood through the (M, M) covariance of the outputs."""
    assert evidence.rows is not None
    assert evidence.y is not None
    assert evidence.shares is not None
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
    seen = gram @ root
    inner = cholesky(np.eye(root.shape[0]) + root.T @ seen)
    half = triangular_solve(inner, seen.T)  # half' half is G P G
    part = triangular_solve(inner, root.T @ slope)
    spent = 2 * float(np.log(inner.diagonal()).sum())
    value = -0.5 * (square - float(part @ part) + spent + logarithm)
    left = slope - half.T @ part
    slopes = np.append(plane.slopes(h, np.outer(left, left) - gram + half.T @ half), 0.0)
    mean = root @ triangular_solve(inner, part, transposed=True)
    if evidence.rows is None or evidence.y is None or evidence.shares is None:
        error = square - 2 * float(mean @ slope) + float(mean @ gram @ mean)
        determined = inner.shape[0] - float(np.trace(cholesky_inverse(inner)))
        by_noise = (error - evidence.count + determined) / (h.noise**2 + h.discrepancy**2)
        by_discrepancy = by_noise
    else:
        variance = evidence.variances(h)
        spread = triangular_solve(inner, (evidence.rows @ root).T)
        left = (evidence.y - evidence.rows @ mean) / variance
        weight = left**2 - (1 - np.einsum("nm,nm->m", spread, spread) / variance) / variance
        by_discrepancy, by_noise = float(evidence.shares @ weight), float(weight.sum())
    slopes[5] = 2 * h.discrepancy**2 * by_discrepancy
    slopes[7] = 2 * h.noise**2 * by_noise
    return value, 0.5 * slopes


def triangular_solve(
    lower: npt.NDArray[Any], right: npt.NDArray[Any], transposed: bool = False
) -> FloatArray:
    """Solution with a lower triangular matrix, or with its transpose."""
    from scipy.linalg import solve_triangular

    found = solve_triangular(
        lower, right, lower=True, check_finite=False, trans="T" if transposed else "N"
    )
    return np.asarray(found)


def triangular_inverse(lower: FloatArray) -> FloatArray:
    """Inverse of a lower triangular matrix."""
    from scipy.linalg import lapack

    # The lower triangle in C order is the upper one in Fortran order.
    return np.asarray(lapack.dtrtri(lower.T, lower=0)[0].T)


def cholesky(matrix: FloatArray) -> FloatArray:
    """Lower triangular factor of a positive definite matrix."""
    return np.asarray(np.linalg.cholesky(matrix))


def cholesky_inverse(root: FloatArray) -> FloatArray:
    """Inverse of the matrix that has this Cholesky factor."""
    from scipy.linalg import lapack

    # The lower triangle in C order is the upper one in Fortran order.
    inverse = np.asarray(lapack.dpotri(root.T, lower=0)[0].T)
    mirror(inverse)
    return inverse


def _as_hyper(theta: FloatArray, noise: float | None) -> Hyperparameters:
    values = np.exp(theta)
    last = float(values[-1]) if noise is None else noise
    named = dict(zip(_NAMES, map(float, values[:LEARNT]), strict=True))
    return Hyperparameters(**named, noise=last)


def _as_theta(h: Hyperparameters, noise: float | None) -> FloatArray:
    names = [*_NAMES, "noise"] if noise is None else _NAMES
    return np.log([getattr(h, name) for name in names])
