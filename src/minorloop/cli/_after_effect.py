"""``minorloop identify --creep``: a model whose output changes with time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.identification import AfterEffectIdentification
    from minorloop.lab.records import Record
    from minorloop.report import Report

NONE = "none"
LEVELS = 25
"""Bands, unless given, as in `identify_after_effect`."""
_REFUSED: dict[str, Any] = {
    "dynamics": NONE,
    "lag": None,
    "relay": "bipolar",
    "slope": None,
    "signed": False,
    "prior": None,
    "noise": None,
    "sd": None,
    "mean": "zero",
    "holdout": 0.0,
    "groups": None,
    "rank": False,
}
"""Options of ``identify`` that a fit with times does not have, and their defaults."""
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


def refuse_others(given: dict[str, Any]) -> None:
    """Refuse options of `identify` that cannot be combined with creep.

    Raises
    ------
    ParameterError
        If one of them is not the default.
    """
    for name, default in _REFUSED.items():
        if given[name] != default:
            raise ParameterError(
                f"--{name} cannot be combined with --creep or --rate; leave one of them out"
            )


def run(
    data: TimedData,
    options: dict[str, Any],
    save: Path | None,
    report: Path | None,
    force: bool,
    as_json: bool,
) -> None:
    """Identify, write the model and the report, and print what time explains."""
    from minorloop import modelfile
    from minorloop.identification import identify_after_effect
    from minorloop.modelfile import Provenance

    record, labels = _record(data)
    began = time.perf_counter()
    with _common.working("identifying") as now:
        found = identify_after_effect(
            record.t, record.u, record.y, curves=labels, progress=now, **options
        )
    seconds = time.perf_counter() - began
    if save is not None:
        modelfile.save(
            found,
            save,
            provenance=Provenance.of(data.file),
            input=record.input,
            output=record.output,
            force=force,
        )
    if report is not None:
        with _common.working("drawing the report"):
            _common.write_report(lambda: report_of(found, record, data.file), report, force=force)
    if as_json:
        _common.print_json(_figures(found, seconds))
    else:
        _print(found, record, seconds)
        for path, what in ((save, "model"), (report, "report")):
            if path is not None:
                typer.echo(f"{what} written to {path}")
    if found.warnings:
        raise typer.Exit(_DISTRUSTED)


def _record(data: TimedData) -> tuple[Record, Any]:
    """Return the rows to be fitted, and the label of the curve of each."""
    if data.input is None or data.output is None or data.time is None:
        missing = {"--input": data.input, "--output": data.output, "--time": data.time}
        name = next(option for option, value in missing.items() if value is None)
        raise ParameterError(
            f"{name} is missing; --creep and --rate need the columns of input, output and time"
        )
    from minorloop.lab.records import Record

    labels = [] if data.curves is None else [data.curves]
    with _common.working(f"reading {data.file.name}") as now:
        log = _common.read_log(
            data.file, data.input, data.output, data.time, now, labels=labels, needed=True
        )
    record = log.record
    part = _common.as_rows(data.rows, len(record))
    chosen = None if data.curves is None else log.labels[data.curves][part]
    columns = record.t[part], record.u[part], record.y[part]
    return Record(*columns, record.input, record.output), chosen


def rows_of(found: AfterEffectIdentification) -> list[tuple[str, str]]:
    """Return the lines of the table that is printed."""
    lines = str(found).splitlines()
    return [(line[:24].strip(), line[25:]) for line in lines if not line.startswith("advice: ")]


def _figures(found: AfterEffectIdentification, seconds: float) -> dict[str, Any]:
    model = found.model
    return {
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
        "advice": list(found.advice),
        "warnings": list(found.warnings),
        "seconds": seconds,
    }


def _print(found: AfterEffectIdentification, record: Record, seconds: float) -> None:
    rows = [*rows_of(found), ("time", f"{seconds:.2f} s")]
    bands = found.model.plane.bands
    title = f"{record.output} against {record.input} and time: Preisach, {bands} bands"
    _common.print_table(("", ""), rows, title)
    _common.print_advice(list(found.advice))


def report_of(found: AfterEffectIdentification, record: Record, source: Path) -> Report:
    """Return the report: what time explains, the laws that were compared, and figures."""
    from minorloop.drawing import draw
    from minorloop.report import Picture, Report, Table

    share = 1 - (found.left_out_error / found.without_time) ** 2 if found.without_time else 0.0
    report = Report(
        f"{record.output} against {record.input} and time",
        f"Identified from {int(found.fitted.sum())} rows of {source.name}. On rows that were left "
        f"out, the error is {found.left_out_error:.3%} of the range, and {found.without_time:.3%} "
        f"without time: time explains {max(share, 0.0):.0%} of what hysteresis leaves.",
    )
    labels = {"input_label": str(record.input), "output_label": str(record.output)}
    report.add(
        "Result",
        table=Table(("", ""), rows_of(found)),
        pictures=[Picture(draw(found, **labels), "Record, loop, residual, and laws compared.")],
        notes=found.advice,
    )
    report.add(
        "Model",
        text="The loop of inputs that are held for long, and how the output settles in holds.",
        pictures=[Picture(draw(found.model, **labels), "Settled loop, and holds on the way down.")],
    )
    return report
