"""Outputs of a model for another record, and their errors against the outputs measured there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from math import isnan
from os import PathLike
from typing import Any, ClassVar, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.oscillator import Oscillator
from minorloop.dynamics.sampling import Interpolation
from minorloop.errors import ParameterError, RecordError, are, counted
from minorloop.identification import residuals
from minorloop.identification.accuracy import Accuracy, CurveAccuracy, accuracy, by_curve
from minorloop.identification.after_effect_result import along
from minorloop.identification.band_model import BandModel
from minorloop.identification.bands import BAND, Prediction
from minorloop.identification.baseline import percent, polynomial_nrmse
from minorloop.identification.curves import AS_LEFT, Curves, as_curves, as_groups
from minorloop.identification.record_checks import as_skip
from minorloop.identification.residuals import ResidualSummary
from minorloop.identification.result import (
    ACCURACY_TEXTS,
    Rule,
    Scored,
    ScoreRow,
    add_curves,
    if_finite,
    of_range,
)
from minorloop.identification.rough_model import Basis, one_of_each
from minorloop.identification.screening import record_faults
from minorloop.lab.columns import read_labels
from minorloop.lab.conversion import read_column, unit_factor
from minorloop.lab.gaps import known_memory
from minorloop.lab.logs import AUTO, Named, with_times
from minorloop.lab.records import Quantity, Record
from minorloop.modelfile import Identified, Model, ModelFile, as_file
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.memory import Saturation, StartOfCurve
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Preisach
from minorloop.report import Picture, Report, Table

AnyModel: TypeAlias = str | PathLike[str] | ModelFile | Identified | Model
"""A model file, its content, the result of an identification, or a model."""
_THOUSAND, _OTHER_UNIT = 3.0, 0.3
"""Powers of ten by which units with another prefix differ, and largest deviation from them."""
_WRONG = 0.1
"""Error over the range of the output above which a model does not predict a record."""
_LEAST = 0.005
"""Least error over the range of the output of which a cause is searched; as in advice on fits."""
_BETTER = 0.5
"""Least share of the error that another start, or offset and gain, must explain as its cause."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Outputs of a model for the inputs of a record."""

    model: ModelFile
    """The model."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). Inputs in the unit of the model, and outputs; NaN if a gap of
    the times leaves the memory unknown."""
    curves: Curves
    """Rows before which the memory is reset."""
    t: FloatArray | None
    """Shape (T,). Times in seconds; None if not known."""
    notes: tuple[str, ...]
    """Findings about the record, one sentence each."""

    @cached_property
    def outside(self) -> BoolArray:
        """(T,) whether an input lies beyond the levels of the model."""
        levels = _levels(self.model)
        if levels is None:
            return np.zeros(self.u.size, dtype=np.bool_)
        return np.asarray((self.u < levels[0]) | (self.u > levels[-1]))

    @property
    def of_levels(self) -> tuple[str, ...]:
        """Number and distance of inputs beyond the levels, in one sentence; empty if none."""
        levels, count = _levels(self.model), int(self.outside.sum())
        if levels is None or not count:
            return ()
        low, high = float(levels[0]), float(levels[-1])
        beyond = max(low - float(self.u.min()), float(self.u.max()) - high)
        return (
            f"{count} inputs lie beyond the levels of the model [{low:g}, {high:g}], by up to "
            f"{beyond / (high - low):.1%} of their range; its relays are saturated there",
        )


def simulate(
    model: AnyModel, record: Record, *, between: Interpolation | None = None
) -> Simulation:
    """Return the outputs of a model for the inputs of a record, with lag and dynamics.

    Raises a `ParameterError` if an option does not fit the model; a `RecordError` if the record has
    another unit, or no times although the model needs them.

    Parameters
    ----------
    model : path, model, result of an identification, or ModelFile
        The model.
    record : Record
        The inputs with their times and labels, as `read` returns it; outputs are not used. The
        memory is reset where the label of the curve changes, to the memory in the record of the
        model unless a start is given. It continues over gaps of the times if the input there is
        known. The first input of dynamics has been applied for a long time.
    between : {"band", "straight", "held"}, optional
        Force of an oscillator between rows; ``"band"`` by default.
    """
    known, log = as_file(model), _checked(record).cut()
    u = _in_unit(np.asarray(log.u), log.input, known.input)
    unsaid = log.curves is not None and log.start_of_curve is None and log.start == "negative"
    if unsaid and known.start_of_curve is not None:
        log, unsaid = log.replace(start_of_curve=known.start_of_curve), False
    parts = as_curves(log.curves, u.size, log.start, log.start_of_curve)
    if isinstance(known.model, Oscillator):
        if parts.start != "negative":
            raise ParameterError(
                f"the start (--record start) is {parts.start!r}, and an oscillator begins at rest; "
                "omit the start"
            )
    else:
        _levels(known)  # refuses models that have no operator on the input
        if between is not None:
            raise ParameterError(
                "between (--record between) is for oscillators, and the model is of kind "
                f"{known.kind!r}; omit it"
            )
    if known.has_time and not log.timed:
        why = log.origin.why_untimed
        raise RecordError(
            why or "the model has dynamics and needs times; name the column of time (--time)"
        )
    if parts.begins.size > 1:
        log = log.with_memory_reset()
    notes = list(log.notes)
    if unsaid and not isinstance(known.model, Polynomial | Oscillator):
        notes.append(
            "each curve begins with the memory 'negative', because the model does not contain the "
            "memory of its own curves: give start_of_curve (--record start_of_curve) if it differs"
        )
    if log.curves is None and known.start_of_curve is not None:
        notes.append(
            "the record of the model had curves, and these rows count as one; name their column, "
            "if there is one, with curves (--record curves=COLUMN)"
        )
    gaps, times = log.bridges, log.t
    t, inputs, added = gaps.inserted(times, u)
    y = np.delete(
        _along(known, t if log.timed else None, inputs, parts, between),
        added + np.arange(added.size),
    )
    unknown = ~known_memory(u, gaps.unknown)
    if unknown.any() and not isinstance(known.model, Polynomial | Oscillator):
        count = int(unknown.sum())
        y = np.where(unknown, np.nan, y)
        notes.append(
            f"{counted(count, 'output')} {are(count)} empty, because the input may have "
            "turned in a gap, and the memory is unknown after it"
        )
    if known.lag and not log.timed:
        rows = counted(known.lag, "row")
        notes.append(
            f"the lag of {known.lag_seconds:.4g} s counts as {rows}, as in the record of the "
            "model; --time takes it in seconds"
            if known.lag_seconds
            else f"outputs follow the inputs by {rows}, the lag of the model; an identification "
            "with lag=0 (--law lag=0) has none"
        )
    return Simulation(known, u, y, parts, times if log.timed else None, tuple(notes))


def _checked(record: Record) -> Record:
    if not isinstance(record, Record):
        raise ParameterError(
            f"the record is a {type(record).__name__}; give what minorloop.read returns, or "
            "Record(u, y)"
        )
    return record


def _in_unit(values: FloatArray, found: Quantity, wanted: Quantity) -> FloatArray:
    """Return numbers in the unit of a model; an unknown unit counts as the same."""
    factor = unit_factor(found.unit, wanted.unit) if found.unit and wanted.unit else 1.0
    if factor is None:
        raise RecordError(
            f"'{found}' is in {found.unit} and the model in {wanted.unit}; give the column in "
            f"{wanted.unit}"
        )
    return values if factor == 1 else factor * values


def _levels(known: ModelFile) -> FloatArray | None:
    """Thresholds of the relays of a model; None if it has none."""
    return None if isinstance(known.model, Oscillator) else getattr(known.operator, "levels", None)


def _along(
    known: ModelFile,
    t: FloatArray | None,
    u: FloatArray,
    parts: Curves,
    between: Interpolation | None,
) -> FloatArray:
    """(T,) outputs along curves, each by itself."""
    model: Any = known.model
    if isinstance(model, AfterEffect) and t is not None:
        return along(model, t, u, parts)
    y = np.empty(u.size)
    for first, last in parts.parts(u.size):
        rows = slice(first, last)
        times: Any = None if t is None else t[rows]
        if isinstance(model, Oscillator):
            y[rows] = model.simulate(times, u[rows], between=between or "band")
        elif isinstance(model, Cascade):
            y[rows] = model.simulate(times, u[rows], parts.start)
        else:
            found = model.simulate(u[rows], parts.start)
            y[rows] = _late(known, times, found)
    return y


def _late(known: ModelFile, t: FloatArray | None, y: FloatArray) -> FloatArray:
    """Return outputs delayed by the lag of a model."""
    if t is not None and known.lag_seconds:
        return np.interp(t - known.lag_seconds, t, y)
    return Curves.whole("negative").delayed(y, known.lag)


def _wrong(score: ModelScore) -> Iterator[str]:
    if score.nrmse > _WRONG:
        yield (
            f"the error is {percent(score.nrmse)} of range, more than {_WRONG:.0%}: the model "
            f"does not predict this record{''.join(_other_units(score))}"
        )


def _other_units(score: ModelScore) -> Iterator[str]:
    """Name the input, or else the output, if it seems to have another prefix of its unit.

    The prediction for an input in another unit says nothing about the unit of the output.
    """
    known, levels = score.simulation.model, _levels(score.simulation.model)
    ratios = {}
    if levels is not None:
        ratios[known.input] = float(np.ptp(score.u)) / float(np.ptp(levels))
    ratios[known.output] = score.span / (float(np.ptp(score.prediction[score.scored])) or 1.0)
    for name, ratio in ratios.items():
        digits = np.log10(ratio) if ratio > 0 else 0.0
        times = _THOUSAND * round(digits / _THOUSAND)
        if times and abs(digits - times) < _OTHER_UNIT:
            yield (
                f"; the range of {name.name} is about {10**times:g} times that of the model: give "
                f"its unit in the header, as {name.name} [{name.unit or 'unit'}]"
            )
            return


def _notes(score: ModelScore) -> Iterator[str]:
    yield from score.simulation.notes


def _outside(score: ModelScore) -> Iterator[str]:
    """Name inputs beyond the levels, outliers, and readings at the end of the sensor's range."""
    yield from score.simulation.of_levels
    faults = record_faults(score.u, score.y, score.curves, score.lag, searched=True)
    yield from (str(one) for one in faults if one.kind in ("clipped", "outlier"))


def _causes(score: ModelScore) -> Iterator[str]:
    """Give explanations of the error, most likely causes first."""
    found, error = score.residual, score.nrmse
    if error < _LEAST:
        return
    # Share of readings in 90 % bands below which the bands are too narrow
    if score.coverage is not None and score.coverage < 0.75:
        yield (
            f"{score.coverage:.0%} of the readings lie within the 90 % bands of the model: this "
            "record differs from that of the model by more than its parts differ from one another"
        )
    promised = score.promised
    # Ratio of the error to that in the model file from which it is reported
    if promised is not None and error > 2.0 * promised:
        yield (
            f"the error is {error / promised:.1f} times the {percent(promised)} that the model "
            "had on left-out data of its own record"
        )
    if error > score.baseline_nrmse:
        yield (
            f"a polynomial of the delayed input that is fitted to this record is better "
            f"({percent(score.baseline_nrmse)} against {percent(error)})"
        )
    best = min(score.starts, key=score.starts.__getitem__, default=None)
    if best is not None and score.starts[best] < _BETTER * error:
        yield (
            f"the error is {percent(score.starts[best])} if the memory before is {best!r}: give "
            f'start="{best}" (--record start={best}), or start_of_curve for curves'
        )
    elif found.startup is not None:
        rows = found.startup.rows
        yield (
            f"the first {counted(rows, 'row')} have {found.startup.share:.0%} of the squared "
            f"error: the memory before them is not that of the start; exclude them with "
            f"skip={rows} (--record skip={rows})"
        )
    within = score.within_levels
    if within is not None and within < _BETTER * error:
        yield (
            f"at inputs within the levels of the model the error is {percent(within)}: "
            "identify from a record that reaches all inputs"
        )
        return
    offset, gain, left = score.line
    if left < _BETTER * error:
        yield (
            f"an offset of {offset:+.2%} of range and a gain of {gain:.4g} explain most of "
            f"it, {percent(left)} is left: the zero or the gain of the sensor changed, or this "
            "is another specimen"
        )
    elif found.step is not None:
        yield (
            f"from sample {found.step.sample} on the output is shifted by "
            f"{found.step.size:+.2%} of range: the sensor or its mount moved"
        )
    elif abs(found.drift) > _LEAST:
        yield f"the output drifts by {found.drift:+.2%} of range along the record"


@dataclass(frozen=True, eq=False, repr=False)
class ModelScore(Scored):
    """Errors of a model on a record from which it was not identified."""

    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        ScoreRow("nrmse", "nrmse", "error", of_range),
        ScoreRow("nrmse_promised", "promised", "error on left-out data of its record", percent),
        ScoreRow(
            "baseline_nrmse", "baseline_nrmse", "best delayed polynomial, fitted here", percent
        ),
        ScoreRow("coverage", "coverage", "readings within their 90 % bands", "{:.0%}"),
        ScoreRow("", "_samples_text", "samples scored"),
        ScoreRow("", lambda found: found._with_unit(found.accuracy.rmse), "rms error"),
        *(ScoreRow("", "accuracy", *texts) for texts in ACCURACY_TEXTS),
        ScoreRow("half_width", "half_width", "mean half width of the bands", "{:.4g}"),
        ScoreRow("offset", lambda found: found.line[0]),
        ScoreRow("gain", lambda found: found.line[1]),
        ScoreRow("", "_line_text", "offset and gain"),
        ScoreRow(
            "nrmse_without_offset_and_gain",
            lambda found: found.line[2],
            "error without them",
            percent,
        ),
        ScoreRow(
            "outside",
            lambda found: float(found.simulation.outside.mean()),
            "inputs beyond the levels",
            lambda share: f"{share:.1%}" if share else "",
        ),
        ScoreRow("nrmse_within_levels", "within_levels", "error at the other inputs", percent),
        ScoreRow("", "residual.autocorrelation", "residual autocorrelation", if_finite),
        *(ScoreRow(one.name, f"accuracy.{one.name}") for one in fields(Accuracy)),
        ScoreRow("starts", lambda found: dict(found.starts)),
        ScoreRow("curves", "curve_accuracy"),
        ScoreRow("residual", "residual"),
        ScoreRow("notes", "simulation.notes"),
    )
    WARNINGS: ClassVar[tuple[Rule, ...]] = (_wrong,)
    REMARKS: ClassVar[tuple[Rule, ...]] = (_notes, _outside, _causes)

    simulation: Simulation
    """The model and its outputs."""
    y: FloatArray
    """Shape (T,). Measured outputs in the unit of the model; NaN if not measured."""
    scored: BoolArray
    """Shape (T,). Scored rows: measured rows with known memory and delayed input that are not
    skipped."""
    starts: Mapping[str, float] = field(default_factory=dict)
    """Errors with other start states, over the range of the output."""
    groups: Mapping[str, BoolArray] = field(default_factory=dict)
    """Shape (T,) each. Rows of each group; empty without groups."""

    @property
    def u(self) -> FloatArray:
        """(T,) inputs in the unit of the model."""
        return self.simulation.u

    @property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model."""
        return self.simulation.y

    def columns(self, time: Quantity) -> dict[str, list[Any]]:
        """Return the columns of a table of all rows by header; unknown values are empty.

        ``time``: name of the times.
        """
        known, t = self.simulation.model, self.simulation.t
        columns = {} if t is None else {str(time): t}
        columns |= {str(known.input): self.u, f"measured {known.output}": self.y}
        columns |= {f"predicted {known.output}": self.prediction}
        columns |= {f"residual {known.output}": self.error}
        return {
            header: ["" if isnan(value) else value for value in values.tolist()]
            for header, values in columns.items()
        }

    @property
    def curves(self) -> Curves:
        """Rows before which the memory is reset."""
        return self.simulation.curves

    @property
    def lag(self) -> int:
        """Rows of this record by which the output follows the model."""
        known, t = self.simulation.model, self.simulation.t
        if t is None or not known.lag_seconds:
            return known.lag
        return round(known.lag_seconds / float(np.median(np.diff(t))))

    @property
    def span(self) -> float:
        """Range of the scored outputs, to which errors are relative."""
        return float(np.ptp(self.y[self.scored])) or 1.0

    @property
    def error(self) -> FloatArray:
        """(T,) model minus measured; NaN in rows that are not scored."""
        return np.where(self.scored, self.prediction - self.y, np.nan)

    @cached_property
    def accuracy(self) -> Accuracy:
        """Errors on the scored rows."""
        return accuracy(self.u, self.y, self.prediction, self.scored, self.curves)

    @property
    def nrmse(self) -> float:
        """Root-mean-square error over the range of the scored outputs."""
        return self.accuracy.nrmse

    @cached_property
    def curve_accuracy(self) -> tuple[CurveAccuracy, ...]:
        """Errors on each curve or group over the range of all; empty if there is only one."""
        if self.groups:
            rows = {name: where & self.scored for name, where in self.groups.items()}
            return tuple(
                CurveAccuracy(name, int(np.argmax(where)), self._on(where), None)
                for name, where in rows.items()
                if where.any()
            )
        if self.curves.begins.size == 1:
            return ()
        return by_curve(self.u, self.y, self.prediction, self.scored, self.curves)

    def _on(self, rows: BoolArray) -> Accuracy:
        return accuracy(self.u, self.y, self.prediction, rows, self.curves, self.span)

    @cached_property
    def within_levels(self) -> float | None:
        """Error at inputs within the levels, over the same range; None if all or no inputs are."""
        inside = self.scored & ~self.simulation.outside
        if not inside.any() or not self.simulation.outside.any():
            return None
        return self._on(inside).nrmse

    @cached_property
    def baseline_nrmse(self) -> float:
        """Error of the best delayed polynomial, fitted to the scored rows."""
        return polynomial_nrmse(self.u, self.y, self.scored, self.scored, self.curves)

    @cached_property
    def residual(self) -> ResidualSummary:
        """Summary of the residual on the scored rows."""
        applied = self.curves.delayed(self.u, self.lag)
        basis = Basis.of(applied, self.curves, int(np.count_nonzero(self.scored)))
        error = (self.prediction - self.y) / self.span
        return residuals.summary(applied, error, self.scored, self.y / self.span, basis.rows)

    @cached_property
    def line(self) -> tuple[float, float, float]:
        """Offset and gain of the measured outputs against the model, and the error with them.

        The offset is at the middle of the outputs of the model; it and the error are over the range
        of the measured outputs.
        """
        x, y = self.prediction[self.scored], self.y[self.scored]
        x = x - (x.max() + x.min()) / 2
        middle = (self.prediction[self.scored].max() + self.prediction[self.scored].min()) / 2
        if np.ptp(x) == 0:
            return 0.0, 1.0, self.nrmse
        gain, offset = np.polyfit(x, y, 1)
        left = float(np.sqrt(np.mean((y - offset - gain * x) ** 2)))
        return float(offset - middle) / self.span, float(gain), left / self.span

    @cached_property
    def bands(self) -> Prediction | None:
        """Outputs with 90 % bands at up to 2000 scored rows; None if the model has no bands."""
        part, model = self.simulation.model.bands, self.simulation.model.model
        if part is None or not isinstance(model, Preisach):
            return None
        known = part if isinstance(part, BandModel) else BandModel.of_file(part, model)
        rows = self.band_rows
        sd, _ = known.deviation(model, self.u, self.curves, rows, BAND, self.lag)
        return Prediction(self.u[rows], self.prediction[rows], sd, BAND)

    @property
    def band_rows(self) -> IntArray:
        """(M,) rows of `bands`."""
        rows = np.flatnonzero(self.scored)
        # With 2000 bands, the share of 90 % within them is known to 0.7 %
        return np.asarray(rows[one_of_each(rows.size, 2000)])

    @property
    def coverage(self) -> float | None:
        """Share of readings within their 90 % bands; None if the model has no bands."""
        return None if self.bands is None else self.bands.covers(self.y[self.band_rows])

    @property
    def promised(self) -> float | None:
        """Error that the model file gives for other records; None if it has none."""
        scores = self.simulation.model.provenance.scores
        return scores.get("nrmse_holdout", scores.get("left_out_nrmse"))

    @property
    def half_width(self) -> float | None:
        """Mean half width of the 90 % bands; None if the model has no bands."""
        return None if self.bands is None else float(self.bands.half_width.mean())

    def _with_unit(self, value: float) -> str:
        """Return a value in the unit of the output as text."""
        return f"{value:.4g} {self.simulation.model.output.unit}".rstrip()

    @property
    def _samples_text(self) -> str:
        return f"{self.accuracy.samples} of {self.y.size}"

    @property
    def _line_text(self) -> str:
        offset, gain, _ = self.line
        return f"{round(offset, 4) + 0.0:+.2%} of range, {gain:.4g}"

    def report(self, model: str, source: str) -> Report:
        """Return a report on the errors.

        ``model`` and ``source``: names of the model file and of the record.
        """
        known = self.simulation.model
        report = Report(
            f"{model} on {source}",
            f"The model predicts {self.accuracy.samples} readings of {source} to "
            f"{percent(self.nrmse, 2)} of their range, {self._with_unit(self.accuracy.rmse)} rms. "
            f"It was identified from {known.provenance.data or 'no file'}.",
        )
        labels = {"input_label": str(known.input), "output_label": str(known.output)}
        labels = {name: label.replace("$", r"\$") for name, label in labels.items()}
        caption = (
            "Measured and predicted loop; the record; the residual, predicted minus measured, by "
            "the input, and in time with the 90 % bands, if the model has some."
        )
        report.add(
            "Quality",
            table=Table(("", ""), self.summary()),
            pictures=[Picture(self.plot(**labels), caption)],
            notes=[*known.warnings, *self.advice],
        )
        if self.curve_accuracy:
            add_curves(report, self)
        return report


def score(model: AnyModel, record: Record, *, between: Interpolation | None = None) -> ModelScore:
    """Score a model on a record from which it was not identified.

    Raises a `ParameterError` or `RecordError` as of `simulate`, or if no row is left to score.

    Parameters
    ----------
    model, record, between
        As of `simulate`; outputs that are NaN were not measured. If rows have labels of groups,
        such as specimens, each group has its own errors. Skipped rows set the memory and are not
        scored.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200))
    >>> model = ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5])
    >>> ml.score(model, ml.Record(u, model.simulate(u))).nrmse
    0.0
    """
    known, log = as_file(model), _checked(record).cut()
    found = simulate(known, log, between=between)
    y = _in_unit(np.asarray(log.y), log.output, known.output)
    rows = np.isfinite(y) & np.isfinite(found.y) & ~_early(found)
    rows &= ~as_skip(log.skip, found.curves.positions(y.size))
    if not rows.any():
        raise RecordError(
            "no row is left to score: no row was measured with a known memory; give the output, or "
            "a smaller skip (--record skip=N)"
        )
    result = ModelScore(found, y, rows, groups=_by_label(log.groups, y.size))
    if isinstance(known.model, Oscillator | Polynomial) or result.nrmse < _LEAST:
        return result
    others: dict[str, float] = {}
    begin = found.curves.start
    for name in get_args(Saturation) if isinstance(begin, str) else ():
        with suppress(ParameterError):  # some operators have fewer starts
            if name != begin:
                of_curve = None if log.curves is None else name
                again = simulate(known, log.replace(start=name, start_of_curve=of_curve))
                others[name] = replace(result, simulation=again).nrmse
    return replace(result, starts=others)


def _early(found: Simulation) -> BoolArray:
    """(T,) rows whose delayed input is before the first one of their curve."""
    known, size = found.model, found.u.size
    if found.t is not None and known.lag_seconds:
        first = found.t[found.curves.first_rows(size)]
        return np.asarray(found.t - first < known.lag_seconds * (1 - 1e-9))
    return np.asarray(found.curves.positions(size) < known.lag)


def _by_label(labels: npt.ArrayLike | None, size: int) -> dict[str, BoolArray]:
    """Return the rows of each group by its label."""
    if labels is None:
        return {}
    numbers: IntArray = as_groups("groups (--record groups=COLUMN)", labels, size)
    names = np.unique(np.asarray(labels)).tolist()
    return {
        f"{name:g}" if isinstance(name, float) else str(name): numbers == k
        for k, name in enumerate(names)
    }


def read_inputs(
    known: ModelFile,
    path: str | PathLike[str],
    input: str | None = None,
    *,
    time: Named = AUTO,
    curves: str | None = None,
    start_of_curve: StartOfCurve | None = None,
) -> Record:
    """Return the inputs of a table with their times and curves, for `simulate`; outputs are NaN.

    Raises a `RecordError` if the file or a column cannot be used, the unit differs, or times run
    backwards.

    ``known``: the model; its input is the default column; ``path``: the table; ``input``, ``time``
    and ``curves``: columns, as of `minorloop.read`; ``start_of_curve`` {"negative", "positive",
    "demagnetised", "as-left"}: memory before each curve, as of `Record`; by default that of the
    model.
    """
    column = known.input.name if input is None else input
    u = read_column(path, column, known.input.unit)
    labels = None if curves is None else read_labels(path, curves)
    names = known.input, known.output
    record = Record(u, np.full(u.size, np.nan), None, *names, curves=labels)
    reset = curves is not None and (start_of_curve or known.start_of_curve) != AS_LEFT
    record = with_times(record, path, column, time, strictly=known.has_time, reset=reset)
    return record.replace(start_of_curve=start_of_curve)
