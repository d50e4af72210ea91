"""A Gaussian prior on the weights of a Preisach plane, and the posterior given measurements.

Before anything is measured, weights of neighbouring cells are correlated and decay with the
distance from the diagonal. How strongly they do is learnt from the measurements: as the
hyperparameters of greatest marginal likelihood. No actuator is exactly a Preisach operator, so a
model discrepancy is added to the noise. It is correlated where the present inputs and the last
extrema are similar, so that repeated measurements do not make the model overconfident.

All quantities are scaled: inputs from 0 to 1 over the levels, outputs to a range of 1. The cost
is (y - A x)' R^-1 (y - A x) + x' S^-1 x, with weights x that are not negative, regressors A, prior
covariance S, and covariance R of discrepancy plus noise.

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

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification import active_set
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import cell_areas, relay_outputs, swing
from minorloop.operators.preisach import Preisach
from minorloop.threads import one_thread

LEVEL_VARIANCE = 4.0
"""Prior variance of offset and slope, in squared ranges of the output: twice the range."""
CORRELATION_LENGTHS = (0.25, 0.35, 0.7)
"""Lengths over which the discrepancy is correlated: in the present input and the last two extrema,
as shares of the range."""
CORRELATED_SHARE = 0.8
"""Share of the variance of the discrepancy that is correlated; the rest is independent."""
MOST_CORRELATED = 400
"""Samples up to which the discrepancy is correlated. For more it is independent, because the
covariance would not fit into memory."""
MANY = 10**9
"""Number of samples that stands for hyperparameters that are given, not learnt."""
MOST_SEARCH_BANDS = 20
"""Bands of the plane on which hyperparameters are searched; each search step costs their sixth
power, as it factors a matrix of the cells."""
MOST_SEARCH_BANDS_DENSE = 40
"""The same for few samples, for which a search step costs the fourth power."""

_NAMES = ("decay", "along", "across", "bulk", "reversible", "discrepancy", "nugget")
_CENTRES = np.log([0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.3])
_SPREADS = np.array([0.8, 0.6, 0.6, 1.0, 1.0, 1.0, 2.0])
"""Normal prior of the logarithms of the hyperparameters. Wide: a spread of 1 is a factor of e."""
_NOISE_CENTRE, _NOISE_SPREAD = float(np.log(0.003)), 1.0
_HEAVY = np.array([False] * 7 + [True])
"""Which of them have the tail of a t distribution: the noise only."""
_DEGREES_OF_FREEDOM = 3.0
_FURTHEST = 4.0
_FURTHEST_HEAVY = 5.0
"""Bounds of the search, in spreads from the centre."""
_ITERATIONS = 60
_LEAST_NOISE = 1e-6
_REFINEMENTS = 2


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters of the prior, in ranges of input and output.

    Parameters
    ----------
    decay : float
        Distance alpha - beta over which weights decay by a factor of e.
    along, across : float
        Correlation lengths in (alpha + beta) / 2 and in alpha - beta.
    bulk : float
        Standard deviation of the sum of the irreversible weights.
    reversible : float
        Standard deviation of the sum of the reversible weights.
    discrepancy : float
        Standard deviation of the model discrepancy, which no weights can reproduce.
    nugget : float
        Independent over correlated variance of a weight: near 0 on smooth planes, above 1 where
        neighbouring weights are unrelated.
    noise : float
        Standard deviation of a measured output.
    """

    decay: float = 0.3
    along: float = 0.3
    across: float = 0.4
    bulk: float = 0.15
    reversible: float = 0.3
    discrepancy: float = 0.006
    nugget: float = 0.3
    noise: float = 0.003


class PlanePrior:
    """Prior covariance of the unknowns of a plane, for any hyperparameters."""

    def __init__(self, spec: PlaneSpec) -> None:
        self.spec = spec
        grid = (spec.levels - spec.levels[0]) / (spec.levels[-1] - spec.levels[0])
        middle, width = (grid[1:] + grid[:-1]) / 2, np.diff(grid)
        i, j = np.tril_indices(spec.bands)
        self._diagonal = np.flatnonzero(i == j)
        self._along = (middle[i] + middle[j]) / 2
        # The centre of a triangle is a third of its width from the diagonal.
        self._across = np.where(i == j, width[i] / 3, middle[i] - middle[j])
        self._area = cell_areas(grid)[i, j]
        self._width, self._middle = width, middle
        self._unit = 2.0 / swing(spec.relay)
        self._none = np.zeros(spec.bands)
        self._correlations: dict[tuple[float, float], FloatArray] = {}

    def scale(self, h: Hyperparameters) -> FloatArray:
        """(n,) approximate prior standard deviations of the unknowns; all positive."""
        bulk = self._bulk(h)
        sizes = bulk.copy()
        sizes[self._diagonal] = np.hypot(bulk[self._diagonal], h.reversible * self._width)
        levels = np.full(self.spec.unknowns - self.spec.cells, np.sqrt(LEVEL_VARIANCE))
        return np.concatenate([self._unit * sizes, levels])

    def covariance(self, h: Hyperparameters) -> FloatArray:
        """(n, n) covariance of the unknowns over the products of their scales."""
        cells, n = self.spec.cells, self.spec.unknowns
        scale = self.scale(h)
        covariance = np.zeros((n, n))
        size = self._unit * self._bulk(h) / scale[:cells]
        correlation = self._correlation(h.along, h.across) + 1.0
        correlation[np.diag_indices(cells)] += h.nugget
        covariance[:cells, :cells] = size[:, None] * correlation * size
        size = self._unit * h.reversible * self._width / scale[self._diagonal]
        correlation = self._reversible_correlation(h) + 1.0
        correlation[np.diag_indices(self.spec.bands)] += h.nugget
        covariance[np.ix_(self._diagonal, self._diagonal)] += size[:, None] * correlation * size
        covariance[np.arange(cells, n), np.arange(cells, n)] = 1.0
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
        cells, bulk = self.spec.cells, self._unit * self._bulk(h)
        weighted = bulk[:, None] * weight[:cells, :cells] * bulk
        correlation = self._correlation(h.along, h.across)
        nugget = h.nugget * float(np.trace(weighted))
        each = np.sum(weighted * (correlation + 1.0), axis=1) + h.nugget * weighted.diagonal()
        along, across = _kernels.matern_slopes(
            self._along, self._across, h.along, h.across, correlation, weighted
        )
        decay = np.exp(-self._across / h.decay) * self._area
        distance = self._across / h.decay
        by_decay = 2 * float(each @ (distance - distance @ decay / decay.sum()))
        size = self._unit * h.reversible * self._width
        weighted = size[:, None] * weight[np.ix_(self._diagonal, self._diagonal)] * size
        correlation = self._reversible_correlation(h)
        along += _kernels.matern_slopes(
            self._middle, self._none, h.along, 1.0, correlation, weighted
        )[0]
        own = h.nugget * float(np.trace(weighted))
        by_reversible = 2 * (float(np.sum(weighted * (correlation + 1.0))) + own)
        by_bulk = 2 * float(each.sum())
        return np.array([by_decay, along, across, by_bulk, by_reversible, 0.0, nugget + own])

    def _reversible_correlation(self, h: Hyperparameters) -> FloatArray:
        """(L, L) correlation of the reversible weights."""
        correlation = np.empty((self.spec.bands, self.spec.bands))
        _kernels.matern(self._middle, self._none, h.along, 1.0, correlation)
        return correlation

    def _correlation(self, along: float, across: float) -> FloatArray:
        """Return the (K, K) Matern correlation, kept while other hyperparameters change."""
        if (along, across) not in self._correlations:
            if len(self._correlations) > 1:
                del self._correlations[next(iter(self._correlations))]
            out = np.empty((self.spec.cells, self.spec.cells))
            _kernels.matern(self._along, self._across, along, across, out)
            self._correlations[along, across] = out
        return self._correlations[along, across]

    def _bulk(self, h: Hyperparameters) -> FloatArray:
        """(K,) standard deviations of the irreversible weights."""
        decay = np.exp(-self._across / h.decay) * self._area
        return np.asarray(h.bulk * decay / decay.sum())


@dataclass(frozen=True, eq=False)
class Evidence:
    """Scaled measurements, in the form that the likelihood needs.

    ``y`` (M,) outputs. Where the discrepancy is correlated, regressors ``rows`` (M, n) and
    ``features`` (M, 3) as `regressors` gives them, and ``relative`` (M,), the noise variance of
    each output over that of the hyperparameters; otherwise ``gram`` A'A (n, n) and ``slope`` A'y
    (n,).
    """

    spec: PlaneSpec
    y: FloatArray
    rows: FloatArray | None = None
    features: FloatArray | None = None
    relative: FloatArray | float = 1.0
    gram: FloatArray | None = None
    slope: FloatArray | None = None

    def information(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float, float]:
        """A'R^-1 A, A'R^-1 y, y'R^-1 y and the logarithm of the determinant of R."""
        if self.rows is None or self.features is None:
            assert self.gram is not None
            assert self.slope is not None
            variance = h.noise**2 + h.discrepancy**2
            square = float(self.y @ self.y) / variance
            logarithm = self.y.size * float(np.log(variance))
            return self.gram / variance, self.slope / variance, square, logarithm
        root = np.linalg.cholesky(disturbance(self.features, h, self.relative))
        white = _triangular_solve(root, np.column_stack([self.rows, self.y]))
        a, y = white[:, :-1], white[:, -1]
        return a.T @ a, a.T @ y, float(y @ y), 2 * float(np.log(root.diagonal()).sum())


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior distribution of the unknowns given the measurements, in the unit of the output.

    Parameters
    ----------
    spec : PlaneSpec
        The unknowns, (n,): packed weights, offset, slope.
    hyperparameters : Hyperparameters
        Hyperparameters of the prior, in ranges.
    unit : float
        Range of the measured outputs.
    factor : (n, n) array
        F, where F F' is the posterior covariance in squared units, without sign constraints.
    samples : int
        Measurements that the hyperparameters were learnt from. Variances are multiplied by
        samples / (samples - 7), at most by 2, because seven hyperparameters were learnt.
    """

    spec: PlaneSpec
    hyperparameters: Hyperparameters
    unit: float
    factor: FloatArray
    samples: int

    def deviation(self, u: FloatArray, start: Start) -> FloatArray:
        """Standard deviation of the true outputs for inputs (T,).

        It includes the uncertainty of the weights and the model discrepancy, but no sensor noise.
        """
        rows, _ = regressors(self.spec, u, np.ones(u.size, dtype=np.bool_), start)
        return self.row_deviation(rows)

    def row_deviation(self, rows: FloatArray) -> FloatArray:
        """Standard deviation of the true outputs for regressors (T, n)."""
        spread = np.einsum("tk,tk->t", *[rows @ self.factor] * 2)
        spread += (self.hyperparameters.discrepancy * self.unit) ** 2
        factor = min(self.samples / max(self.samples - len(_NAMES), 1), 2.0)
        return np.asarray(np.sqrt(factor * spread))


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Fitted unknowns, the violation of the optimality conditions, and the posterior."""

    x: FloatArray
    kkt: float
    posterior: Posterior
    leave_one_out: FloatArray | None
    """(M,) standardised leave-one-out residuals; None for more than `MOST_CORRELATED` samples."""
    learnt: Hyperparameters
    """Result of the search. Those of the posterior may have a greater discrepancy, because weights
    that are not negative leave greater residuals."""


def fit_prior(
    matrix: DesignMatrix,
    y: FloatArray,
    dense: tuple[FloatArray, ...] | None,
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
) -> PriorFit:
    """Fit the unknowns with the prior.

    Parameters
    ----------
    matrix : DesignMatrix
        Regressors of M measurements.
    y : (M,) array
        Outputs.
    dense : tuple, optional
        What `regressors` gives, up to `MOST_CORRELATED` samples; possibly the relative variances
        of the noise as well.
    signed : bool
        Let weights and slope be negative.
    noise : float, optional
        Standard deviation of a measured output, in its unit; learnt if not given.
    guess : Hyperparameters, optional
        Start of the search.
    coarse : tuple, optional
        What `coarse_rows` gives; with ``dense`` only.
    """
    if dense is not None:
        return fit_dense(
            matrix.spec, y, dense, signed=signed, noise=noise, guess=guess, coarse=coarse
        )
    with one_thread(matrix.spec.unknowns):
        return _fit_gram(matrix, y, signed, noise, guess)


def _fit_gram(
    matrix: DesignMatrix,
    y: FloatArray,
    signed: bool,
    noise: float | None,
    guess: Hyperparameters | None,
) -> PriorFit:
    spec, (scaled, unit, shift) = matrix.spec, _scaled(matrix.spec, y)
    known = _scaled_noise(noise, unit)
    small = matrix
    while small.spec.bands > MOST_SEARCH_BANDS:
        small = small.coarser()
    found = _gram_evidence(matrix, scaled)
    coarse = found if small is matrix else _gram_evidence(small, scaled)
    h = search(coarse, known, guess)
    # The independent part of a coarse cell is the mean of those of its fine cells.
    h = replace(h, nugget=h.nugget * spec.cells / small.spec.cells)
    plane = PlanePrior(spec)
    x, kkt, factor = _solve(plane, found, h, signed)
    if coarse is not found:
        for _ in range(_REFINEMENTS):
            h = _with_residual_variance(found, matrix, h, x, factor, known)
            x, kkt, factor = _solve(plane, found, h, signed)
    learnt = h
    for _ in range(_REFINEMENTS):
        raised = _with_residual_discrepancy(h, scaled - matrix.forward(x))
        if raised is h:
            break
        h = raised
        x, kkt, factor = _solve(plane, found, h, signed)
    posterior = Posterior(spec, h, unit, factor * unit, y.size)
    return PriorFit(_unscaled(spec, x, unit, shift), kkt, posterior, None, learnt)


def fit_dense(
    spec: PlaneSpec,
    y: FloatArray,
    dense: tuple[FloatArray, ...],
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
) -> PriorFit:
    """Fit few samples, with correlated discrepancy; parameters as of `fit_prior`.

    Where ``coarse`` is given, the hyperparameters are searched on that plane.
    """
    scaled, unit, shift = _scaled(spec, y)
    found = Evidence(spec, scaled, *dense)
    plane = PlanePrior(spec)
    with one_thread(spec.unknowns):
        if coarse is None:
            learnt = h = search(found, _scaled_noise(noise, unit), guess)
        else:
            small = Evidence(coarse[0], scaled, coarse[1], *dense[1:])
            learnt = search(small, _scaled_noise(noise, unit), guess)
            h = replace(learnt, nugget=learnt.nugget * spec.cells / coarse[0].cells)
        x, kkt, factor = _solve(plane, found, h, signed)
        leave_one_out = _leave_one_out(plane, found, h)
        for _ in range(_REFINEMENTS):
            raised = _with_residual_discrepancy(h, scaled - dense[0] @ x)
            if raised is h:
                break
            h = raised
            x, kkt, factor = _solve(plane, found, h, signed)
    posterior = Posterior(spec, h, unit, factor * unit, y.size)
    return PriorFit(_unscaled(spec, x, unit, shift), kkt, posterior, leave_one_out, learnt)


def fit_given(
    posterior: Posterior,
    matrix: DesignMatrix,
    y: FloatArray,
    dense: tuple[FloatArray, ...] | None,
    kept: BoolArray,
    *,
    signed: bool,
) -> FloatArray:
    """Fit the unknowns to some of the samples, with the hyperparameters of a posterior.

    Parameters
    ----------
    posterior : Posterior
        Its hyperparameters are used.
    matrix : DesignMatrix
        Regressors of M samples.
    y : (M,) array
        Outputs.
    dense : tuple, optional
        What `regressors` gives; None for many samples.
    kept : (M,) array of bool
        The samples to be fitted.
    signed : bool
        Let weights and slope be negative.
    """
    spec, unit = matrix.spec, posterior.unit
    shift = float(y[kept].mean()) if spec.offset else 0.0
    scaled = (y - shift) / unit
    with one_thread(spec.unknowns):
        if dense is None:
            found = _gram_evidence(matrix, scaled, kept.astype(np.float64))
        else:
            found = Evidence(spec, scaled[kept], *(part[kept] for part in dense))
        x, _, _ = _solve(PlanePrior(spec), found, posterior.hyperparameters, signed)
    return _unscaled(spec, x, unit, shift)


def _scaled(spec: PlaneSpec, y: FloatArray) -> tuple[FloatArray, float, float]:
    unit = float(np.ptp(y)) or 1.0
    shift = float(y.mean()) if spec.offset else 0.0
    return (y - shift) / unit, unit, shift


def _unscaled(spec: PlaneSpec, x: FloatArray, unit: float, shift: float) -> FloatArray:
    x = x * unit
    if spec.offset:
        x[spec.cells] += shift
    return x


def _scaled_noise(noise: float | None, unit: float) -> float | None:
    return None if noise is None else max(noise / unit, _LEAST_NOISE)


def posterior_after(
    spec: PlaneSpec, h: Hyperparameters, dense: tuple[FloatArray, FloatArray]
) -> Posterior:
    """Posterior after measurements with these regressors and features; output range 1.

    Its mean is not used: the covariance does not depend on the outputs.
    """
    found = Evidence(spec, np.zeros(dense[0].shape[0]), *dense)
    _, _, factor = _solve(PlanePrior(spec), found, h, signed=True)
    return Posterior(spec, h, 1.0, factor, MANY)


def coarse_rows(
    matrix: DesignMatrix, u: FloatArray, measured: BoolArray, start: Start
) -> tuple[PlaneSpec, FloatArray] | None:
    """Plane that is coarse enough to search hyperparameters on, and its regressors.

    None if the plane of ``matrix`` is coarse enough.
    """
    small = matrix
    while small.spec.bands > MOST_SEARCH_BANDS_DENSE:
        small = small.coarser()
    return None if small is matrix else (small.spec, regressors(small.spec, u, measured, start)[0])


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
    levels = np.asarray(spec.levels, dtype=np.float64)
    _kernels.walk(levels, spec.diagonal == "uniform", past, u, measured, shares, features)
    columns = [relay_outputs(spec.relay, shares)]
    if spec.offset:
        columns.append(np.ones((count, 1)))
    if spec.slope:
        columns.append(u[measured][:, None])
    return np.hstack(columns), features


def disturbance(
    features: FloatArray, h: Hyperparameters, relative: FloatArray | float = 1.0
) -> FloatArray:
    """(M, M) covariance of discrepancy plus noise, of relative variance of the noise."""
    independent = (1 - CORRELATED_SHARE) * h.discrepancy**2 + h.noise**2 * relative
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
    """Find the hyperparameters of greatest posterior probability."""
    from scipy.optimize import minimize

    centres, spreads = _CENTRES, _SPREADS
    if noise is None:
        centres, spreads = np.append(centres, _NOISE_CENTRE), np.append(spreads, _NOISE_SPREAD)
    plane = PlanePrior(evidence.spec)

    def cost(theta: FloatArray) -> tuple[float, FloatArray]:
        penalty, steepness = _penalty((theta - centres) / spreads)
        value, slopes = likelihood(plane, evidence, _as_hyper(theta, noise))
        return penalty - value, steepness / spreads - slopes[: theta.size]

    begin = centres if guess is None else _as_theta(guess, noise)
    furthest = np.where(_HEAVY[: centres.size], _FURTHEST_HEAVY, _FURTHEST) * spreads
    bounds = list(zip(centres - furthest, centres + furthest, strict=True))
    begin = np.clip(begin, *np.transpose(bounds))
    options: Any = {"maxiter": _ITERATIONS, "ftol": 1e-7}
    answer = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
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
    if evidence.rows is not None and evidence.features is not None:
        return _likelihood_of_few(plane, evidence, h)
    return _likelihood_of_many(plane, evidence, h)


def _likelihood_of_few(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Likelihood through the (M, M) covariance of the outputs."""
    assert evidence.rows is not None
    assert evidence.features is not None
    scale, y = plane.scale(h), evidence.y
    rows = evidence.rows * scale
    correlated = h.discrepancy**2 * _correlated(evidence.features)
    covariance = rows @ plane.covariance(h) @ rows.T + correlated
    independent = (1 - CORRELATED_SHARE) * h.discrepancy**2 + h.noise**2 * evidence.relative
    covariance[np.diag_indices(y.size)] += independent
    outer = np.linalg.cholesky(covariance)
    half = _triangular_solve(outer, np.column_stack([np.eye(y.size), y]))
    left, half = half[:, -1], half[:, :-1]
    value = -0.5 * float(left @ left) - float(np.log(outer.diagonal()).sum())
    solved = half.T @ left
    weight = np.outer(solved, solved) - half.T @ half
    slopes = np.append(plane.slopes(h, evidence.rows.T @ weight @ evidence.rows), 0.0)
    total = float(np.trace(weight))
    own = (1 - CORRELATED_SHARE) * h.discrepancy**2 * total
    slopes[5] = 2 * (float(np.sum(weight * correlated)) + own)
    slopes[7] = 2 * h.noise**2 * float(np.sum(weight.diagonal() * evidence.relative))
    return value, 0.5 * slopes


def _likelihood_of_many(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters
) -> tuple[float, FloatArray]:
    """Likelihood through the (n, n) posterior covariance P of the unknowns.

    A'W A is (A'e)(A'e)' / v^2 - G / v + G P G / v^2 with the Gram matrix G, the residual e of the
    posterior mean, and the variance v of an output.
    """
    assert evidence.gram is not None
    gram, slope, square, logarithm = evidence.information(h)  # over the variance
    root = np.linalg.cholesky(plane.covariance(h)) * plane.scale(h)[:, None]
    seen = gram @ root
    inner = np.linalg.cholesky(np.eye(root.shape[0]) + root.T @ seen)
    half = _triangular_solve(inner, seen.T)  # half' half is G P G / v^2
    part = _triangular_solve(inner, root.T @ slope)
    spent = 2 * float(np.log(inner.diagonal()).sum())
    value = -0.5 * (square - float(part @ part) + spent + logarithm)
    left = slope - half.T @ part
    slopes = np.append(plane.slopes(h, np.outer(left, left) - gram + half.T @ half), 0.0)
    mean = root @ _triangular_solve(inner, part, transposed=True)
    error = square - 2 * float(mean @ slope) + float(mean @ gram @ mean)
    determined = inner.shape[0] - float(np.sum(_triangular_solve(inner, np.eye(len(inner))) ** 2))
    by_variance = 2 * (error - evidence.y.size + determined) / (h.noise**2 + h.discrepancy**2)
    slopes[5], slopes[7] = by_variance * h.discrepancy**2, by_variance * h.noise**2
    return value, 0.5 * slopes


def _solve(
    plane: PlanePrior, evidence: Evidence, h: Hyperparameters, signed: bool
) -> tuple[FloatArray, float, FloatArray]:
    """Unknowns under the sign constraints, their KKT violation, and the posterior factor."""
    gram, slope, square, _ = evidence.information(h)
    scale, prior = plane.scale(h), plane.covariance(h)
    root = np.linalg.cholesky(prior)
    inverse = _triangular_solve(root, np.eye(scale.size))
    inverse = inverse.T @ inverse
    quadratic = scale[:, None] * gram * scale + inverse
    unit = 1 / np.sqrt(quadratic.diagonal())
    scale, quadratic = scale * unit, unit[:, None] * quadratic * unit
    linear = scale * slope
    bounded = np.full(scale.size, not signed)
    if plane.spec.offset:
        bounded[plane.spec.cells] = False
    solution = active_set.solve(
        np.tril(quadratic),
        lambda z: quadratic @ z - linear,
        lambda z: quadratic @ z,
        bounded,
        float(np.sqrt(square)) or 1.0,
    )
    inner = np.linalg.cholesky(quadratic)
    factor = scale[:, None] * _triangular_solve(inner, np.eye(scale.size)).T
    return solution.z * scale, solution.kkt, factor


def _leave_one_out(plane: PlanePrior, evidence: Evidence, h: Hyperparameters) -> FloatArray:
    """(M,) leave-one-out residuals over their standard deviations.

    Sundararajan and Keerthi, Predictive approaches for choosing hyperparameters in Gaussian
    processes, Neural Computation 13, 2001.
    """
    assert evidence.rows is not None
    assert evidence.features is not None
    scale = plane.scale(h)
    half = np.asarray(evidence.rows * scale) @ np.linalg.cholesky(plane.covariance(h))
    covariance = half @ half.T + disturbance(evidence.features, h, evidence.relative)
    inverse = np.linalg.inv(covariance)
    return np.asarray((inverse @ evidence.y) / np.sqrt(inverse.diagonal()))


def _gram_evidence(
    matrix: DesignMatrix, y: FloatArray, weight: FloatArray | None = None
) -> Evidence:
    """Evidence from the Gram matrix, for many samples; each counts with its weight."""
    lower = matrix.gram(weight)
    gram = np.tril(lower) + np.tril(lower, -1).T
    counted = y if weight is None else y * weight
    return Evidence(matrix.spec, counted, gram=gram, slope=matrix.adjoint(counted))


def _with_residual_variance(
    evidence: Evidence,
    matrix: DesignMatrix,
    h: Hyperparameters,
    x: FloatArray,
    factor: FloatArray,
    noise: float | None,
) -> Hyperparameters:
    """Replace discrepancy and noise by the residual variance on the fine plane.

    MacKay, Bayesian interpolation, Neural Computation 4, 1992, section 4: sum of squared residuals
    over the number of samples less the number of well-determined unknowns.
    """
    assert evidence.gram is not None
    determined = float(np.sum((evidence.gram @ factor) * factor)) / (h.noise**2 + h.discrepancy**2)
    left = float(np.sum((evidence.y - matrix.forward(x)) ** 2))
    variance = left / max(evidence.y.size - determined, 1.0)
    own = 0.0 if noise is None else noise
    rest = max(variance - own**2, _LEAST_NOISE**2)
    return replace(h, discrepancy=float(np.sqrt(rest)), noise=own)


def _with_residual_discrepancy(h: Hyperparameters, residuals: FloatArray) -> Hyperparameters:
    """Raise the discrepancy to that of the residuals (M,), if it is less.

    The likelihood ignores the sign constraints: it explains a falling output by negative weights,
    and then underestimates the discrepancy.
    """
    rest = float(np.mean(residuals**2)) - h.noise**2
    if rest <= h.discrepancy**2:
        return h
    return replace(h, discrepancy=float(np.sqrt(rest)))


def _triangular_solve(
    lower: npt.NDArray[Any], right: npt.NDArray[Any], transposed: bool = False
) -> FloatArray:
    from scipy.linalg import solve_triangular

    found = solve_triangular(
        lower, right, lower=True, check_finite=False, trans="T" if transposed else "N"
    )
    return np.asarray(found)


def _as_hyper(theta: FloatArray, noise: float | None) -> Hyperparameters:
    values = np.exp(theta)
    last = float(values[-1]) if noise is None else noise
    named = dict(zip(_NAMES, map(float, values[: len(_NAMES)]), strict=True))
    return Hyperparameters(**named, noise=last)


def _as_theta(h: Hyperparameters, noise: float | None) -> FloatArray:
    names = [*_NAMES, "noise"] if noise is None else _NAMES
    return np.log([getattr(h, name) for name in names])
