"""Identification from a file on the command line: what is read, printed and written."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.errors import ParameterError, counted

if TYPE_CHECKING:
    from minorloop.identification.pipeline import Law
    from minorloop.identification.result import Scored
    from minorloop.modelfile import Provenance
    from minorloop.report import Report

DISTRUSTED = 1
"""Exit status after warnings: the result is written, but the model is not to be trusted."""
PRINTED = (
    *("save", "force", "as_json", "verbose"),
    *("input", "output", "from_loop", "field"),
)
"""Options that can be combined with all others, or are refused elsewhere."""
OF_RECORD = (*PRINTED, "file", "time", "rows", "skip", "report")
"""Those that can be combined with all others about a record."""
UNKNOWN = "unknown"
"""Value of --oscillator for a law of which nothing is known."""


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
class Outputs:
    """What is written and printed of a fit or a score."""

    save: Path | None
    report: Path | None
    force: bool
    as_json: bool
    verbose: bool

    def drawn(self, draw: Callable[[], Report]) -> _common.Written:
        """Return the file of a report."""
        return _common.drawn(self.report, draw, self.force)

    def finish(
        self,
        found: Scored,
        title: str,
        files: Sequence[_common.Written],
        figures: Mapping[str, Any],
        notes: Sequence[str] = (),
    ) -> None:
        """Write files and print what was found.

        Parameters
        ----------
        found : Scored
            What was found.
        title : str
            Of the table.
        files : sequence of Written
            What is written.
        figures : mapping
            What ``--json`` has beside the scores; ``seconds`` is in the table too.
        notes : sequence of str
            What is printed behind the advice.
        """
        # Files first: the reader of the output may end.
        steps = [partial(self._write, one, one.path) for one in files if one.path is not None]
        _common.do_all([*steps, partial(self._print, found, title, figures, notes)])

    def judge(self, found: Scored) -> None:
        """Say where the warnings are, and end with exit status 1 if there are some."""
        count = len(found.warnings)
        if count and not self.as_json:
            which = "the first of these says" if count == 1 else f"the first {count} of these say"
            typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)
        if count:
            raise typer.Exit(DISTRUSTED)

    def _write(self, file: _common.Written, path: Path) -> None:
        file.write(path)
        if not self.as_json:
            typer.echo(file.said.format(path))

    def _print(
        self, found: Scored, title: str, figures: Mapping[str, Any], notes: Sequence[str]
    ) -> None:
        from minorloop.identification.accuracy import curve_table
        from minorloop.identification.result import FIRST

        with _common.working("scoring"):
            scores = found.figures if self.as_json else {}
            rows = [] if self.as_json else found.summary(slow=self.verbose)
        if self.as_json:
            _common.print_json({**scores, **figures})
            return
        if "seconds" in figures:
            rows.append(("time", f"{figures['seconds']:.2f} s"))
        _common.print_table(("", ""), rows if self.verbose else rows[:FIRST], title)
        if self.verbose:
            if found.curve_accuracy:
                _common.print_table(*curve_table(found.curve_accuracy))
            for line in found.details:
                typer.echo(line)
            _common.print_advice([*found.advice, *notes])
        else:
            _common.print_advice(found.warnings)
            if not found.warnings:
                _common.print_sentence(f"verdict: {found.verdict}")
            typer.echo("-v shows all scores and advice")


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
    file: Path,
    columns: Mapping[str, Any],
    rows: str | None,
    law: Law[Any],
    of_record: Mapping[str, Any],
    timed: str = "",
    **options: Any,
) -> tuple[Any, Provenance, float]:
    """Read a record and identify a law from it.

    Parameters
    ----------
    file, columns, rows
        The file, its columns as `minorloop.read` names them, and the rows A:B that are used.
    law : Law
        As of `minorloop.identify`.
    of_record : mapping
        Parameters of `Record`.
    timed : str
        Options of the command line that need times.
    **options
        ``prior`` and ``holdout`` of `minorloop.identify`.

    Returns
    -------
    (Fit, Provenance, float)
        The result, the file as it was read, and the seconds.

    Raises
    ------
    ParameterError
        If the record has no times, which the options ``timed`` need.
    RecordError
        If the times of these rows do not increase, and are needed.
    """
    with _common.working(f"reading {file.name}") as now:
        record = _common.read_record(file, columns, now)
        part, origin = _common.as_rows(rows, len(record)), record.origin
        if timed:
            if record.check is None:
                raise ParameterError(
                    f"--time is missing; {timed} needs the columns of input, output and time"
                )
            column = str(origin.time_column)
            _common.check_order(file, column, record.check, part=part, rows=origin.rows)
        doing = f"identifying from {counted(part.stop - part.start, 'row')}"
        now(doing)
        with compilation_said(lambda sentence: now(sentence, kept=True)):
            from minorloop.modelfile import Provenance

            provenance = Provenance.of(file)
            began = time.perf_counter()
            used = record.only(part.start, part.stop).replace(**of_record)
            found = law.identify(used, say=lambda stage: now(f"{doing}: {stage}"), **options)
            return found, provenance, time.perf_counter() - began
