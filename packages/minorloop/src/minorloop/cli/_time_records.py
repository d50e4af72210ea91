"""Records with times for ``minorloop identify``, and what is done with a model of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.lab.records import Record
    from minorloop.report import Report

_DISTRUSTED = 1
"""Exit status after warnings, as of ``identify``."""


@dataclass(frozen=True)
class TimedData:
    """Where a record with times is: the file, and the columns of input, output, time and curves."""

    file: Path
    input: str | None
    output: str | None
    time: str | None
    curves: str | None
    rows: str | None

    def read(self, options: str) -> Record:
        """Return the record, with the rows to be fitted.

        Raises
        ------
        ParameterError
            If the record has no times, which ``options`` of the command line need.
        RecordError
            If the times of these rows do not increase.
        """
        columns = {name: getattr(self, name) for name in ("input", "output", "time", "curves")}
        with _common.working(f"reading {self.file.name}") as now:
            record = _common.read_record(self.file, columns, now)
        if record.check is None:
            raise ParameterError(
                f"--time is missing; {options} needs the columns of input, output and time"
            )
        part, origin = _common.as_rows(self.rows, len(record)), record.origin
        name = str(origin.time_column)
        _common.check_order(self.file, name, record.check, part=part, rows=origin.rows)
        return record.only(part.start, part.stop)


_ALWAYS = frozenset({"context", "file", "input", "output", "time", "rows", "skip"})
_ALWAYS |= {"from_loop", "field", "save", "report", "force", "as_json"}
"""Options that can be combined with all others, or are refused elsewhere."""


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
class Outputs:
    """Where model and report are written, whether they may replace files, and how to print."""

    save: Path | None
    report: Path | None
    force: bool
    as_json: bool


def finish(
    found: Any,
    record: Record,
    file: Path,
    outputs: Outputs,
    figures: Mapping[str, Any],
    title: str,
    report_of: Callable[[Any, Record, Path], Report],
) -> None:
    """Write the model and the report of an identification, and print what was found."""
    from minorloop import modelfile
    from minorloop.modelfile import Provenance

    if outputs.save is not None:
        modelfile.save(
            found,
            outputs.save,
            provenance=Provenance.of(file),
            input=record.input,
            output=record.output,
            force=outputs.force,
        )
    if outputs.report is not None:
        with _common.working("drawing the report"):
            _common.write_report(
                lambda: report_of(found, record, file), outputs.report, force=outputs.force
            )
    if outputs.as_json:
        said = {"advice": list(found.advice), "warnings": list(found.warnings)}
        _common.print_json({**figures, **said})
    else:
        rows = [*rows_of(found), ("time", f"{figures['seconds']:.2f} s")]
        _common.print_table(("", ""), rows, title)
        _common.print_advice(list(found.advice))
        for path, what in ((outputs.save, "model"), (outputs.report, "report")):
            if path is not None:
                typer.echo(f"{what} written to {path}")
    if found.warnings:
        raise typer.Exit(_DISTRUSTED)


def rows_of(found: Any) -> list[tuple[str, str]]:
    """Return the rows of the table of a result, label and value."""
    lines = str(found).splitlines()
    return [(line[:24].strip(), line[25:]) for line in lines if not line.startswith("advice: ")]
