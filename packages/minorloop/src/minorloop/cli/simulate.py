"""``minorloop simulate``: outputs for the inputs in a CSV file."""

from __future__ import annotations

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._identification import RecordOptions, RecordReader
from minorloop.errors import ParameterError, counted

NAME = "simulate"
EXAMPLE = "minorloop simulate model.json inputs.csv --input voltage --save predicted.csv"


if TYPE_CHECKING:
    from minorloop.lab.records import Record
    from minorloop.modelfile import ModelFile


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    input: Annotated[
        str | None,
        typer.Option(
            help="Column of the input, in the unit of the model.",
            show_default="the name that it has in the model",
        ),
    ] = None,
    time: _common.Time = None,
    record: RecordOptions = None,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Predict the output for the inputs in a file, lag and dynamics included."""
    _common.check_outputs([save], inputs=[model, file], force=force)
    from numpy import nanmax, nanmin

    from minorloop import modelfile, scoring
    from minorloop.identification.curves import AS_LEFT
    from minorloop.lab.logs import check_order

    reader = RecordReader.of(record, groups=None, sd=None, rows=None, skip=0)
    curves, between = reader.curves, reader.between
    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        log = _inputs(known, file, known.input.name if input is None else input, time, curves)
        if curves is not None and reader.start_of_curve != AS_LEFT:
            log = log.with_memory_reset()
        if log.check is not None:
            check_order(file, str(time), log.check, strictly=known.has_time)
        now(f"simulating {len(log)} samples")
        log = log.replace(start=reader.start, start_of_curve=reader.start_of_curve)
        found = scoring.simulate(known, log, between=between)  # type: ignore[arg-type]
    y, output = found.y, str(known.output)
    columns: dict[str, Any] = {} if found.t is None else {str(log.time): found.t}
    if curves is not None and log.curves is not None:
        columns[curves] = log.curves
    header = output if known.output != known.input else f"predicted {output}"
    cells = ["" if isnan(value) else value for value in y.tolist()]
    columns |= {str(known.input): found.u, header: cells}
    _common.print_warnings(known.warnings)
    notes = [*found.notes, *found.of_levels]
    figures: dict[str, Any] = {"samples": y.size, "least": nanmin(y), "greatest": nanmax(y)}
    figures |= {} if save is not None else {"y": y}
    figures |= {"notes": notes} if notes else {}

    def show() -> None:
        for note in notes:
            typer.echo(f"note: {note}", err=True)
        unit = f" {known.output.unit}" if known.output.unit else ""
        ends = f"{figures['least']:.6g} to {figures['greatest']:.6g}{unit}"
        typer.echo(f"{counted(y.size, 'sample')} of {known.output.name}, {ends}")
        if save is None:
            typer.echo("nothing was written; --save FILE writes inputs and outputs")

    _common.finish(as_json, lambda: figures, show, _common.table(save, columns, force))


def _inputs(
    known: ModelFile, file: Path, input: str, time: str | None, curves: str | None
) -> Record:
    """Return the inputs of a file with their times and curves; outputs are NaN."""
    from numpy import full, nan

    from minorloop.lab.columns import read_labels
    from minorloop.lab.conversion import read_column
    from minorloop.lab.gaps import with_lost_rows
    from minorloop.lab.logs import read_times
    from minorloop.lab.records import Origin, Record

    if time is None and known.has_time:
        raise ParameterError(
            f"the model has dynamics and needs times; name the column of {file} with --time"
        )
    u = read_column(file, input, known.input.unit)
    labels = None if curves is None else read_labels(file, curves)
    nothing, names = full(u.size, nan), (known.input, known.output)
    if time is None:
        return Record(u, nothing, None, *names, curves=labels)
    clock, check = read_times(file, time)
    origin = Origin(with_lost_rows(check, u), time)
    return Record(u, nothing, check.t, *names, clock, curves=labels, origin=origin)
