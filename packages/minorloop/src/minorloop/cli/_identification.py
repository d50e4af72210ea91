"""Identification from a file on the command line: what is read, printed and written."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.errors import ParameterError, RecordError, counted

if TYPE_CHECKING:
    from minorloop.identification import (
        AfterEffectIdentification,
        DynamicIdentification,
        Identification,
    )
    from minorloop.identification.oscillator_result import OscillatorIdentification
    from minorloop.lab.records import Record
    from minorloop.modelfile import Provenance
    from minorloop.report import Report

_MOST_RANKED = 3000
"""Unknowns up to which the rank is computed without --rank. 3000 take 40 s, and the time grows with
their cube."""
_DISTRUSTED = 1
"""Exit status after warnings: the model is written, but is not to be trusted."""
_ALWAYS = frozenset({"context", "file", "input", "output", "time", "rows", "skip"})
_ALWAYS |= {"from_loop", "field", "save", "report", "force", "as_json"}
"""Options that can be combined with all others, or are refused elsewhere."""
UNKNOWN = "unknown"
"""Value of --oscillator for a law of which nothing is known."""
Rows = Sequence[Sequence[str]]


def refuse_others(context: typer.Context, taken: Sequence[str], options: str) -> None:
    """Refuse options of `identify` that cannot be combined with some ``options``.

    Raises a `ParameterError` if one that is not among those ``taken`` is not the default.
    """
    for parameter in context.command.params:
        name = parameter.name or ""
        other = context.params.get(name) != parameter.get_default(context)
        if other and name not in {*taken, *_ALWAYS}:
            raise ParameterError(
                f"--{name.replace('_', '-')} cannot be combined with {options}; leave one of them "
                "out"
            )


@dataclass(frozen=True)
class Data:
    """A file, its columns as `minorloop.read` names them, and the rows A:B that are used."""

    file: Path
    columns: Mapping[str, Any]
    rows: str | None

    @contextmanager
    def read(self, timed: str = "") -> Iterator[tuple[Record, Callable[[str], None]]]:
        """Yield the record, with the rows to be fitted, and what shows progress.

        Raises
        ------
        ParameterError
            If the record has no times, which the options ``timed`` need.
        RecordError
            If the times of these rows do not increase, and are needed.
        """
        with _common.working(f"reading {self.file.name}") as now:
            record = _common.read_record(self.file, self.columns, now)
            part, origin = _common.as_rows(self.rows, len(record)), record.origin
            if timed:
                if record.check is None:
                    raise ParameterError(
                        f"--time is missing; {timed} needs the columns of input, output and time"
                    )
                column = str(origin.time_column)
                _common.check_order(self.file, column, record.check, part=part, rows=origin.rows)
            doing = f"identifying from {counted(part.stop - part.start, 'row')}"
            now(doing)
            with compilation_said(lambda sentence: now(sentence, kept=True)):
                yield record.only(part.start, part.stop), lambda stage: now(f"{doing}: {stage}")


@dataclass(frozen=True)
class Done:
    """The result of an identification, its record, its file as it was read, and the seconds."""

    found: Any
    record: Record
    provenance: Provenance
    seconds: float


@dataclass(frozen=True)
class Printout:
    """What is printed and written of an identification."""

    found: Any
    """The result, with its advice and warnings."""
    title: str
    rows: Rows
    """``title`` and ``rows``: of the table."""
    figures: Mapping[str, Any]
    """What ``--json`` prints beside advice and warnings."""
    report: Callable[..., Report]
    """Makes the report, with the options ``source``, ``input_label`` and ``output_label``."""
    saved: Any = None
    """What a model file keeps; the result if None."""
    tables: tuple[tuple[Sequence[str], Rows, str], ...] = ()
    """Headings, rows and title of further tables."""
    said: tuple[str, ...] = ()
    """Lines behind the tables."""


@dataclass(frozen=True)
class Outputs:
    """Where model and report are written, whether they may replace files, and how to print."""

    save: Path | None
    report: Path | None
    force: bool
    as_json: bool

    def finish(self, printout: Printout, done: Done) -> None:
        """Write the model and the report of an identification, and print what was found."""
        steps: list[Callable[[], None]] = []
        if self.save is not None:
            steps.append(partial(self._save, self.save, printout, done))
        if self.report is not None:
            steps.append(partial(self._report, self.report, printout, done))
        # Files first: the reader of the output may end.
        _common.do_all([*steps, partial(self._print, printout, done.seconds)])
        if printout.found.warnings:
            raise typer.Exit(_DISTRUSTED)

    def _save(self, path: Path, printout: Printout, done: Done) -> None:
        from minorloop import modelfile

        modelfile.save(
            printout.found if printout.saved is None else printout.saved,
            path,
            provenance=done.provenance,
            input=done.record.input,
            output=done.record.output,
            warnings=printout.found.warnings,
            force=self.force,
        )
        if not self.as_json:
            typer.echo(f"model written to {path}")

    def _report(self, path: Path, printout: Printout, done: Done) -> None:
        record = done.record
        labels = {"input_label": str(record.input), "output_label": str(record.output)}
        draw = partial(printout.report, source=str(done.provenance.data), **labels)
        with _common.working("drawing the report"):
            _common.write_report(draw, path, force=self.force)
        if not self.as_json:
            typer.echo(f"report written to {path}; open it in a browser")

    def _print(self, printout: Printout, seconds: float) -> None:
        found = printout.found
        if self.as_json:
            said = {"advice": list(found.advice), "warnings": list(found.warnings)}
            _common.print_json({**printout.figures, "seconds": seconds, **said})
            return
        rows = [*printout.rows, ("time", f"{seconds:.2f} s")]
        for table in ((("", ""), rows, printout.title), *printout.tables):
            _common.print_table(*table)
        for line in printout.said:
            typer.echo(line)
        _common.print_advice(found.advice)
        if count := len(found.warnings):
            which = "the first of these says" if count == 1 else f"the first {count} of these say"
            typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)


def of_plane(
    result: Identification, record: Record, dynamic: DynamicIdentification | None, rank: bool
) -> Printout:
    """Return what is said of a plane, and of its dynamics if it has some."""
    from minorloop.identification.scores import OF_OPERATOR, curve_table, score_rows
    from minorloop.report import identification_report

    with _common.working("scoring"):
        figures = _figures(result, rank) | ({} if dynamic is None else _dynamic_figures(dynamic))
    number = figures["rank"]
    rows = score_rows(result, rank="not computed (--rank)" if number is None else f"{number}")
    if result.lag_seconds:
        lag = f"{counted(result.lag_of_model, 'sample')}, {result.lag_seconds:.4g} s"
        rows = [(name, lag if name == "lag" else value) for name, value in rows]
    if dynamic is not None:
        rows = [*dynamic.rows, *(row for row in rows if row[0] in OF_OPERATOR)]
    if left_out := result.of_record.left_out:
        rows.append(("outliers left out", ", ".join(f"hold {k + 1}" for k in left_out)))
    rows.append(("standard deviation predicted", f"{figures['band_sd']:.3g}"))
    found = result if dynamic is None else dynamic
    tried = () if dynamic is None else dynamic.tried
    return Printout(
        found,
        f"{record.output} against {record.input}: Preisach, {figures['levels']} bands",
        rows,
        {**figures, "chosen": list(found.chosen)},
        partial(identification_report, result, dynamic=dynamic, time=result.t),
        result if dynamic is None or not dynamic.dynamic else dynamic,
        (curve_table(result.curve_accuracy),) if result.curve_accuracy else (),
        (*(f"tried {one}" for one in tried), *(f"chosen {text}" for text in found.chosen)),
    )


def _figures(result: Identification, rank: bool) -> dict[str, Any]:
    from minorloop.identification.accuracy import scores_of

    held = result.holdout_accuracy is not None
    known = rank or result.unknowns <= _MOST_RANKED
    return {
        **scores_of(result.accuracy, result.holdout_accuracy),
        "curves": [asdict(curve) for curve in result.curve_accuracy],
        "free_parameters": result.free_parameters,
        "effective_parameters": result.effective_parameters,
        "baseline_nrmse_holdout": result.baseline_nrmse if held else None,
        "baseline_nrmse": result.baseline_nrmse,
        "rmse_train": result.rmse,
        "lag_samples": result.lag_of_model,
        "lag_s": result.lag_seconds or None,
        "nrmse_groups": result.groups_nrmse,
        "samples": result.samples,
        "skipped": result.skipped,
        "held_out": int(result.held_out.sum()),
        "left_out": list(result.of_record.left_out),
        "choices": [asdict(choice) for choice in result.choices],
        "jumps": [asdict(jump) for jump in result.jumps],
        "residual": asdict(result.residual),
        "levels": result.model.bands,
        "unknowns": result.unknowns,
        "rank": result.rank if known else None,
        "condition": result.condition if known else None,
        "excited_fraction": result.excited_fraction,
        "smoothness": result.smoothness,
        "prior": "none" if result.posterior is None else "gaussian",
        "ridge": None if result.ridge is None else asdict(result.ridge),
        "band_sd": result.band_sd,
        "sd": result.of_record.sd,
        "codes": [code.sample for code in result.codes],
        "suspects": list(result.suspects),
        "kkt": result.kkt,
        "range": list(result.model.range),
    }


def _dynamic_figures(found: DynamicIdentification) -> dict[str, Any]:
    """Return the errors of the whole model, and its dynamics."""
    from minorloop.modelfile import plain

    model = found.model
    return {
        **found.scores,
        "dynamics": {
            "first": model.first,
            "ahead": None if model.ahead is None else plain(model.ahead),
            "numerator": model.linear.numerator,
            "denominator": model.linear.denominator,
            "dead_time": model.linear.delay,
            "time_constants": model.linear.time_constants,
            "creep": None if model.creep is None else plain(model.creep),
            "tried": [asdict(one) for one in found.tried],
        },
    }


def of_viscosity(found: AfterEffectIdentification, record: Record) -> Printout:
    """Return what is said of a law of time in the plane."""
    from minorloop.report import after_effect_report

    model = found.model
    figures = {
        **found.scores,
        "law": found.law,
        "laws": {one.law: one.error for one in found.tried},
        "field": model.field,
        "settling": model.settling,
        "times": model.times,
        "creep": [float(one.sum()) for one in model.creep],
        "range": list(model.range),
        "samples": int(found.fitted.sum()),
        "levels": model.plane.bands,
    }
    title = f"{record.output} against {record.input} and time: Preisach, {model.plane.bands} bands"
    return Printout(found, title, found.rows, figures, partial(after_effect_report, found))


def of_vibration(found: OscillatorIdentification, record: Record) -> Printout:
    """Return what is said of an oscillator."""
    from minorloop.report import oscillator_report

    figures = {
        **found.scores,
        "noise": found.noise,
        "parameters": dict(zip(found.names, found.parameters.tolist(), strict=True)),
        "standard_deviations": dict(zip(found.names, found.sd.tolist(), strict=True)),
        "levels": {str(one.levels): one.error for one in found.tried},
        "converged": found.converged,
        "samples": int(found.record.scored.sum()),
    }
    title = f"{record.output} of an oscillator with hysteresis, driven by {record.input}"
    return Printout(found, title, found.rows, figures, partial(oscillator_report, found))


def rough_oscillator(start: str) -> Any:
    """Return the oscillator in a model file, or ``unknown``.

    Raises a `ParameterError` if the file has another model.
    """
    from minorloop import modelfile
    from minorloop.dynamics.oscillator import Oscillator

    if start == UNKNOWN:
        return start
    if not Path(start).exists():
        raise ParameterError(
            f"--oscillator is {start!r}; give unknown, or a model file with a rough oscillator, "
            "which minorloop.save writes"
        )
    known = modelfile.read(start)
    if not isinstance(known.model, Oscillator):
        raise ParameterError(
            f"{start} has a model of kind {known.kind!r}; give one with a rough oscillator, which "
            "minorloop.save writes, or unknown"
        )
    return known.model


def check_units(record: Record) -> None:
    """Refuse units in which mass and damping would not be those of the SI."""
    for quantity, unit in ((record.input, "N"), (record.output, "m")):
        if quantity.unit not in ("", unit):
            raise RecordError(
                f"{quantity.name} is in {quantity.unit}; an oscillator is identified from forces "
                f"in N and displacements in m, so convert the column to {unit}"
            )


def identify(
    data: Data, law: Callable[..., Any], options: Mapping[str, Any], timed: str = ""
) -> Done:
    """Read a record and identify a law from it.

    Parameters
    ----------
    data : Data
        Where the record is.
    law : callable
        Takes the record and what shows progress, and returns the result.
    options : mapping
        Parameters of `Record`.
    timed : str
        Options of the command line that need times.
    """
    with data.read(timed) as (record, say):
        from minorloop.modelfile import Provenance

        provenance = Provenance.of(data.file)
        began = time.perf_counter()
        found = law(record.replace(**options), say)
        return Done(found, record, provenance, time.perf_counter() - began)
