"""Fit the unknowns of a plane with the prior.

The cost is (y - A x)' R^-1 (y - A x) + (x - m)' S^-1 (x - m), with weights x that are not negative,
regressors A, prior mean m (zero, or a ridge) and covariance S, and covariance R of discrepancy plus
noise. Few samples have a correlated discrepancy, and are fitted on dense matrices.

A normal distribution of the independent part of the weights shrinks single large weights towards
zero, and small weights compensate for it. A t distribution of one degree of freedom does not. It is
a normal distribution with a random variance for each weight; variational Bayes, in which the
posterior stays normal, finds the variances. The marginal likelihood chooses between the two
distributions.

References
----------
Tipping and Lawrence, Variational inference for Student-t models, Neurocomputing 69, 2005. Bishop,
Pattern Recognition and Machine Learning, 2006, section 10.1: the bound on the likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.least_squares import reproduces
from minorloop.identification.likelihood import (
    MOST_SEARCH_BANDS,
    FewOutputs,
    ManyOutputs,
    disturbance,
    likelihood_of_few,
    regressors,
    search,
)
from minorloop.identification.linear_algebra import cholesky, cholesky_inverse
from minorloop.identification.posterior import (
    MOST_DENSE_CELLS,
    DenseSystem,
    Posterior,
    PriorSystem,
    system_of_many,
)
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.threads import one_thread

MOST_CORRELATED = 100
"""Samples up to which the discrepancy is correlated. Along the branches of a longer record, a
correlated discrepancy would explain outputs that the weights can explain."""
_MOST_SCREENED = 400
"""Samples up to which leave-one-out residuals are computed."""
_MANY = 10**9
"""Number of samples that means that hyperparameters are given, not learnt."""
_LEAST_NOISE = 1e-6
_ALIKE, _MOST_ALIKE, _SURE = 1.5, 10, 3.0
"""Correlation time from which errors are not independent; samples for each lag of its sum; and
standard deviations from which an autocorrelation is not noise."""
_REFINEMENTS = 2
_SQUARES, _REACHED = 8, 0.1
"""Number of squares across the plane over which densities are averaged, so that single rough cells
do not count; and least share of a square that the record switches."""
_LEAST_NUGGET, _NUGGET_STEPS, _NUGGET_TOLERANCE = 1e-3, 6, 0.5
"""Least nugget, most steps of the search for it, and tolerance of its logarithm."""
_ROUNDS = 8
"""Rounds of the variances; later rounds change outputs by less than their error."""
_LEAST_FREE = 1.0
"""Samples beyond the determined unknowns from which an exact fit shows that there is no noise."""

_Tried = TypeVar("_Tried")


@dataclass(frozen=True, eq=False)
class Regression:
    """Outputs ``y`` (M,) of the samples ``rows`` (M,), and their regressors.

    In a condensed record, each output replaces several samples, one of which is in ``rows``.

    ``within`` is the mean square of the outputs about the condensed outputs. ``noise`` is the
    standard deviation of a sample, if it is known.
    """

    matrix: DesignMatrix
    y: FloatArray
    rows: IntArray
    within: float = 0.0
    noise: float | None = None

    def squared_error(self, x: FloatArray) -> float:
        """Sum of squared errors, without the part within condensed samples."""
        return float(self.weight @ (self.matrix.forward(x) - self.y) ** 2)

    @property
    def weight(self) -> FloatArray:
        """(M,) number of samples that each output replaces, or its weight."""
        counts = self.matrix.counts
        return np.ones(self.y.size) if counts is None else counts

    @cached_property
    def few(self) -> tuple[FloatArray, FloatArray] | None:
        """Regressors and features of few samples, whose discrepancy is correlated; or None."""
        spec, samples = self.matrix.spec, self.rows.size
        correlated = samples <= MOST_CORRELATED and spec.cells <= MOST_DENSE_CELLS
        if self.matrix.counts is not None or not correlated:
            return None
        return regressors(spec, self.matrix.inputs, self.matrix.sampled, self.matrix.start)

    @cached_property
    def coarse(self) -> tuple[PlaneSpec, FloatArray] | None:
        """Plane on which the hyperparameters of few samples are searched, and its regressors.

        None if their own plane is coarse enough.
        """
        small = self.matrix.at_most(MOST_SEARCH_BANDS)
        if self.few is None or small is self.matrix:
            return None
        return small.spec, regressors(small.spec, small.inputs, small.sampled, small.start)[0]


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Fitted unknowns, the violation of the optimality conditions, and the posterior."""

    x: FloatArray
    kkt: float
    posterior: Posterior
    leave_one_out: FloatArray | None
    """(M,) standardised leave-one-out residuals; None for more than `_MOST_SCREENED` samples."""
    learnt: Hyperparameters
    """Result of the search, on a coarse plane."""
    likelihood: float
    """Logarithm of the marginal likelihood of the scaled outputs, up to a constant."""


@dataclass(frozen=True, eq=False)
class _Scaled:
    """Outputs (M,) of range 1 about their middle, minus those of the mean of the prior."""

    spec: PlaneSpec
    y: FloatArray
    unit: float
    shift: float
    centre: FloatArray
    """Shape (n,). Mean of the prior of scaled outputs."""
    noise: float | None
    """Noise of the scaled outputs, if it is known."""
    given: FloatArray | None
    """Mean of the prior in the unit of the output; None if zero."""

    @classmethod
    def of(
        cls,
        spec: PlaneSpec,
        y: FloatArray,
        kept: BoolArray,
        forward: Callable[[FloatArray], FloatArray],
        centre: FloatArray | None,
        noise: float | None,
    ) -> _Scaled:
        """Scale outputs to a range of 1 of those ``kept``; ``forward`` maps unknowns to outputs."""
        _, unit, shift = scale_outputs(spec, y[kept])
        scaled, mean = (y - shift) / unit, np.zeros(spec.unknowns)
        if centre is not None:
            mean = centre / unit
            if spec.offset:
                mean[spec.cells] -= shift / unit
            scaled = scaled - forward(mean)
        known = None if noise is None else max(noise / unit, _LEAST_NOISE)
        return cls(spec, scaled, unit, shift, mean, known, centre)

    def fit(
        self,
        system: PriorSystem,
        mean_square: Callable[[FloatArray], float],
        switched: BoolArray,
        samples: int,
        determined: float,
        leave_one_out: FloatArray | None,
        learnt: Hyperparameters,
    ) -> PriorFit:
        """Fit under the sign constraints, and raise the discrepancy to the size of the residuals.

        The likelihood of ``system`` ignores the sign constraints: negative weights explain a
        falling output, and the discrepancy is underestimated. ``mean_square`` maps deviations (n,)
        to the mean squared residual. ``switched`` (K,) cells switch between the samples.
        """
        likelihood = system.likelihood
        x, kkt = system.bounded()
        for _ in range(_REFINEMENTS):
            rest = mean_square(x) - system.h.noise**2
            if rest <= system.h.discrepancy**2:
                break
            system = replace(system, h=replace(system.h, discrepancy=float(np.sqrt(rest))))
            x, kkt = system.bounded(x)
        x = x + self.centre
        system = _with_open_cells(system, x, switched)
        posterior = system.posterior(self.unit, samples, determined)
        x = x * self.unit
        if self.spec.offset:
            x[self.spec.cells] += self.shift
        posterior = replace(posterior, centre=self.given)
        return PriorFit(x, kkt, posterior, leave_one_out, learnt, likelihood)


def fit_prior(
    regression: Regression,
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    centre: FloatArray | None = None,
    kept: BoolArray | None = None,
    independent: bool = False,
) -> PriorFit:
    """Fit the unknowns with the prior.

    Parameters
    ----------
    regression : Regression
        M measurements.
    signed : bool
        Whether weights and slope may be negative.
    noise : float, optional
        Standard deviation of a measured output, in its unit; learnt by default.
    guess : Hyperparameters, optional
        Start of the search.
    centre : (n,) array, optional
        Mean of the prior; zero by default.
    kept : (M,) array of bool, optional
        Measurements to fit, and to learn the hyperparameters from; all by default.
    independent : bool
        Whether the errors of neighbouring samples count as independent.

    Notes
    -----
    If neighbouring errors of many samples are alike, the bands are those of a fit to fewer
    independent samples. The unknowns are those of the fit to all samples: most such errors of real
    records are hysteresis that the model cannot describe, and a stronger prior would increase them.
    """
    used = np.ones(regression.y.size, dtype=np.bool_) if kept is None else kept
    with one_thread():
        if regression.few is not None:
            return _fit_few(regression, regression.few, used, signed, noise, guess, centre)
        weight = regression.weight * used
        found = _fit_many(regression, weight, signed, noise, guess, centre)
        together = 1.0 if independent else _correlation_time(regression, found.x)
        if together == 1.0:
            return found
        other = _fit_many(regression, weight / together, signed, noise, found.learnt, centre)
    posterior = replace(
        other.posterior,
        determined=found.posterior.determined,
        samples=found.posterior.samples,
        apart=found.x - other.x,
    )
    return replace(found, posterior=posterior)


def _fit_few(
    regression: Regression,
    dense: tuple[FloatArray, FloatArray],
    kept: BoolArray,
    signed: bool,
    noise: float | None,
    guess: Hyperparameters | None,
    centre: FloatArray | None,
) -> PriorFit:
    """Fit few samples on dense matrices, with a correlated discrepancy."""
    spec, coarse, rows = regression.matrix.spec, regression.coarse, dense[0][kept]
    dense = rows, dense[1][kept]
    y = regression.y[kept]
    scaled = _Scaled.of(
        spec, y, np.ones(y.size, dtype=np.bool_), lambda mean: rows @ mean, centre, noise
    )
    found = FewOutputs.of(spec, scaled.y, dense)
    small = found
    if coarse is not None:
        small = FewOutputs.of(coarse[0], scaled.y, (coarse[1][kept], dense[1]))
    learnt = search(small, scaled.noise, guess)
    h, plane = on_finer_plane(learnt, small.spec, spec), PlanePrior(spec)
    if small is not found:
        h = _of_best_nugget(h, lambda h: h, lambda h: likelihood_of_few(plane, found, h))
    leave_one_out, determined = _leave_one_out(plane, dense, scaled.y, h)
    return scaled.fit(
        DenseSystem(found, plane, h, signed, scaled.centre),
        lambda x: float(np.mean((scaled.y - rows @ x) ** 2)),
        np.ptp(rows, axis=0)[: spec.cells] > 0,
        y.size,
        determined,
        leave_one_out,
        learnt,
    )


def _fit_many(
    regression: Regression,
    weight: FloatArray,
    signed: bool,
    noise: float | None,
    guess: Hyperparameters | None,
    centre: FloatArray | None,
) -> PriorFit:
    """Fit samples whose discrepancy is independent, each with a weight (M,)."""
    matrix, spec, count = regression.matrix, regression.matrix.spec, float(weight.sum())
    scaled = _Scaled.of(spec, regression.y, weight > 0, matrix.forward, centre, noise)
    y, within = scaled.y, regression.within / scaled.unit**2
    small = matrix.at_most(MOST_SEARCH_BANDS)
    learnt = search(ManyOutputs.of(small, y, weight, within), scaled.noise, guess)
    h = on_finer_plane(learnt, small.spec, spec)
    if noise is None:  # independent discrepancy and independent noise are not distinguishable
        h = replace(h, discrepancy=float(np.hypot(h.discrepancy, h.noise)), noise=0.0)
    system = system_of_many(matrix, y, weight, h, signed, scaled.centre)

    def mean_square(x: FloatArray) -> float:
        return float(weight @ (y - matrix.forward(x)) ** 2 / weight.sum()) + within

    def with_variance_of_residuals(system: PriorSystem) -> PriorSystem:
        left, free = mean_square(system.mean) * count, count - system.determined
        return replace(system, h=_with_residual_variance(system.h, left, free, scaled.noise))

    if small is not matrix:
        begun = with_variance_of_residuals(system)
        system = with_variance_of_residuals(
            _of_best_nugget(begun.h, lambda h: replace(begun, h=h), lambda one: one.likelihood)
        )
    normal = None
    # Least nugget at which the distribution of the independent part matters
    if system.h.nugget >= 0.1 and spec.cells <= MOST_DENSE_CELLS:
        independent, rise = _independent_variances(system)
        if independent is not None:
            normal = system.likelihood + rise
            system = replace(system, plane=system.plane.varied(independent=independent))
            if small is not matrix:
                system = with_variance_of_residuals(system)
    determined = system.determined
    leave_one_out = None
    if y.size <= _MOST_SCREENED and (weight > 0).all():
        leave_one_out = _leave_one_out_of_many(system, regression, y)
    switched = matrix.column_squares(weight)[1][: spec.cells]
    found = scaled.fit(
        system, mean_square, switched, round(count), determined, leave_one_out, learnt
    )
    return found if normal is None else replace(found, likelihood=normal)


def _independent_variances(system: PriorSystem) -> tuple[FloatArray | None, float]:
    """Variances of the independent parts of the weights, if their distribution has heavy tails.

    Returns (K,) variances over those of the nugget, or None if the normal distribution is as
    likely; and the rise of the logarithm of the marginal likelihood. ``system`` has many samples
    and the normal prior.
    """
    usual = system.plane.nugget_variances(system.h)
    share, scale, rise = np.ones(usual.size), 1.0, -np.inf
    normal = found = system.independent_part()
    for left in range(_ROUNDS - 1, -1, -1):
        # Least squared weight, over its prior variance
        share = (scale + np.maximum(found.squares / usual, 1e-12)) / 2
        scale = 1 / float(np.mean(1 / share))
        found = replace(system, plane=system.plane.varied(independent=share)).independent_part()
        ratio, before = scale / share, rise
        spent = np.sum(1 - ratio / 2 + np.log(ratio / (2 * np.pi)) / 2)
        # Corrects the bound, which is too low for weights that no measurement determines.
        spent += (np.log(2 * np.pi) - 1) / 2 * np.sum(1 - found.determined)
        rise = found.likelihood + float(spent) - normal.likelihood
        if before > -np.inf and rise + left * max(rise - before, 0.0) <= 0:
            return None, 0.0  # the bound rises less in each round, so it stays too low
    return (share, rise) if rise > 0 else (None, 0.0)


def posterior_after(
    spec: PlaneSpec, h: Hyperparameters, dense: tuple[FloatArray, FloatArray]
) -> Posterior:
    """Posterior after measurements with these regressors and features; output range 1.

    Only its covariance is used, which does not depend on the outputs.
    """
    system = DenseSystem(
        FewOutputs.of(spec, np.zeros(dense[0].shape[0]), dense), PlanePrior(spec), h
    )
    return system.posterior(1.0, _MANY, system.determined)


def plain_posterior(regression: Regression, x: FloatArray, determined: float) -> Posterior:
    """Posterior of unknowns (n,) that were fitted without the prior, with their residuals.

    The bands have the widths of the prior on a plane of at most 50 bands, with the variance of an
    output from the residuals of the fit. If too many unknowns (at least ``determined``) are fitted
    for reliable residuals, it is the variance of the known noise, or else the variance that the
    prior has learnt. The squared difference between the fit and the mean of the prior's posterior
    is added to the variance: where the record does not determine the plane, both are guesses.
    """
    matrix = regression.matrix
    scaled, unit, middle = scale_outputs(matrix.spec, regression.y)
    # Most bands of the plane, for bands without the prior; finer bands hardly change the outputs
    small, medium = matrix.at_most(MOST_SEARCH_BANDS), matrix.at_most(50)
    # Neighbours whose errors are alike count as one sample.
    weight = regression.weight / _correlation_time(regression, x)
    within, count = regression.within / unit**2, float(weight.sum())
    off = (matrix.forward(x) - regression.y) / unit
    left = float(weight @ off**2) + within * count
    with one_thread():
        learnt = search(ManyOutputs.of(small, scaled, weight, within), None)
        evidence, plane = ManyOutputs.of(medium, scaled, weight), PlanePrior(medium.spec)
        h = on_finer_plane(learnt, small.spec, medium.spec)
        h = _with_residual_variance(h, left, count, None)
        determined = max(determined, DenseSystem(evidence, plane, h).determined)
        free, noise = count - determined, None
        # Share of the samples above which the determined unknowns leave no reliable residuals
        if determined > 0.5 * count:
            known, reproduced = regression.noise, reproduces(matrix, x, regression.y)
            if reproduced and known:
                noise = known / unit
            elif not reproduced or (known is None and free < _LEAST_FREE):
                left = max(left, max(free, 1.0) * learnt.variance)
        h = _with_residual_variance(h, left, free, noise)
        system = DenseSystem(evidence, plane, h)
        other = np.bincount(matrix.spec.sums(medium.spec), x, medium.spec.unknowns)
        if medium.spec.offset:
            other[medium.spec.cells] -= middle
        found = system.posterior(unit, round(count), determined)
        return replace(found, dense=np.column_stack([found.dense, other - unit * system.mean]))


def on_finer_plane(h: Hyperparameters, coarse: PlaneSpec, fine: PlaneSpec) -> Hyperparameters:
    """Hyperparameters of a plane from those of a coarser plane.

    The independent part of a coarse cell is the mean of the parts of its fine cells.
    """
    return replace(h, nugget=h.nugget * fine.cells / coarse.cells)


def _correlation_time(regression: Regression, x: FloatArray) -> float:
    """Number of neighbouring samples whose errors count as one; 1 for independent errors.

    It is the sum of products of the autocorrelations of residual and output, up to the first that
    is noise: correlated errors matter only if the regressors are also alike. Long records are
    condensed, so their neighbours are not known, and their errors count as independent.

    References
    ----------
    Priestley, Spectral Analysis and Time Series, 1981, section 5.3: the variance of a mean.
    """
    if regression.matrix.counts is not None:
        return 1.0
    fitted = regression.matrix.forward(x)
    left, fitted = regression.y - fitted, fitted - fitted.mean()
    squares = float(left @ left) * float(fitted @ fitted)
    total, least = 1.0, _SURE / np.sqrt(left.size)
    for lag in range(1, left.size // _MOST_ALIKE if squares else 1):
        found = float(left[lag:] @ left[:-lag]) / float(left @ left)
        if found < least:
            break
        total += 2 * found * max(float(fitted[lag:] @ fitted[:-lag]) / float(fitted @ fitted), 0.0)
    return total if total >= _ALIKE else 1.0


def _with_open_cells(system: PriorSystem, x: FloatArray, switched: BoolArray) -> PriorSystem:
    """System for the bands, with a wide prior for cells that never switched.

    The hyperparameters are learnt from the cells that the record reaches, often near the diagonal.
    In other cells, weights up to the greatest density in the record are likely, even if the
    hyperparameters say that weights decay. ``x`` (n,) are the fitted unknowns, with an output range
    of 1; ``switched`` (K,) are the cells that switch between measured samples.
    """
    plane = system.plane
    i, j = np.tril_indices(plane.spec.bands)
    inner = switched & (i != j)  # the diagonal also has reversible weights
    if switched.all() or not inner.any():
        return system
    square = np.minimum((_SQUARES * plane.middle).astype(int), _SQUARES - 1)
    place = _SQUARES * square[i] + square[j]
    weight = np.bincount(place[inner], np.abs(x[: plane.spec.cells][inner]), _SQUARES**2)
    area = np.bincount(place[inner], plane.area[inner], _SQUARES**2)
    reached = area > _REACHED / _SQUARES**2
    densest = float(np.max(weight[reached] / area[reached], initial=0.0))
    least = np.where(switched, 0.0, densest * plane.area)
    return replace(system, plane=plane.varied(least=least))


def _leave_one_out(
    plane: PlanePrior, dense: tuple[FloatArray, FloatArray], y: FloatArray, h: Hyperparameters
) -> tuple[FloatArray, float]:
    """(M,) leave-one-out residuals over their standard deviations, and the trace of the hat matrix.

    Sundararajan and Keerthi, Predictive approaches for choosing hyperparameters in Gaussian
    processes, Neural Computation 13, 2001.
    """
    rows, own = dense[0] * plane.scale(h), disturbance(dense[1], h)
    inverse = cholesky_inverse(cholesky(rows @ plane.covariance(h) @ rows.T + own))
    determined = y.size - float(np.sum(inverse * own))
    return np.asarray((inverse @ y) / np.sqrt(inverse.diagonal())), determined


def _leave_one_out_of_many(
    system: PriorSystem, regression: Regression, y: FloatArray
) -> FloatArray:
    """(M,) leave-one-out residuals over their standard deviations.

    The inverse of the covariance of the outputs is R^-1 - R^-1 A P A' R^-1 with the covariance P of
    the posterior.
    """
    left = y - regression.matrix.forward(system.mean)
    free = system.h.variance / regression.weight - system.variances(regression.matrix)
    free = np.maximum(free, _LEAST_NOISE**2)
    return np.asarray(left / np.sqrt(free))


def _of_best_nugget(
    h: Hyperparameters,
    at: Callable[[Hyperparameters], _Tried],
    likelihood: Callable[[_Tried], float],
) -> _Tried:
    """Return the fit on the fine plane with the nugget of greatest marginal likelihood.

    ``at`` returns the fit for hyperparameters that differ in the nugget. A coarse plane cannot
    distinguish independent weights from details that it does not resolve.
    """
    from scipy.optimize import minimize_scalar

    best: list[tuple[float, _Tried]] = []

    def cost(logarithm: float) -> float:
        one = at(replace(h, nugget=float(np.exp(logarithm))))
        value = likelihood(one)
        if not best or value > best[0][0]:
            best[:] = [(value, one)]
        return -value

    options: Any = {"maxiter": _NUGGET_STEPS, "xatol": _NUGGET_TOLERANCE}
    bounds = float(np.log(_LEAST_NUGGET)), float(np.log(max(h.nugget, 2 * _LEAST_NUGGET)))
    minimize_scalar(cost, bounds=bounds, method="bounded", options=options)
    return best[0][1]


def _with_residual_variance(
    h: Hyperparameters, left: float, freedom: float, noise: float | None
) -> Hyperparameters:
    """Replace discrepancy and noise by the residual variance on the fine plane.

    MacKay, Bayesian interpolation, Neural Computation 4, 1992, section 4: sum of squared residuals
    over the number of samples minus the number of well-determined unknowns.
    """
    own = 0.0 if noise is None else noise
    rest = max(left / max(freedom, 1.0) - own**2, _LEAST_NOISE**2)
    return replace(h, discrepancy=float(np.sqrt(rest)), noise=own)


def scale_outputs(spec: PlaneSpec, y: FloatArray) -> tuple[FloatArray, float, float]:
    """(M,) outputs with a range of 1, about their mean if an offset is fitted; unit and mean."""
    unit = float(np.ptp(y)) or 1.0
    shift = float(y.mean()) if spec.offset else 0.0
    return (y - shift) / unit, unit, shift
