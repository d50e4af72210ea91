"""A model fitted to a record, with its errors."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification import diagnosis, residuals
from minorloop.identification.accuracy import (
    Accuracy,
    CurveAccuracy,
    accuracy,
    by_curve,
    scores_of,
)
from minorloop.identification.baseline import nrmse, polynomial_nrmse
from minorloop.identification.choosing import Choice
from minorloop.identification.curves import Curves
from minorloop.identification.design_matrix import DesignMatrix
from minorloop.identification.fitting import Regression
from minorloop.identification.jumps import Jump
from minorloop.identification.leave_out import FEWEST_GROUPS, folds
from minorloop.identification.model_error import FEWEST, ModelError, contiguous_parts, learn
from minorloop.identification.plain_posterior import plain_posterior
from minorloop.identification.posterior import Posterior
from minorloop.identification.preparation import RecordAdvice
from minorloop.identification.residuals import ResidualSummary
from minorloop.identification.ridge import Ridge
from minorloop.identification.rough_model import Basis, RecordFault
from minorloop.identification.screening import record_faults
from minorloop.lab.codes import Code
from minorloop.lab.holds import looks_like_raw_log
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach


@dataclass(frozen=True, eq=False)
class Fit:
    """A model fitted to a record, with its errors."""

    model: Preisach
    """The operator."""
    lag: int
    """Samples by which the output follows the input, beyond the hysteresis."""
    curves: Curves
    """Where the memory is reset, and the memory there."""
    smoothness: float
    """Strength that was used."""
    kkt: float
    """Largest violation of the optimality conditions, relative to the norm of the output."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). The record; y is NaN where nothing was measured."""
    fitted: BoolArray
    held_out: BoolArray
    """``fitted`` and ``held_out``: shape (T,). Samples that the model was fitted to, and those held
    out."""
    regression: Regression
    """Regressors and outputs of the fitted samples."""
    posterior: Posterior | None = None
    """Posterior distribution of the unknowns; None without the prior."""
    suspects: tuple[int, ...] = ()
    """Samples far outside the band of a fit without them; they were left out."""
    codes: tuple[Code, ...] = ()
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
    measured: FloatArray | None = None
    """Shape (T,). Outputs with dynamics, over whose range errors are given; ``y`` if None."""
    interval: float | None = None
    """Sampling interval in seconds, where it is known."""
    skipped: int = 0
    """Rows that set the memory and were not fitted."""
    choices: tuple[Choice, ...] = ()
    """Options that were compared by the error on left-out parts."""
    jumps: tuple[Jump, ...] = ()
    """Thresholds at which the output jumps, which have narrow bands."""
    ridge: Ridge | None = None
    """Mean of the prior; None if it is zero."""
    t: FloatArray | None = None
    """Shape (T,). Time of each row in seconds, where it is known."""
    delay: float | None = None
    """Seconds by which the outputs were moved before the fit, where the lag was given so."""
    told: RecordAdvice | None = None
    """What was found in the record as it was read; None for arrays."""

    @property
    def matrix(self) -> DesignMatrix:
        """Regressors of the fitted samples."""
        return self.regression.matrix

    @cached_property
    def uncertainty(self) -> Posterior:
        """Distribution of the unknowns that the bands are from; `plain_posterior` without prior."""
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
    def scored(self) -> BoolArray:
        """(T,) samples whose errors are known: fitted ones, and those held out."""
        return self.fitted | self.held_out

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
        """What was found in the record, also where it was given as arrays."""
        if self.told is not None:
            return self.told
        raw = looks_like_raw_log(None, self.u, self.y)
        return RecordAdvice(warnings=(raw,) if raw else ())

    @property
    def chosen(self) -> tuple[str, ...]:
        """What was chosen and not given: columns of the record and options, one sentence each."""
        return (*self.of_record.chosen, *map(str, self.choices))

    def span(self, rows: BoolArray) -> float:
        """Return the range of the measured outputs in some rows, which errors are over."""
        outputs = self.y if self.measured is None else self.measured
        return float(np.ptp(outputs[rows])) or 1.0

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return self.curves.simulate(self.model, self.u, self.lag)

    @cached_property
    def accuracy(self) -> Accuracy:
        """Errors on the fitted samples."""
        return self._accuracy(self.fitted)

    @cached_property
    def holdout_accuracy(self) -> Accuracy | None:
        """Errors on the samples held out; None if none were."""
        if not self.held_out.any():
            return None
        return self._accuracy(self.held_out)

    def _accuracy(self, rows: BoolArray) -> Accuracy:
        return accuracy(self.u, self.y, self.prediction, rows, self.curves, self.span(rows))

    @cached_property
    def curve_accuracy(self) -> tuple[CurveAccuracy, ...]:
        """Errors on each curve whose memory is reset; empty for a record of one curve."""
        if self.curves.begins.size == 1:
            return ()
        return by_curve(self.u, self.y, self.prediction, self.scored, self.curves, self.left_out)

    @property
    def rmse(self) -> float:
        """Root-mean-square error on the fitted samples, in the unit of the output."""
        return self.accuracy.rmse

    @property
    def nrmse(self) -> float:
        """`rmse` over the range of the fitted output."""
        return self.accuracy.nrmse

    @property
    def holdout_nrmse(self) -> float | None:
        """Error on the samples held out, over their range; None if none were."""
        return None if self.holdout_accuracy is None else self.holdout_accuracy.nrmse

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
        """Error of the best delayed polynomial, on the held-out samples where there are any."""
        scored = self.held_out if self.held_out.any() else self.fitted
        return polynomial_nrmse(self.u, self.y, self.fitted, scored, self.curves)

    @property
    def scores(self) -> dict[str, float | None]:
        """Scores that a model file keeps; those on held-out samples are None if there are none."""
        return {
            **scores_of(self.accuracy, self.holdout_accuracy),
            "baseline_nrmse": self.baseline_nrmse,
            "free_parameters": self.free_parameters,
            "effective_parameters": self.effective_parameters,
            "kkt": self.kkt,
        }

    @property
    def free_parameters(self) -> int:
        """Weights that are not zero, and offset and slope where fitted.

        Without prior and smoothness, they are as many as the data determine (Meyer and Woodroofe,
        On the degrees of freedom in shape-restricted regression, Annals of Statistics 28, 2000);
        otherwise the data determine fewer: `effective_parameters`.
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
        """Weights, and offset and slope where fitted."""
        return self.matrix.spec.unknowns

    @property
    def samples(self) -> int:
        """Samples that the model was fitted to."""
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
        """Share of the cells that are excited."""
        return float(np.count_nonzero(self.excited)) / self.matrix.spec.cells

    @cached_property
    def findings(self) -> tuple[RecordFault, ...]:
        """Faults of the fitted record: outliers, stuck and clipped stretches, and a lag."""
        y = self.y
        if self.suspects:
            y = y.copy()
            y[list(self.suspects)] = np.nan
        return record_faults(self.u, y, self.curves, self.lag, searched=self.searched)

    @cached_property
    def residual(self) -> ResidualSummary:
        """What the residual on the fitted samples shows."""
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
