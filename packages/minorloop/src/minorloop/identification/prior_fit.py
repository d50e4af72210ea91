"""Fit the unknowns of a plane with the prior.

The cost is (y - A x)' R^-1 (y - A x) + (x - m)' S^-1 (x - m), with weights x that are not negative,
regressors A, prior mean m (zero, or a ridge) and covariance S, and covariance R of discrepancy plus
noise. Few samples are fitted on dense
matrices, with a correlated discrepancy; many on the sparse system of `everett_system` where the
branches of the record are long, and on dense normal equations otherwise.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.heavy_tails import ROUGH, independent_variances
from minorloop.identification.likelihood import (
    MOST_SEARCH_BANDS,
    Evidence,
    cholesky,
    cholesky_inverse,
    disturbance,
    likelihood_of_few,
    regressors,
    search,
)
from minorloop.identification.posterior import Posterior
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.identification.prior_system import (
    MOST_DENSE_CELLS,
    PriorSystem,
    dense_system,
    systems,
)
from minorloop.operators.memory import Start
from minorloop.threads import one_thread

System = TypeVar("System", bound=PriorSystem)

MOST_CORRELATED = 100
"""Samples up to which the discrepancy is correlated. Along the branches of a longer record, a
correlated discrepancy would explain what the weights can."""
MOST_SCREENED = 400
"""Samples up to which leave-one-out residuals are computed."""
MANY = 10**9
"""Number of samples that stands for hyperparameters that are given, not learnt."""
_LEAST_NOISE = 1e-6
_ALIKE, _MOST_ALIKE, _SURE = 1.5, 10, 3.0
"""Correlation time from which errors are not independent, its largest lag as a share of the
samples, one in so many, and standard deviations of an autocorrelation that is no noise."""
_REFINEMENTS = 2
_SQUARES, _REACHED = 8, 0.1
"""Squares across the plane over which densities are averaged, so that single rough cells do not
count; and share of a square that the record must have switched."""
_LEAST_NUGGET, _NUGGET_STEPS, _NUGGET_TOLERANCE = 1e-3, 6, 0.5
"""Least nugget, most steps of the search for it, and tolerance of its logarithm."""


@dataclass(frozen=True, eq=False)
class PriorFit:
    """Fitted unknowns, the violation of the optimality conditions, and the posterior."""

    x: FloatArray
    kkt: float
    posterior: Posterior
    leave_one_out: FloatArray | None
    """(M,) standardised leave-one-out residuals; None for more than `MOST_SCREENED` samples."""
    learnt: Hyperparameters
    """Result of the search, on a coarse plane."""
    likelihood: float
    """Logarithm of the marginal likelihood of the scaled outputs, up to a constant."""


def fit_prior(
    matrix: DesignMatrix,
    y: FloatArray,
    dense: tuple[FloatArray, FloatArray] | None,
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
    within: float = 0.0,
    centre: FloatArray | None = None,
    kept: BoolArray | None = None,
    independent: bool = False,
) -> PriorFit:
    """Fit the unknowns with the prior.

    Parameters
    ----------
    matrix : DesignMatrix
        Regressors of M measurements.
    y : (M,) array
        Outputs.
    dense : tuple, optional
        What `regressors` gives, for few samples.
    signed : bool
        Let weights and slope be negative.
    noise : float, optional
        Standard deviation of a measured output, in its unit; learnt if not given.
    guess : Hyperparameters, optional
        Start of the search.
    coarse : tuple, optional
        What `coarse_rows` gives; with ``dense`` only.
    within : float
        Mean square of the outputs about the condensed ones, in squared units.
    centre : (n,) array, optional
        Mean of the prior; zero if not given.
    kept : (M,) array of bool, optional
        Measurements that are fitted, and that the hyperparameters are learnt from; all if not
        given.
    independent : bool
        Take the errors of neighbouring samples for independent.

    Notes
    -----
    Where neighbouring errors of many samples are alike, the bands are those of a fit to fewer
    independent samples. The unknowns are not: most such errors of real records are hysteresis that
    the model lacks, and more of the prior would only add to them.
    """
    if dense is not None and kept is not None:
        y, dense = y[kept], (dense[0][kept], dense[1][kept])
        coarse = None if coarse is None else (coarse[0], coarse[1][kept])
    if dense is not None:
        return fit_few(
            matrix.spec,
            y,
            dense,
            signed=signed,
            noise=noise,
            guess=guess,
            coarse=coarse,
            centre=centre,
        )
    weight = np.ones(y.size) if matrix.counts is None else matrix.counts
    weight = weight if kept is None else weight * kept
    with one_thread():
        found = _fit_many(matrix, y, weight, signed, noise, guess, within, centre)
        together = 1.0 if independent else correlation_time(matrix, y, found.x)
        if together == 1.0:
            return found
        weight = weight / together
        other = _fit_many(matrix, y, weight, signed, noise, found.learnt, within, centre)
    posterior = replace(
        other.posterior,
        determined=found.posterior.determined,
        samples=found.posterior.samples,
        apart=found.x - other.x,
    )
    return replace(found, posterior=posterior)


def is_few(spec: PlaneSpec, samples: int) -> bool:
    """Whether samples are so few that their discrepancy is correlated."""
    return samples <= MOST_CORRELATED and spec.cells <= MOST_DENSE_CELLS


def fit_few(
    spec: PlaneSpec,
    y: FloatArray,
    dense: tuple[FloatArray, FloatArray],
    *,
    signed: bool = False,
    noise: float | None = None,
    guess: Hyperparameters | None = None,
    coarse: tuple[PlaneSpec, FloatArray] | None = None,
    centre: FloatArray | None = None,
) -> PriorFit:
    """Fit few samples, with correlated discrepancy; parameters as of `fit_prior`.

    Where ``coarse`` is given, the hyperparameters are searched on that plane.
    """
    scaled, unit, shift = scale_outputs(spec, y)
    mean = _scaled_centre(spec, centre, unit, shift)
    scaled = scaled - dense[0] @ mean
    with one_thread():
        found = Evidence.of_few(spec, scaled, dense)
        small = found
        if coarse is not None:
            small = Evidence.of_few(coarse[0], scaled, (coarse[1], dense[1]))
        learnt = search(small, _scaled_noise(noise, unit), guess)
        h, plane = on_finer_plane(learnt, small.spec, spec), PlanePrior(spec)
        if small is not found:
            h = _with_best_nugget(h, lambda h: likelihood_of_few(plane, found, h))
        leave_one_out, determined = _leave_one_out(plane, dense, scaled, h)
        h, x, kkt, system, likelihood = _solve(
            lambda h: dense_system(plane, found, h, signed, mean),
            h,
            lambda x: float(np.mean((scaled - dense[0] @ x) ** 2)),
        )
        switched = np.ptp(dense[0], axis=0)[: spec.cells] > 0
        system = with_open_cells(system, spec, x + mean, switched)
        posterior = system.posterior(unit, y.size, determined)
    posterior = replace(posterior, centre=centre)
    x = _unscaled(spec, x + mean, unit, shift)
    return PriorFit(x, kkt, posterior, leave_one_out, learnt, likelihood)


def on_finer_plane(h: Hyperparameters, coarse: PlaneSpec, fine: PlaneSpec) -> Hyperparameters:
    """Hyperparameters of a plane from those of a coarser one.

    The independent part of a coarse cell is the mean of those of its fine cells.
    """
    return replace(h, nugget=h.nugget * fine.cells / coarse.cells)


def correlation_time(matrix: DesignMatrix, y: FloatArray, x: FloatArray) -> float:
    """Number of neighbouring samples whose errors count as one; 1 for independent errors.

    It is the sum of products of the autocorrelations of residual and output, up to the first that
    is noise: correlated errors matter where the regressors are alike too. Long records are
    condensed, so that their neighbours are not known; their errors count as independent.

    References
    ----------
    Priestley, Spectral Analysis and Time Series, 1981, section 5.3: the variance of a mean.
    """
    if matrix.counts is not None:
        return 1.0
    fitted = matrix.forward(x)
    left, fitted = y - fitted, fitted - fitted.mean()
    squares = float(left @ left) * float(fitted @ fitted)
    total, least = 1.0, _SURE / np.sqrt(left.size)
    for lag in range(1, left.size // _MOST_ALIKE if squares else 1):
        found = float(left[lag:] @ left[:-lag]) / float(left @ left)
        if found < least:
            break
        total += 2 * found * max(float(fitted[lag:] @ fitted[:-lag]) / float(fitted @ fitted), 0.0)
    return total if total >= _ALIKE else 1.0


def _fit_many(
    matrix: DesignMatrix,
    y: FloatArray,
    weight: FloatArray,
    signed: bool,
    noise: float | None,
    guess: Hyperparameters | None,
    within: float,
    centre: FloatArray | None,
) -> PriorFit:
    spec = matrix.spec
    _, unit, shift = scale_outputs(spec, y[weight > 0])
    scaled = (y - shift) / unit
    known, within = _scaled_noise(noise, unit), within / unit**2
    mean = _scaled_centre(spec, centre, unit, shift)
    if centre is not None:
        scaled = scaled - matrix.forward(mean)
    small = matrix.at_most(MOST_SEARCH_BANDS)
    learnt = search(Evidence.of_many(small, scaled, weight, within), known, guess)
    h = on_finer_plane(learnt, small.spec, spec)
    if known is None:  # where both are independent, one is not told from the other
        h = replace(h, discrepancy=float(np.hypot(h.discrepancy, h.noise)), noise=0.0)
    system_at = systems(matrix, scaled, weight, signed, mean)

    def mean_square(x: FloatArray) -> float:
        return float(weight @ (scaled - matrix.forward(x)) ** 2 / weight.sum()) + within

    def with_variance_of_residuals(h: Hyperparameters) -> Hyperparameters:
        system, count = system_at(h), float(weight.sum())
        left = mean_square(system.mean) * count
        return with_residual_variance(h, left, count - system.determined, known)

    if small is not matrix:
        h = with_variance_of_residuals(h)
        h = _with_best_nugget(h, lambda h: system_at(h).likelihood)
        h = with_variance_of_residuals(h)
    normal = None
    if h.nugget >= ROUGH and spec.cells <= MOST_DENSE_CELLS:
        independent, rise = independent_variances(system_at.evidence, h)
        if independent is not None:
            normal = system_at(h).likelihood + rise
            system_at = system_at.with_independent(independent)
            if small is not matrix:
                h = with_variance_of_residuals(h)
    determined = system_at(h).determined
    leave_one_out = None
    if y.size <= MOST_SCREENED and (weight > 0).all():
        leave_one_out = _leave_one_out_of_many(system_at(h), h, matrix, scaled)
    h, x, kkt, system, likelihood = _solve(system_at, h, mean_square)
    likelihood = likelihood if normal is None else normal
    switched = matrix.column_squares(weight)[1][: spec.cells]
    system = with_open_cells(system, spec, x + mean, switched)
    posterior = system.posterior(unit, round(weight.sum()), determined)
    posterior = replace(posterior, centre=centre)
    x = _unscaled(spec, x + mean, unit, shift)
    return PriorFit(x, kkt, posterior, leave_one_out, learnt, likelihood)


def posterior_after(
    spec: PlaneSpec, h: Hyperparameters, dense: tuple[FloatArray, FloatArray]
) -> Posterior:
    """Posterior after measurements with these regressors and features; output range 1.

    Its mean is not used: the covariance does not depend on the outputs.
    """
    found = Evidence.of_few(spec, np.zeros(dense[0].shape[0]), dense)
    system = dense_system(PlanePrior(spec), found, h, signed=True)
    return system.posterior(1.0, MANY, system.determined)


def coarse_rows(
    matrix: DesignMatrix, u: FloatArray, measured: BoolArray, start: Start
) -> tuple[PlaneSpec, FloatArray] | None:
    """Plane that is coarse enough to search hyperparameters on, and its regressors.

    None if the plane of ``matrix`` is coarse enough.
    """
    small = matrix.at_most(MOST_SEARCH_BANDS)
    return None if small is matrix else (small.spec, regressors(small.spec, u, measured, start)[0])


def _solve(
    system_at: Callable[[Hyperparameters], PriorSystem],
    h: Hyperparameters,
    mean_square: Callable[[FloatArray], float],
) -> tuple[Hyperparameters, FloatArray, float, PriorSystem, float]:
    """Fit under the sign constraints, and raise the discrepancy to the residuals that are left.

    The likelihood is that of the hyperparameters that are given.
    """
    system = system_at(h)
    likelihood = system.likelihood
    x, kkt = system.bounded()
    for _ in range(_REFINEMENTS):
        raised = _with_residual_discrepancy(h, mean_square(x))
        if raised is h:
            break
        h = raised
        system = system_at(h)
        x, kkt = system.bounded(x)
    return h, x, kkt, system, likelihood


def with_open_cells(system: System, spec: PlaneSpec, x: FloatArray, switched: BoolArray) -> System:
    """System for the bands, whose prior knows little of cells that never switched.

    The hyperparameters are learnt where the record reaches, often near the diagonal. Beyond, any
    weight up to the greatest density that the record shows is as likely, whatever their decay.

    Parameters
    ----------
    system : PriorSystem
        System of the fit.
    spec : PlaneSpec
        The unknowns (n,): K packed weights, offset, slope.
    x : (n,) array
        Fitted unknowns, with an output range of 1.
    switched : (K,) array of bool
        Cells that switch between measured samples.
    """
    i, j = np.tril_indices(spec.bands)
    seen = switched & (i != j)  # the diagonal has reversible weights too
    if switched.all() or not seen.any():
        return system
    plane = PlanePrior(spec)
    square = np.minimum((_SQUARES * plane.middle).astype(int), _SQUARES - 1)
    place = _SQUARES * square[i] + square[j]
    weight = np.bincount(place[seen], np.abs(x[: spec.cells][seen]), _SQUARES**2)
    area = np.bincount(place[seen], plane.area[seen], _SQUARES**2)
    reached = area > _REACHED / _SQUARES**2
    densest = float(np.max(weight[reached] / area[reached], initial=0.0))
    return system.widened(np.where(switched, 0.0, densest * plane.area))


def _leave_one_out(
    plane: PlanePrior,
    dense: tuple[FloatArray, FloatArray],
    y: FloatArray,
    h: Hyperparameters,
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
    system: PriorSystem, h: Hyperparameters, matrix: DesignMatrix, y: FloatArray
) -> FloatArray:
    """(M,) leave-one-out residuals over their standard deviations.

    The inverse of the covariance of the outputs is R^-1 - R^-1 A P A' R^-1 with the covariance P of
    the posterior.
    """
    counts = 1.0 if matrix.counts is None else matrix.counts
    own = (h.noise**2 + h.discrepancy**2) / counts
    left = y - matrix.forward(system.mean)
    free = np.maximum(own - system.variances(matrix), _LEAST_NOISE**2)
    return np.asarray(left / np.sqrt(free))


def _with_best_nugget(
    h: Hyperparameters, likelihood_at: Callable[[Hyperparameters], float]
) -> Hyperparameters:
    """Nugget of greatest marginal likelihood on the fine plane.

    A coarse plane cannot tell independent weights from what it does not resolve.
    """
    from scipy.optimize import minimize_scalar

    def cost(logarithm: float) -> float:
        return -likelihood_at(replace(h, nugget=float(np.exp(logarithm))))

    options: Any = {"maxiter": _NUGGET_STEPS, "xatol": _NUGGET_TOLERANCE}
    bounds = float(np.log(_LEAST_NUGGET)), float(np.log(max(h.nugget, 2 * _LEAST_NUGGET)))
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options=options)
    return replace(h, nugget=float(np.exp(found.x)))


def with_residual_variance(
    h: Hyperparameters, left: float, freedom: float, noise: float | None
) -> Hyperparameters:
    """Replace discrepancy and noise by the residual variance on the fine plane.

    MacKay, Bayesian interpolation, Neural Computation 4, 1992, section 4: sum of squared residuals
    over the number of samples less the number of well-determined unknowns.
    """
    own = 0.0 if noise is None else noise
    rest = max(left / max(freedom, 1.0) - own**2, _LEAST_NOISE**2)
    return replace(h, discrepancy=float(np.sqrt(rest)), noise=own)


def _with_residual_discrepancy(h: Hyperparameters, mean_square: float) -> Hyperparameters:
    """Raise the discrepancy to the mean square of the residuals, if it is less.

    The likelihood ignores the sign constraints: it explains a falling output by negative weights,
    and then underestimates the discrepancy.
    """
    rest = mean_square - h.noise**2
    if rest <= h.discrepancy**2:
        return h
    return replace(h, discrepancy=float(np.sqrt(rest)))


def scale_outputs(spec: PlaneSpec, y: FloatArray) -> tuple[FloatArray, float, float]:
    """(M,) outputs with a range of 1, about their mean where an offset is fitted; unit and mean."""
    unit = float(np.ptp(y)) or 1.0
    shift = float(y.mean()) if spec.offset else 0.0
    return (y - shift) / unit, unit, shift


def _unscaled(spec: PlaneSpec, x: FloatArray, unit: float, shift: float) -> FloatArray:
    x = x * unit
    if spec.offset:
        x[spec.cells] += shift
    return x


def _scaled_centre(
    spec: PlaneSpec, centre: FloatArray | None, unit: float, shift: float
) -> FloatArray:
    """(n,) mean of the prior for scaled outputs."""
    if centre is None:
        return np.zeros(spec.unknowns)
    mean = centre / unit
    if spec.offset:
        mean[spec.cells] -= shift / unit
    return mean


def _scaled_noise(noise: float | None, unit: float) -> float | None:
    return None if noise is None else max(noise / unit, _LEAST_NOISE)
