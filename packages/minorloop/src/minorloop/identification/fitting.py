"""Fit the unknowns of a given structure to a record: with a prior, or with smoothness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, as_levels
from minorloop.errors import SignalError
from minorloop.identification.active_set import ACCEPTABLE
from minorloop.identification.condensing import LONG, Condensed, condense
from minorloop.identification.curves import Curves
from minorloop.identification.design_matrix import MOST_DENSE, DesignMatrix, PlaneSpec
from minorloop.identification.least_squares import CANDIDATES, Problem, reproduces
from minorloop.identification.posterior import Posterior, is_cheap, is_quick
from minorloop.identification.prior import Gaussian, Hyperparameters, Prior, Smooth
from minorloop.identification.prior_fit import PriorFit, Regression, fit_prior
from minorloop.identification.ridge import FEWEST_FOR_RIDGE, KINDS, PARAMETERS, Ridge, fit_ridge
from minorloop.lab.faults import FEWEST

LONGEST_LAG = 20
"""Longest lag, in samples, that ``lag="auto"`` tries."""
_LAG_BANDS = 15
_SAMPLES_EACH, _EXCITED = 3, 0.9
"""Samples for each unknown, and share of excited cells, from which smoothness replaces the prior if
the prior takes many seconds. A quick prior is used with any number of samples: on records of three
plants that no plane reproduces, with three to ten samples for each unknown, it was at most 1 %
worse than smoothing, and up to a quarter better."""
_NOISELESS = 1e-4
"""Error of a fit of many samples with the prior, in ranges, up to which a plane may reproduce them
to rounding. The prior keeps the fit about its least discrepancy away from the samples."""
_OUTLIER = 6.0
"""Standard deviations from which a sample is left out."""
_SUSPICIOUS, _LEAST_SUSPICIOUS = 0.6, 2.2
"""Suspects, to be checked by a fit without them: least deviation over that of an outlier, and in
standard deviations."""
_STEEP = 2.0
"""Slope of a steep branch, in ranges of the output over ranges of the input."""


@dataclass(frozen=True, eq=False)
class FitRecord:
    """A record to be fitted."""

    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). Inputs and outputs."""
    fitted: BoolArray
    """Shape (T,). Samples to be fitted."""
    curves: Curves
    """Where the memory is reset."""
    signed: bool
    """Whether weights and slope may be negative."""
    sd: FloatArray | None = None
    """Shape (T,). Standard deviation of each output, greater than 0; None if outputs count alike.
    """
    model_error: float = 0.0
    """Standard deviation of the error of the model itself; it is added to each ``sd``."""
    noise: float | None = None
    """Standard deviation of all outputs, if it is known and ``sd`` is None."""
    grouped: bool = False
    """Whether errors on left-out groups show how wide bands must be."""

    def without(self, sample: int) -> FitRecord:
        """Return the record without fitting this sample."""
        fitted = self.fitted.copy()
        fitted[sample] = False
        return replace(self, fitted=fitted)

    def weight(self, rows: IntArray) -> FloatArray | None:
        """Inverse variances of outputs (M,), with a mean of 1; None if outputs count alike."""
        if self.sd is None:
            return None
        weight = 1.0 / (self.sd[rows] ** 2 + self.model_error**2)
        return np.asarray(weight / weight.mean())

    def with_model_error(self, found: FittedPlane) -> FitRecord:
        """Return the record with the error of a fitted model beyond the noise of its samples."""
        rows, weight = found.regression.rows, self.weight(found.regression.rows)
        if self.sd is None or weight is None:
            return self
        off = found.regression.matrix.forward(found.x) - found.regression.y
        excess = float(np.mean(weight * (off**2 - self.sd[rows] ** 2)))
        return replace(self, model_error=float(np.sqrt(max(excess, 0.0))))

    def rows(self, lag: int) -> IntArray:
        """(M,) samples that are fitted with a lag: those from the first delayed input on."""
        return np.flatnonzero(self.left_by(lag).fitted)

    def left_by(self, lag: int) -> FitRecord:
        """Return the record without fitting the samples that a lag excludes."""
        if not lag:
            return self
        known = self.curves.positions(self.u.size) >= lag
        return replace(self, fitted=self.fitted & known)

    def regression(self, spec: PlaneSpec, lag: int, labels: IntArray | None = None) -> Regression:
        """Return the regression of the outputs on the unknowns, condensed for a long record.

        Raises a `SignalError` if the lag leaves fewer than three samples.

        Parameters
        ----------
        spec : PlaneSpec
            Structure of the model.
        lag : int
            Samples by which the output follows the input.
        labels : (T,) array of int, optional
            Samples with different labels are not condensed together.
        """
        rows = self.rows(lag)
        if rows.size < FEWEST:
            raise SignalError(
                f"a lag of {lag} leaves {rows.size} measured samples; give a shorter lag or a "
                "longer record"
            )
        inputs, places = self.curves.driven(self.u, spec.levels, lag)
        measured = np.zeros(inputs.size, dtype=np.bool_)
        measured[places[rows]] = True
        short = self._condensed(spec, inputs, places, measured, labels)
        if short is not None:
            matrix = DesignMatrix(spec, short.u, short.measured, "negative", short.counts)
            row = np.searchsorted(places, short.rows)
            return Regression(matrix, short.y, row, short.within, self.noise)
        matrix = DesignMatrix(spec, inputs, measured, self.curves.start, self.weight(rows))
        noise = self.noise
        if self.sd is not None:  # noise of an output with a weight of 1
            noise = float(np.mean(self.sd[rows] ** -2.0) ** -0.5)
        return Regression(matrix, self.y[rows], rows, noise=noise)

    def _condensed(
        self,
        spec: PlaneSpec,
        inputs: FloatArray,
        places: IntArray,
        measured: BoolArray,
        labels: IntArray | None,
    ) -> Condensed | None:
        if np.count_nonzero(measured) < LONG or self.sd is not None:
            return None
        y = self.y
        if inputs.size != y.size:
            y = np.full(inputs.size, np.nan)
            y[places] = self.y
            if labels is not None:
                everywhere = np.full(inputs.size, -1)
                everywhere[places] = labels
                labels = everywhere
        return condense(spec.levels, self.curves.start, inputs, y, measured, labels)


@dataclass(frozen=True, eq=False)
class FittedPlane:
    """Unknowns, with the samples and the options of the fit, and the outliers.

    ``learnt`` are the hyperparameters on the coarse plane; None without the prior.
    """

    x: FloatArray
    kkt: float
    regression: Regression
    fitted: BoolArray
    prior: Prior
    smoothness: float = 0.0
    posterior: Posterior | None = None
    suspects: tuple[int, ...] = ()
    converged: bool = True
    ridge: Ridge | None = None
    learnt: Hyperparameters | None = None

    def without(self, left: BoolArray, record: FitRecord) -> FloatArray:
        """Unknowns fitted in the same way to samples of the record other than ``left`` (M,).

        Smoothness or hyperparameters are chosen again, because the first ones know ``left``.
        """
        matrix, y, kept = self.regression.matrix, self.regression.y, ~left
        if self.learnt is not None:
            return _with_prior(self.regression, record, self.learnt, kept=kept).x
        problem = Problem(matrix, y, record.signed)
        # Not from the fit to all rows: undetermined cells would keep its knowledge of ``left``.
        chosen = _strength(self.prior) == "auto"
        return problem.fit_part(kept, CANDIDATES if chosen else (self.smoothness,))


def fit_plane(
    spec: PlaneSpec,
    record: FitRecord,
    lag: int,
    prior: Prior,
    labels: IntArray | None = None,
    say: Callable[[str], None] = lambda stage: None,
) -> FittedPlane:
    """Fit with the prior or with smoothness; fit again if a model error adds to the noise."""
    found = _fit_once(spec, record, lag, prior, labels, say)
    better = record.with_model_error(found)
    return found if better is record else _fit_once(spec, better, lag, prior, labels, say)


def _fit_once(
    spec: PlaneSpec,
    record: FitRecord,
    lag: int,
    prior: Prior,
    labels: IntArray | None,
    say: Callable[[str], None],
) -> FittedPlane:
    regression = record.regression(spec, lag, labels)
    if isinstance(prior, Gaussian):
        return _fit_with_prior(regression, record, lag, prior)
    if isinstance(prior, Smooth):
        return _smooth(regression, record, prior, say)
    if not _takes_prior(regression):
        return _smooth(regression, record, prior if spec.bands <= MOST_DENSE else Smooth(0.0), say)
    found = _fit_with_prior(regression, record, lag, prior)
    samples = regression.matrix.measurements
    off = np.sqrt(regression.squared_error(found.x) / samples)
    close = off <= _NOISELESS * np.ptp(regression.y) or are_few(spec, samples)
    if samples < spec.unknowns or not close:
        return found
    plain = _smooth(regression, record, Smooth(0.0), say)
    return plain if reproduces(regression.matrix, plain.x, regression.y) else found


def _takes_prior(regression: Regression) -> bool:
    """Whether the prior is quick, or needed and not slow."""
    matrix = regression.matrix
    return is_quick(matrix) and (_needs_prior(regression) or is_cheap(matrix))


def _needs_prior(regression: Regression) -> bool:
    """Whether the samples are few for the unknowns, or leave much of the plane undetermined."""
    matrix = regression.matrix
    excited = np.count_nonzero(matrix.excited) / matrix.spec.cells
    return bool(excited < _EXCITED) or are_few(matrix.spec, matrix.measurements)


def are_few(spec: PlaneSpec, samples: int) -> bool:
    """Whether the samples are few for the unknowns."""
    return samples < _SAMPLES_EACH * spec.unknowns


def fit_smooth(
    spec: PlaneSpec,
    record: FitRecord,
    lag: int,
    smoothness: float | Literal["auto"],
) -> FittedPlane:
    """Fit with smoothness."""
    return _smooth(record.regression(spec, lag), record, Smooth(smoothness))


def _smooth(
    regression: Regression,
    record: FitRecord,
    prior: Prior,
    say: Callable[[str], None] = lambda stage: None,
) -> FittedPlane:
    problem = Problem(regression.matrix, regression.y, record.signed, say)
    fit = problem.fit(_strength(prior))
    return FittedPlane(
        fit.x, fit.kkt, regression, record.fitted, prior, fit.smoothness, converged=fit.converged
    )


def _strength(prior: Prior) -> float | Literal["auto"]:
    return prior.strength if isinstance(prior, Smooth) else "auto"


def _fit_with_prior(
    regression: Regression, record: FitRecord, lag: int, prior: Prior
) -> FittedPlane:
    """Fit, and leave outliers out."""
    found, ridge = _with_prior(regression, record), None
    if isinstance(prior, Gaussian) and prior.mean == "ridge":
        found, ridge = _with_ridge(found, regression, record)
    suspects = tuple[int, ...]()
    if are_few(regression.matrix.spec, regression.rows.size):  # among many, one has little weight
        suspects, record, regression, found = _without_outliers(record, regression, found, lag)
    return FittedPlane(
        found.x,
        found.kkt,
        regression,
        record.fitted,
        prior,
        posterior=found.posterior,
        suspects=suspects,
        converged=found.kkt <= ACCEPTABLE,
        ridge=ridge,
        learnt=found.learnt,
    )


def _without_outliers(
    record: FitRecord, regression: Regression, found: PriorFit, lag: int
) -> tuple[tuple[int, ...], FitRecord, Regression, PriorFit]:
    """Leave out one outlier after the other, but keep all samples if two outliers are neighbours.

    Outliers are isolated; neighbours with large errors mean that a plane cannot follow the branch.
    """
    whole, suspects = (record, regression, found), list[int]()
    spec, centre = regression.matrix.spec, found.posterior.centre
    inputs = record.curves.delayed(record.u, lag)
    # One sample in eight may be an outlier; more are not outliers
    while len(suspects) < regression.rows.size // 8:
        worst = _suspect(found, on_steep_branch(record)[regression.rows])
        if worst is None:
            break
        sample = int(regression.rows[worst])
        others = record.without(sample)
        reduced = others.regression(spec, lag)
        without = _with_prior(reduced, others, found.learnt, centre)
        if not _is_outlier(without, regression, worst):
            break
        if any(_on_one_branch(spec, inputs, sample, other) for other in suspects):
            return (), *whole
        suspects.append(sample)
        record, regression, found = others, reduced, without
    return tuple(suspects), record, regression, found


def _on_one_branch(spec: PlaneSpec, u: FloatArray, one: int, other: int) -> bool:
    """Whether two samples are neighbours on a branch, less than a mean band apart."""
    first, last = min(one, other), max(one, other)
    steps = np.diff(u[first : last + 1])
    band = float(spec.levels[-1] - spec.levels[0]) / spec.bands
    # Two outliers on one branch that are this close are not outliers
    return last - first <= 2 and 0 < np.abs(steps.sum()) == np.abs(steps).sum() < band


def _with_ridge(
    plain: PriorFit, regression: Regression, record: FitRecord
) -> tuple[PriorFit, Ridge | None]:
    """Return the best fit and its ridge, after comparing ridges as the mean of the prior, and none.

    Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978: each parameter of a
    ridge must raise the logarithm of the likelihood by half that of the number of samples.
    """
    best, chosen, least = plain, None, plain.likelihood
    if regression.rows.size < FEWEST_FOR_RIDGE:
        return plain, None
    penalty = PARAMETERS * np.log(regression.rows.size) / 2
    for kind in KINDS:
        fitted = fit_ridge(regression.matrix, regression.y, (kind,))
        found = _with_prior(regression, record, plain.learnt, fitted.x)
        if found.likelihood - penalty > least:
            best, chosen, least = found, fitted.ridge, found.likelihood - penalty
    return best, chosen


def _with_prior(
    regression: Regression,
    record: FitRecord,
    guess: Hyperparameters | None = None,
    centre: FloatArray | None = None,
    kept: BoolArray | None = None,
) -> PriorFit:
    return fit_prior(
        regression,
        signed=record.signed,
        noise=record.noise,
        guess=guess,
        centre=centre,
        kept=kept,
        independent=record.grouped or kept is not None,  # a part is fitted for its mean
    )


def _suspect(found: PriorFit, plausible: BoolArray) -> int | None:
    """Number of the sample farthest from a fit without it; None if no sample is far."""
    if found.leave_one_out is None:
        return None
    off = np.where(plausible, 0.0, np.abs(found.leave_one_out))
    worst = int(np.argmax(off))
    # An outlier also increases the estimated standard deviation.
    least = _OUTLIER / np.sqrt(1 + _OUTLIER**2 / off.size)
    return worst if off[worst] >= max(_SUSPICIOUS * least, _LEAST_SUSPICIOUS) else None


def _is_outlier(without: PriorFit, regression: Regression, sample: int) -> bool:
    """Whether a sample lies far outside the band of a fit without it."""
    h, unit = without.posterior.hyperparameters, without.posterior.unit
    matrix = regression.matrix
    at_sample = np.zeros(matrix.inputs.size, dtype=np.bool_)
    at_sample[np.flatnonzero(matrix.sampled)[sample]] = True
    deviation = without.posterior.deviation(matrix.inputs, matrix.start, at_sample)[0]
    off = float(matrix.forward(without.x)[sample] - regression.y[sample])
    own = h.noise * unit / (1.0 if matrix.counts is None else np.sqrt(matrix.counts[sample]))
    return abs(off) > _OUTLIER * float(np.hypot(deviation, own))


def on_steep_branch(record: FitRecord) -> BoolArray:
    """(T,) samples on steep branches whose input and output lie between those of their neighbours.

    Such a sample may be far from the prediction, but it is not an outlier.
    """
    y = np.where(record.fitted, record.y, np.nan)
    between = np.zeros(y.size, dtype=np.bool_)
    inputs, outputs = np.diff(record.u), np.diff(y)
    ratio = float(np.nanmax(y) - np.nanmin(y)) / (float(np.ptp(record.u)) or 1.0)
    steep = np.abs(outputs[1:] + outputs[:-1]) >= _STEEP * ratio * np.abs(inputs[1:] + inputs[:-1])
    # Ratio of the output step after or before a jump to the jump, up to which the output rests
    least = -0.1 * np.maximum(outputs[1:] ** 2, outputs[:-1] ** 2)
    between[1:-1] = (inputs[1:] * inputs[:-1] > 0) & (outputs[1:] * outputs[:-1] >= least) & steep
    begins = record.curves.begins
    between[np.concatenate([begins, np.maximum(begins - 1, 0)])] = False
    return between


def best_lag(spec: PlaneSpec, record: FitRecord) -> int:
    """Lag with the least error of a coarse fit, on the samples that all lags share."""
    coarse = coarser_spec(spec, _LAG_BANDS)
    lengths = np.diff([*record.curves.begins, record.u.size])
    longest = min(LONGEST_LAG, int(np.median(lengths)) // 4)  # a lag excludes the first rows
    shared = record.fitted & (record.curves.positions(record.u.size) >= longest)
    if np.count_nonzero(shared) < FEWEST:
        return 0
    common = replace(record, fitted=shared)
    errors, x = list[float](), None
    for lag in range(longest + 1):
        regression = common.regression(coarse, lag)
        problem = Problem(regression.matrix, regression.y, common.signed, rough=True)
        x = problem.fit_part(np.ones(regression.y.size, dtype=np.bool_), (0.0,), x)
        errors.append(regression.squared_error(x))
    return int(np.argmin(errors))


def coarser_spec(spec: PlaneSpec, bands: int) -> PlaneSpec:
    """Return the structure on at most ``bands`` bands, over the same range."""
    if spec.bands <= bands:
        return spec
    places = np.linspace(0, spec.bands, bands + 1)
    levels = as_levels(np.interp(places, np.arange(spec.bands + 1), spec.levels))
    return PlaneSpec(levels, spec.relay, spec.diagonal, spec.offset, spec.slope)
