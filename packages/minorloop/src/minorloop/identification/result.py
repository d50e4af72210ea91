"""The result of every identification: a model, its scores, and advice.

A law gives a subclass of `Fit` two tables: its scores, and its rules of advice. Terminal,
``--json``, model files, reports, notebooks, the lab page and fleets read these tables.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

import msgspec
import numpy as np

from minorloop import modelfile
from minorloop.arrays import BoolArray, FloatArray
from minorloop.errors import ParameterError, counted
from minorloop.figures import Drawn
from minorloop.files import PathLike
from minorloop.identification.accuracy import (
    Accuracy,
    CurveAccuracy,
    accuracy,
    curve_table,
    worst_error,
)
from minorloop.identification.baseline import percent
from minorloop.identification.curves import Curves
from minorloop.identification.preparation import NOTHING, RecordAdvice
from minorloop.operators.preisach import Preisach
from minorloop.report import Picture, Report, Table

if TYPE_CHECKING:
    from minorloop.lab.records import Record

M = TypeVar("M", covariant=True)
FIRST = 5
"""Number of first scores of the table that the terminal shows without -v."""
_OF_REPR = 3
"""Number of first scores in the representation, which has five lines."""


Rule: TypeAlias = Callable[[Any], Iterator[str]]
"""A rule of advice: gives sentences about weaknesses of a fit and remedies, if any."""


@dataclass(frozen=True)
class ScoreRow:
    """One score of a kind of fits."""

    name: str
    """Key in ``--json``; empty for a score that is only shown."""
    value: str | Callable[[Any], Any]
    """Attribute of the fit, or a function of the fit."""
    label: str = ""
    """Name in tables; empty for a score that is not shown."""
    text: str | Callable[[Any], str] = "{}"
    """Format of the value, or a function of it."""
    absent: str = ""
    """Text in place of None; if it is empty, the score is then not shown."""
    kept: bool = False
    """Whether a model file keeps it."""
    slow: bool = False
    """Whether it takes seconds, so that only reports, ``--json`` and ``-v`` show it."""

    def of(self, fit: object) -> Any:
        """Return the value of a fit."""
        return attrgetter(self.value)(fit) if isinstance(self.value, str) else self.value(fit)

    def row(self, fit: object) -> list[tuple[str, str]]:
        """Return label and text, or an empty list if the text is empty."""
        value = self.of(fit)
        text = self.absent
        if value is not None:
            text = self.text.format(value) if isinstance(self.text, str) else self.text(value)
        return [(self.label, text)] if text else []


def of_range(share: float) -> str:
    """Return an error over the range of the output as text."""
    return f"{percent(share)} of range"


def _of_own(share: float) -> str:
    return f"{percent(share)} of its range"


def _of_rms(errors: Accuracy) -> str:
    return f"{percent(errors.relative_rms)} of rms"


def _of_loops(errors: Accuracy) -> str:
    if errors.loop_area is None:
        return ""
    return f"{percent(errors.loop_area)} off, {counted(errors.loops, 'loop')}"


def _of_worst(errors: Accuracy) -> str:
    return worst_error(errors, f", sample {errors.worst_sample}")


def unless_0(value: float) -> str:
    """Return a count as text; an empty text for 0."""
    return f"{value}" if value else ""


def if_finite(value: float) -> str:
    """Return a correlation as text; an empty text if it is not known."""
    return f"{value:.2f}" if isfinite(value) else ""


def _error(part: str, name: str) -> Callable[[Any], Any]:
    """Return a function from a fit to one of its errors; None if no samples were held out."""
    return lambda fit: getattr(getattr(fit, part), name, None)


ERRORS = (
    ScoreRow("nrmse_train", "nrmse", "error on fitted data", of_range, kept=True),
    ScoreRow("nrmse_holdout", "holdout_nrmse", "error on held-out data", _of_own, "-", kept=True),
)
"""The first errors of fits that may have held-out samples."""
ACCURACY_TEXTS = (("relative rms", _of_rms), ("loop area", _of_loops), ("worst error", _of_worst))
"""Labels, and functions of an `Accuracy` that return texts."""
MORE_ERRORS = tuple(
    score
    for name, (label, text) in zip(
        ("relative_rms", "loop_area", "worst"), ACCURACY_TEXTS, strict=True
    )
    for part, errors, where in (
        ("train", "accuracy", ""),
        ("holdout", "holdout_accuracy", ", held out"),
    )
    for score in (
        ScoreRow(f"{name}_{part}", _error(errors, name), kept=True),
        ScoreRow("", errors, f"{label}{where}", text),
    )
)
"""The other errors of such fits."""


class Scored(Drawn):
    """A result with a table of scores and rules of advice."""

    SCORES: ClassVar[tuple[ScoreRow, ...]] = ()
    """The table of scores, most important first."""
    WARNINGS: ClassVar[tuple[Rule, ...]] = ()
    """The rules about models that are not to be trusted."""
    REMARKS: ClassVar[tuple[Rule, ...]] = ()
    """The other rules of advice, most important first."""

    @property
    def scores(self) -> dict[str, float | None]:
        """Scores that a model file keeps; held-out scores are None without held-out samples."""
        return {score.name: score.of(self) for score in self.SCORES if score.kept}

    @property
    def figures(self) -> dict[str, Any]:
        """All scores, advice and warnings by name, as ``--json`` prints them."""
        found = {score.name: score.of(self) for score in self.SCORES if score.name}
        found |= {"advice": self.advice, "warnings": self.warnings}
        plain: dict[str, Any] = msgspec.to_builtins(found, enc_hook=lambda array: array.tolist())
        return plain

    def summary(self, *, slow: bool = False) -> list[tuple[str, str]]:
        """Return the scores as text, label and value; with ``slow`` also the slow scores."""
        shown = [one for one in self.SCORES if one.label and (slow or not one.slow)]
        return [row for score in shown for row in score.row(self)] + self._further_rows()

    def _further_rows(self) -> list[tuple[str, str]]:
        """Further rows of the table, one for each part of the model."""
        return []

    @property
    def details(self) -> tuple[str, ...]:
        """Lines to print after the scores."""
        return ()

    @property
    def curve_accuracy(self) -> tuple[CurveAccuracy, ...]:
        """Errors on each curve whose memory is reset; empty for a record of one curve."""
        return ()

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the model, part of the advice; empty if there are none."""
        return tuple(_sentences(self.WARNINGS, self))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """Sentences about weaknesses and remedies, warnings first; empty if there are none."""
        return (*self.warnings, *_sentences(self.REMARKS, self))

    @property
    def verdict(self) -> str:
        """One sentence on how far to trust the model."""
        if self.warnings:
            return f"not to be trusted: {self.warnings[0]}"
        if self.advice:
            return f"{counted(len(self.advice), 'remark')}, first: {self.advice[0]}"
        return "no weaknesses found"

    @property
    def _name(self) -> str:
        return type(self).__name__

    def __repr__(self) -> str:
        rows = [*self.summary()[:_OF_REPR], ("verdict", self.verdict)]
        return "\n".join([self._name, *_lines(rows)])

    def __str__(self) -> str:
        said = (f"advice: {text}" for text in self.advice)
        return "\n".join([self._name, *_lines(self.summary()), *self.details, *said])


def _sentences(rules: Sequence[Rule], fit: object) -> Iterator[str]:
    for rule in rules:
        yield from rule(fit)


def _lines(rows: Sequence[tuple[str, str]]) -> list[str]:
    return [f"{name:<24} {value}" for name, value in rows]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Fit(Scored, Generic[M]):
    """A model identified from a record, with its errors and advice.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200)) * np.linspace(1.0, 0.2, 200)
    >>> fit = ml.identify(u, u + 0.2 * u**3, ml.Plane(8, lag=0))
    >>> fit.nrmse < 0.05, fit.predict([0.0, 0.5]).shape
    (True, (2,))
    """

    HEADLINE: ClassVar[str] = "{output} against {input}"
    """Title of reports and tables; ``fit`` and the names ``input`` and ``output`` are filled in."""
    CAPTION: ClassVar[str] = ""
    """Caption of the figure."""

    model: M
    """The model."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). The record; y is NaN if not measured."""
    fitted: BoolArray
    """Shape (T,). Whether a sample is fitted."""
    held_out: BoolArray
    """Shape (T,). Whether a sample is held out to score the model."""
    curves: Curves
    """Rows before which the memory is reset, and the memory there."""
    t: FloatArray | None = None
    """Shape (T,). Time of each row in seconds, if it is known."""
    measured: FloatArray | None = None
    """Shape (T,). Outputs with dynamics, over whose range errors are given; ``y`` if None."""
    lag: int = 0
    """Samples by which the output follows the model, beyond its dynamics."""
    told: RecordAdvice | None = NOTHING
    """Findings about the record as it was read; None for arrays."""
    record: Record | None = None
    """The record as it was given, with the names of its columns; None for arrays."""

    @property
    def lag_seconds(self) -> float:
        """Lag in seconds; 0 where the sampling interval is not known."""
        return 0.0

    @property
    def lag_of_model(self) -> int:
        """Lag in whole rows, also where it was given in seconds; for model files."""
        return self.lag

    @property
    def of_record(self) -> RecordAdvice:
        """Findings about the record, also of a record that was given as arrays."""
        return self.told or NOTHING

    @property
    def _name(self) -> str:
        return f"{type(self).__name__} of a {type(self.model).__name__}"

    @property
    def plane(self) -> Preisach:
        """The Preisach plane: the model, or its outputs for slow inputs.

        Raises a `ParameterError` if the model has none.
        """
        known = self.saved.model
        for model in (known, getattr(known, "operator", None), getattr(known, "settled", None)):
            if isinstance(model, Preisach):
                return model
        raise ParameterError(f"a {type(known).__name__} has no Preisach plane")

    @property
    def unknowns(self) -> int:
        """Number of fitted numbers, zero or not."""
        raise NotImplementedError

    @property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        raise NotImplementedError

    def span(self, rows: BoolArray) -> float:
        """Return the range of the measured outputs in some rows, to which errors are relative.

        Parameters
        ----------
        rows : (T,) array of bool
            Whether a row counts.
        """
        outputs = self.y if self.measured is None else self.measured
        return float(np.ptp(outputs[rows])) or 1.0

    @property
    def scored(self) -> BoolArray:
        """(T,) samples with known errors: fitted and held-out samples."""
        return self.fitted | self.held_out

    @cached_property
    def accuracy(self) -> Accuracy:
        """Errors on the fitted samples."""
        return self._accuracy(self.fitted)

    @cached_property
    def holdout_accuracy(self) -> Accuracy | None:
        """Errors on the held-out samples; None if there are none."""
        return self._accuracy(self.held_out) if self.held_out.any() else None

    def _accuracy(self, rows: BoolArray) -> Accuracy:
        return accuracy(self.u, self.y, self.prediction, rows, self.curves, self.span(rows))

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
        """Error on the held-out samples, over their range; None if there are none."""
        return None if self.holdout_accuracy is None else self.holdout_accuracy.nrmse

    @property
    def chosen(self) -> tuple[str, ...]:
        """Choices of the identification: columns of the record and options, one sentence each."""
        return self.of_record.chosen

    @property
    def details(self) -> tuple[str, ...]:
        """Lines to print after the scores."""
        return tuple(f"chosen {text}" for text in self.chosen)

    @property
    def saved(self) -> Fit[Any]:
        """The fit whose model a file keeps."""
        return self

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Reasons not to trust the model, part of the advice; empty if there are none."""
        return (*self.of_record.warnings, *_sentences(self.WARNINGS, self))

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """Sentences about weaknesses and remedies, warnings first; empty if there are none."""
        rest = [*_sentences(self.REMARKS, self)]
        return self.of_record.with_model(self.warnings, rest, samples=self._names_samples)

    @property
    def _names_samples(self) -> bool:
        """Whether sentences of the advice count samples."""
        return False

    def save(self, path: PathLike, *, force: bool = False, **options: Any) -> None:
        """Write the model with its lag, scores and warnings to a file, as `minorloop.save`.

        Parameters
        ----------
        path, force
            As of `minorloop.save`.
        **options
            Other options of it; default names of input and output are those of the record.
        """
        names = {}
        if self.record is not None:
            names = {"input": self.record.input, "output": self.record.output}
        given = {"warnings": self.warnings, **names, **options}
        modelfile.save(self.saved, path, force=force, **given)

    def plot(self, **options: Any) -> Any:
        """Draw it, with the names and units of the record.

        Parameters
        ----------
        **options
            Those of `minorloop.plot`.
        """
        return super().plot(**(self.drawn_labels | options))

    @property
    def labels(self) -> dict[str, str]:
        """Names and units of input and output, by the options of `plot`."""
        record, names = self.record, ("input", "output")
        return {
            f"{one}_label": one if record is None else str(getattr(record, one)) for one in names
        }

    @property
    def drawn_labels(self) -> dict[str, str]:
        """Names and units as `labels`, for figures, where a dollar sign would begin a formula."""
        return {name: one.replace("$", r"\$") for name, one in self.labels.items()}

    @property
    def headline(self) -> str:
        """Title of reports and tables: output, input and kind of model."""
        u, y = self.labels.values()
        return self.HEADLINE.format(fit=self, input=u, output=y)

    def report(self, source: str = "the record") -> Report:
        """Return an HTML report on the model and its quality, with the names of the record.

        Parameters
        ----------
        source : str
            Name of the record.
        """
        report = Report(self.headline, self._summary(source))
        self._add_to(report, self.drawn_labels)
        return report

    def _summary(self, source: str) -> str:
        """Method and errors in a sentence or two, for a report."""
        raise NotImplementedError

    def _add_to(self, report: Report, labels: Mapping[str, str], of: str = "") -> None:
        """Add the sections of a report; headings end with ``of``."""
        report.add(
            f"Quality{of}",
            text=[f"Chosen {one}." for one in self.chosen],
            table=Table(("", ""), self.summary(slow=True)),
            pictures=[Picture(self.plot(**labels), self.CAPTION)],
            notes=self.advice,
        )
        if self.curve_accuracy:
            add_curves(report, self)


def add_curves(report: Report, of: Any) -> None:
    """Add a section on the errors by curve of a fit or a score, with a figure for many curves."""
    columns, rows, title = curve_table(of.curve_accuracy)
    pictures: Sequence[Picture] = ()
    if len(rows) < len(of.curve_accuracy):
        caption = "Root-mean-square and largest error of each curve, in the order of the record."
        pictures = [Picture(of.plot(part="curves"), caption)]
    report.add(
        "Errors by curve",
        text=f"{title[0].upper()}{title[1:]}.",
        table=Table(columns, rows),
        pictures=pictures,
    )
