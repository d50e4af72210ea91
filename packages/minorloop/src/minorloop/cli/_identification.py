"""Identification from a file on the command line: what is read, printed and written."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.errors import ParameterError, counted

if TYPE_CHECKING:
    from minorloop.identification.data_sheet import DataSheetModel
    from minorloop.identification.pipeline import Law
    from minorloop.identification.result import Fit, Scored
    from minorloop.lab.records import Record
    from minorloop.modelfile import Provenance
    from minorloop.report import Report

DISTRUSTED = 1
"""Exit status after warnings: the result is written, but the model is not to be trusted."""
PRINTED = (
    "context",
    "save",
    "force",
    "as_json",
    "verbose",
    "input",
    "output",
    "from_loop",
    "field",
)
"""Options that can be combined with all others, or are refused elsewhere."""
OF_RECORD = (*PRINTED, "file", "time", "rows", "skip", "report")
"""Those that can be combined with all others about a record."""
UNKNOWN = "unknown"
"""Value of --oscillator for a law of which nothing is known."""
Rows = Sequence[tuple[str, str]]


def refuse_others(context: typer.Context, taken: Sequence[str], options: str) -> None:
    """Refuse options of `identify` that cannot be combined with some ``options``.

    Raises a `ParameterError` if one that is not among those ``taken`` is not the default.
    """
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.params.get(name) != parameter.get_default(context) and name not in taken:
            what = "a file" if name == "file" else f"--{name.replace('_', '-')}"
            raise ParameterError(f"{what} cannot be combined with {options}; leave one of them out")


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
class Outputs:
    """Where model and report are written, whether they may replace files, and how to print."""

    save: Path | None
    report: Path | None
    force: bool
    as_json: bool
    verbose: bool

    def finish(self, found: Fit[Any], provenance: Provenance, seconds: float) -> None:
        """Write the model and the report of an identification, and print what was found."""
        steps: list[Callable[[], None]] = []
        if self.save is not None:
            steps.append(partial(self._save, found, self.save, provenance))
        if self.report is not None:
            draw = partial(found.report, str(provenance.data))
            steps.append(partial(self.write_report, draw, self.report))
        # Files first: the reader of the output may end.
        _common.do_all([*steps, partial(self._print, found, seconds)])
        if found.warnings:
            raise typer.Exit(DISTRUSTED)

    def finish_sheet(self, found: DataSheetModel, input: str, output: str) -> None:
        """Write and print a model that was made from a data sheet, of columns of these names."""
        from minorloop import modelfile

        def save(path: Path) -> None:
            modelfile.save(found, path, input=input, output=output, force=self.force)
            if not self.as_json:
                typer.echo(f"model written to {path}")

        def show() -> None:
            if self.as_json:
                _common.print_json(found.figures)
            else:
                title = f"{output} against {input}: Preisach, {found.model.bands} bands"
                self.show(found, title)

        _common.do_all([*([partial(save, self.save)] if self.save else []), show])

    def _save(self, found: Fit[Any], path: Path, provenance: Provenance) -> None:
        found.save(path, provenance=provenance, force=self.force)
        if not self.as_json:
            typer.echo(f"model written to {path}")

    def write_report(self, draw: Callable[[], Report], path: Path) -> None:
        """Draw a report, write it and say so."""
        with _common.working("drawing the report"):
            _common.write_report(draw, path, force=self.force)
        if not self.as_json:
            typer.echo(f"report written to {path}; open it in a browser")

    def _print(self, found: Fit[Any], seconds: float) -> None:
        with _common.working("scoring"):
            figures = found.figures if self.as_json else {}
            rows = [] if self.as_json else found.summary(slow=self.verbose)
        if self.as_json:
            _common.print_json({**figures, "seconds": seconds})
            return
        names = found.record and (str(found.record.input), str(found.record.output))
        self.show(found, found.headline(*names or ()), [*rows, ("time", f"{seconds:.2f} s")])
        if count := len(found.warnings):
            which = "the first of these says" if count == 1 else f"the first {count} of these say"
            typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)

    def show(
        self, found: Scored, title: str, rows: Rows | None = None, notes: Sequence[str] = ()
    ) -> None:
        """Print scores and advice, or without -v the first scores, warnings and a verdict.

        Parameters
        ----------
        found : Scored
            What was found.
        title : str
            Of the table.
        rows : sequence of (str, str), optional
            All rows of the table; those of the result if not given.
        notes : sequence of str
            What is printed behind the advice.
        """
        from minorloop.identification.accuracy import curve_table
        from minorloop.identification.result import FIRST

        rows = found.summary() if rows is None else rows
        _common.print_table(("", ""), rows if self.verbose else rows[:FIRST], title)
        if not self.verbose:
            _common.print_advice(found.warnings)
            if not found.warnings:
                _common.print_sentence(f"verdict: {found.verdict}")
            typer.echo("-v shows all scores and advice")
            return
        if found.curve_accuracy:
            _common.print_table(*curve_table(found.curve_accuracy))
        for line in found.details:
            typer.echo(line)
        _common.print_advice([*found.advice, *notes])


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


def identify(
    data: Data,
    law: Law[Any],
    of_record: Mapping[str, Any],
    prior: Any = "auto",
    holdout: float = 0.0,
    timed: str = "",
) -> tuple[Any, Provenance, float]:
    """Read a record and identify a law from it.

    Parameters
    ----------
    data : Data
        Where the record is.
    law, prior, holdout
        As of `minorloop.identify`.
    of_record : mapping
        Parameters of `Record`.
    timed : str
        Options of the command line that need times.

    Returns
    -------
    (Fit, Provenance, float)
        The result, the file as it was read, and the seconds.
    """
    with data.read(timed) as (record, say):
        from minorloop.modelfile import Provenance

        provenance = Provenance.of(data.file)
        began = time.perf_counter()
        found = law.identify(record.replace(**of_record), prior, holdout, say)
        return found, provenance, time.perf_counter() - began
