"""A plane fitted to a record: the scores, advice and bands of a Preisach model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, overload

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, Samples
from minorloop.errors import counted
from minorloop.identification import advising, diagnosis, residuals
from minorloop.identification.accuracy import CurveAccuracy, by_curve
from minorloop.identification.band_model import BandModel, within_cells
from minorloop.identification.bands import BAND, PER_DEVIATION, Prediction, as_probability
from minorloop.identification.baseline import nrmse, percent, polynomial_nrmse
from minorloop.identification.choosing import FEWEST_GROUPS, Choice, folds
from minorloop.identification.curves import Curves, as_curves
from minorloop.identification.design_matrix import DesignMatrix
from minorloop.identification.jumps import Jump
from minorloop.identification.model_error import FEWEST, ModelError, contiguous_parts, learn
from minorloop.identification.posterior import Posterior
from minorloop.identification.preparation import RecordAdvice
from minorloop.identification.prior_fit import Regression, plain_posterior
from minorloop.identification.residuals import ResidualSummary
from minorloop.identification.result import (
    ERRORS,
    MORE_ERRORS,
    Fit,
    Rule,
    ScoreRow,
    if_finite,
    of_range,
    unless_0,
)
from minorloop.identification.ridge import Ridge
from minorloop.identification.rough_model import Basis, few, one_of_each
from minorloop.identification.screening import record_faults
from minorloop.lab.faults import Fault
from minorloop.lab.holds import looks_like_raw_log
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach


def _holds(numbers: tuple[int, ...]) -> str:
    return ", ".join(f"hold {number + 1}" for number in numbers)


def _lag(fit: Identification) -> str:
    seconds = f", {fit.lag_seconds:.4g} s" if fit.lag_seconds else ""
    return f"{counted(fit.lag_of_model, 'sample')}{seconds}"


def _known_rank(fit: Identification) -> int | None:
    """Return the rank if it is known or quickly computed."""
    # Unknowns up to which the rank is computed without a request. 3000 take 40 s, and the time
    # grows with their cube.
    known = "_rank_and_condition" in fit.__dict__ or fit.unknowns <= 3000
    return fit.rank if known else None


def _optimality(fit: Identification) -> str:
    return f"{fit.kkt:.1e}{'' if fit.converged else ', not converged'}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Identification(Fit[Preisach]):
    """A Preisach model identified from a record."""

    HEADLINE: ClassVar[str] = "{output} against {input}: Preisach, {fit.model.bands} bands"
    CAPTION: ClassVar[str] = (
        "Measured loop with the model; density on the Preisach plane, cells that the record does "
        "not excite in grey, through which the assumption of a prior shows; the record in time, "
        "with held-out samples shaded; the residual in time, with the band in which 90 % of the "
        "readings should lie; its size by the amplitude and by the rate of the input."
    )
    WARNINGS: ClassVar[tuple[Rule, ...]] = advising.WARNINGS
    REMARKS: ClassVar[tuple[Rule, ...]] = advising.REMARKS
    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        *ERRORS,
        ScoreRow("nrmse_groups", "groups_nrmse", "error on left-out groups", of_range),
        ScoreRow(
            "baseline_nrmse", "baseline_nrmse", "best delayed polynomial", of_range, kept=True
        ),
        ScoreRow("", _lag, "lag"),
        ScoreRow("samples", "samples", "samples fitted"),
        *MORE_ERRORS,
        ScoreRow("rmse_train", "rmse", "rms error on fitted data", "{:.4g}"),
        ScoreRow("baseline_nrmse_holdout", lambda fit: fit.holdout_accuracy and fit.baseline_nrmse),
        ScoreRow("lag_samples", "lag_of_model"),
        ScoreRow("lag_s", lambda fit: fit.lag_seconds or None),
        ScoreRow("held_out", lambda fit: int(fit.held_out.sum()), "samples held out", unless_0),
        ScoreRow("skipped", "skipped", "rows skipped", unless_0),
        ScoreRow("left_out", "of_record.not_fitted", "outliers not fitted", _holds),
        ScoreRow("jumps", "jumps", "jumps at", lambda jumps: ", ".join(map(str, jumps))),
        ScoreRow("ridge", "ridge", "mean of the prior", "{.kind} ridge"),
        ScoreRow("prior", lambda fit: "none" if fit.posterior is None else "gaussian"),
        ScoreRow("smoothness", "smoothness"),
        ScoreRow("", lambda fit: None if fit.posterior else fit.smoothness, "smoothness", "{:g}"),
        ScoreRow("unknowns", "unknowns", "unknowns"),
        ScoreRow("free_parameters", "free_parameters", "free parameters", kept=True),
        ScoreRow(
            "effective_parameters",
            "effective_parameters",
            "effective parameters",
            "{:.1f}",
            kept=True,
        ),
        ScoreRow("rank", _known_rank, "rank", absent="not computed; fit.rank is", slow=True),
        ScoreRow("condition", lambda fit: fit.condition if _known_rank(fit) is not None else None),
        ScoreRow("levels", "model.bands"),
        ScoreRow("range", "model.range"),
        ScoreRow("excited_fraction", "excited_fraction", "cells excited", "{:.0%}"),
        ScoreRow("kkt", "kkt", kept=True),
        ScoreRow("", _optimality, "optimality (KKT)"),
        ScoreRow("residual", "residual"),
        ScoreRow("", "residual.startup", "start-up", lambda one: counted(one.rows, "row")),
        ScoreRow("", "residual.autocorrelation", "residual autocorrelation", if_finite),
        ScoreRow("band_sd", "band_sd", "standard deviation predicted", "{:.3g}", slow=True),
        ScoreRow("", "_coverage", "within 90 % bands", "{0[0]:.0%} of {0[1]} readings", slow=True),
        ScoreRow("", "_coverage", "mean half width of these", "{0[2]:.4g}", slow=True),
        ScoreRow("curves", "curve_accuracy"),
        ScoreRow("choices", "choices"),
        ScoreRow("chosen", "chosen"),
        ScoreRow("codes", lambda fit: [k for fault in fit.codes for k in fault.samples]),
        ScoreRow("suspects", "suspects"),
        ScoreRow("sd", "of_record.sd"),
    )

    smoothness: float
    """Strength that was used."""
    kkt: float
    """Largest violation of the optimality conditions, relative to the norm of the output."""
    regression: Regression
    """Regressors and outputs of the fitted samples."""
    posterior: Posterior | None = None
    """Posterior distribution of the unknowns; None without the prior."""
    suspects: tuple[int, ...] = ()
    """Samples far outside the band of a fit without them; they were not fitted."""
    codes: tuple[Fault, ...] = ()
    """Readings that are overload codes or sentinels, and count as not measured."""
    searched: bool = False
    """Whether the lag was searched."""
    converged: bool = True
    """Whether the solver reached the optimum; `advice` says so where it did not."""
    left_out: FloatArray | None = None
    """Shape (T,). Output of each fitted row, predicted by a fit without its group; None without
    groups."""
    groups: IntArray | None = None
    """Shape (T,). Number of the group of each row; None without groups."""
    interval: float | None = None
    """Sampling interval in seconds, if it is known."""
    skipped: int = 0
    """Rows that set the memory and were not fitted."""
    choices: tuple[Choice, ...] = ()
    """Options that were compared by the error on left-out parts."""
    jumps: tuple[Jump, ...] = ()
    """Thresholds at which the output jumps, which have narrow bands."""
    ridge: Ridge | None = None
    """Mean of the prior; None if it is zero."""
    delay: float | None = None
    """Seconds by which the outputs were moved before the fit, if the lag was given in seconds."""
    told: RecordAdvice | None = None
    """Findings about the record as it was read; None for arrays."""

    @property
    def matrix(self) -> DesignMatrix:
        """Regressors of the fitted samples."""
        return self.regression.matrix

    @cached_property
    def uncertainty(self) -> Posterior:
        """Distribution of the unknowns for the bands; `plain_posterior` without prior."""
        if self.posterior is not None:
            return self.posterior
        determined = 0.0 if self.smoothness else float(self.free_parameters)
        x = self.matrix.spec.unknowns_of(self.model)
        return plain_posterior(self.regression, x, determined)

    @property
    def grouped(self) -> bool:
        """Whether bands are for another group: the record has three or more."""
        return self.groups is not None and np.unique(self.groups[self.fitted]).size >= FEWEST_GROUPS

    @cached_property
    def model_error(self) -> ModelError | None:
        """Error beyond the posterior, from parts left out; None for fewer than 50 samples."""
        regression, rows = self.regression, self.regression.rows
        known, model = self.uncertainty, self.model
        if self.grouped and self.groups is not None and self.left_out is not None:
            part, errors = folds(self.groups, rows)[rows], (self.left_out - self.y)[rows]
            return learn(regression, known, model, part, errors, np.unique(self.groups[rows]).size)
        if rows.size < FEWEST:
            return None
        return learn(regression, known, model, contiguous_parts(rows.size))

    @property
    def start(self) -> Start:
        """Memory before the first sample, and before each curve."""
        return self.curves.start

    @property
    def lag_seconds(self) -> float:
        """Lag in seconds; 0 where the sampling interval is not known."""
        return self.lag * (self.interval or 0.0) if self.delay is None else self.delay

    @property
    def lag_of_model(self) -> int:
        """Lag in whole rows, also where it was given in seconds; for model files."""
        delay = self.delay if self.interval else None
        return self.lag if delay is None else round(delay / (self.interval or 1.0))

    @cached_property
    def of_record(self) -> RecordAdvice:
        """Findings about the record, also of a record that was given as arrays."""
        if self.told is not None:
            return self.told
        raw = looks_like_raw_log(None, self.u, self.y)
        return RecordAdvice(warnings=(raw,) if raw else ())

    @property
    def chosen(self) -> tuple[str, ...]:
        """Choices of the identification: columns of the record and options, one sentence each."""
        return (*self.of_record.chosen, *map(str, self.choices))

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return self.curves.simulate(self.model, self.u, self.lag)

    @cached_property
    def curve_accuracy(self) -> tuple[CurveAccuracy, ...]:
        """Errors on each curve whose memory is reset; empty for a record of one curve."""
        if self.curves.begins.size == 1:
            return ()
        return by_curve(self.u, self.y, self.prediction, self.scored, self.curves, self.left_out)

    @cached_property
    def groups_nrmse(self) -> float | None:
        """Error on groups left out, over the range of the output; None without groups."""
        if self.left_out is None:
            return None
        known = np.isfinite(self.left_out)
        return nrmse((self.left_out - self.y)[known], self.y[known])

    @cached_property
    def each_group_nrmse(self) -> FloatArray:
        """(G,) error on each group left out, over the range of the output; empty without groups."""
        if self.left_out is None or self.groups is None:
            return np.zeros(0)
        square = (self.left_out - self.y) ** 2
        known = np.isfinite(square)
        count, total = (np.bincount(self.groups[known], w) for w in (None, square[known]))
        return np.sqrt(total[count > 0] / count[count > 0]) / self.span(known)

    @cached_property
    def baseline_nrmse(self) -> float:
        """Error of the best delayed polynomial, on the held-out samples if there are any."""
        scored = self.held_out if self.held_out.any() else self.fitted
        return polynomial_nrmse(self.u, self.y, self.fitted, scored, self.curves)

    @property
    def free_parameters(self) -> int:
        """Number of weights that are not zero, and of offset and slope if fitted.

        Without prior and smoothness, the data determine all of them (Meyer and Woodroofe, On the
        degrees of freedom in shape-restricted regression, Annals of Statistics 28, 2000); otherwise
        the data determine fewer: `effective_parameters`.
        """
        spec = self.matrix.spec
        return int(np.count_nonzero(self.model.weights)) + spec.offset + spec.slope

    @property
    def effective_parameters(self) -> float | None:
        """Trace of the matrix from measured to fitted outputs; None without the prior.

        It is the number of unknowns that the data determine (MacKay, Bayesian interpolation, Neural
        Computation 4, 1992, section 4), without sign constraints, at most `free_parameters`.
        """
        if self.posterior is None:
            return None
        return min(self.posterior.determined, float(self.free_parameters))

    @property
    def unknowns(self) -> int:
        """Number of weights, and of offset and slope if fitted."""
        return self.matrix.spec.unknowns

    @property
    def samples(self) -> int:
        """Number of fitted samples."""
        return self.matrix.measurements

    @property
    def rank(self) -> int:
        """Number of independent unknowns that the fitted samples determine."""
        return self._rank_and_condition[0]

    @property
    def condition(self) -> float:
        """Condition number of the design matrix with unit columns, within its rank."""
        return self._rank_and_condition[1]

    @property
    def excited(self) -> BoolArray:
        """(L, L) cells of the plane that the fitted samples excite."""
        return self.matrix.excited

    @property
    def excited_fraction(self) -> float:
        """Share of excited cells."""
        return float(np.count_nonzero(self.excited)) / self.matrix.spec.cells

    @cached_property
    def findings(self) -> tuple[Fault, ...]:
        """Faults of the fitted record: outliers, stuck and clipped stretches, and a lag."""
        y = self.y
        if self.suspects:
            y = y.copy()
            y[list(self.suspects)] = np.nan
        return record_faults(self.u, y, self.curves, self.lag, searched=self.searched)

    @cached_property
    def residual(self) -> ResidualSummary:
        """Summary of the residual on the fitted samples."""
        used = self.fitted.copy()
        for fault in self.findings:
            if fault.kind == "outlier":
                used[list(fault.samples)] = False
        if not used.any():
            used = self.fitted
        span = self.span(used)
        applied = self.curves.delayed(self.u, self.lag)
        error = (self.prediction - self.y) / span
        basis = Basis.of(applied, self.curves, int(np.count_nonzero(used)))
        return residuals.summary(applied, error, used, self.y / span, basis.rows, self.groups)

    @cached_property
    def _rank_and_condition(self) -> tuple[int, float]:
        return diagnosis.rank_and_condition(self.matrix)

    @overload
    def predict(
        self, u: npt.ArrayLike, bands: None = None, curves: npt.ArrayLike | None = None
    ) -> Samples: ...

    @overload
    def predict(
        self, u: npt.ArrayLike, bands: float, curves: npt.ArrayLike | None = None
    ) -> Prediction: ...

    def predict(
        self, u: npt.ArrayLike, bands: float | None = None, curves: npt.ArrayLike | None = None
    ) -> Samples | Prediction:
        """Predict the outputs, with the lag, for an input with the sampling of the record.

        Parameters and errors are those of `Result.predict`. If the record has three groups or more,
        the bands are those of another group.
        """
        if bands is None and curves is None:
            return Curves.whole(self.start).delayed(self.model.simulate(u, self.start), self.lag)
        inputs = as_signal(u, name="u")
        parts = as_curves(curves, inputs.size, self.start, None)
        y = parts.simulate(self.model, inputs, self.lag)
        if bands is None:
            return y
        probability = as_probability(bands)
        every = np.arange(inputs.size)
        sd, farther = self._deviation(inputs, parts, every, probability)
        share = float(farther.mean()) if farther.size else 0.0
        return Prediction(inputs, y, sd, probability, self._noise, share)

    def invert(
        self, targets: npt.ArrayLike, start: Start | None = None, unreachable: Unreachable = "raise"
    ) -> Inversion:
        """Invert targets, and predict the standard deviation of readings, as `Result.invert`."""
        begin = self.start if start is None else start
        found = replace(self.model.invert(targets, begin, unreachable), warnings=self.warnings)
        samples = np.arange(found.u.size)
        sd, _ = self._deviation(found.u, Curves.whole(begin), samples, lag=0)
        return replace(found, sd=sd)

    def deviation(self, samples: npt.ArrayLike) -> FloatArray:
        """(M,) standard deviations of predicted readings along the record, with sensor noise.

        ``samples`` (M,) of int: the samples, in increasing order.
        """
        return self._deviation(self.u, self.curves, np.asarray(samples, dtype=np.int64))[0]

    @property
    def _noise(self) -> float:
        """Standard deviation of the sensor, as far as it is distinguished from other errors."""
        if self.grouped:
            return 0.0
        return self.uncertainty.hyperparameters.noise * self.uncertainty.unit

    def _deviation(
        self,
        u: FloatArray,
        curves: Curves,
        samples: IntArray,
        probability: float = BAND,
        lag: int | None = None,
    ) -> tuple[FloatArray, BoolArray]:
        """As of `BandModel.deviation`; the default lag is that of the model."""
        late = self.lag if lag is None else lag
        return self.band_model.deviation(self.model, u, curves, samples, probability, late)

    @cached_property
    def band_model(self) -> BandModel:
        """Uncertainty of the model, which gives its bands."""
        inputs, places = self.curves.driven(self.u, self.model.levels, self.lag)
        within = within_cells(self.model, inputs, self.curves.start)[places[self.fitted]]
        shown = float(within.mean())
        return BandModel(self.uncertainty, self._noise, self.model_error, self.grouped, shown)

    @cached_property
    def band_sd(self) -> float:
        """Mean standard deviation of up to 800 predicted readings."""
        samples = np.flatnonzero(self.fitted) if self.grouped else np.arange(self.u.size)
        return float(self.deviation(few(samples)).mean())

    @property
    def _names_samples(self) -> bool:
        return bool(self.findings or self.codes or self.suspects)

    @cached_property
    def _coverage(self) -> tuple[float, str, float]:
        """Share of readings within their 90 % bands, kind of readings, and mean half width."""
        held = self.held_out.any()
        scored = np.flatnonzero(self.held_out if held else self.fitted)
        # With 2000 bands, the share of 90 % within them is known to 0.7 %
        scored = scored[one_of_each(scored.size, 2000)]
        reach = PER_DEVIATION * self.deviation(scored)
        inside = float(np.mean(np.abs((self.prediction - self.y)[scored]) <= reach))
        return inside, "held-out" if held else "fitted", float(reach.mean())

    def _summary(self, source: str) -> str:
        held = self.holdout_nrmse
        score = "nothing was held out"
        if held is not None:
            score = f"{percent(held, 2)} of its range on held-out data"
        return (
            f"A Preisach model of {self.model.bands} bands, identified from {source}: "
            f"{percent(self.nrmse, 2)} of range on the {self.samples} fitted samples, "
            f"{score}; the best polynomial of the delayed input reaches "
            f"{percent(self.baseline_nrmse, 2)}."
        )
