"""``minorloop simulate``: outputs for the inputs in a CSV file."""

from math import isnan
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._identification import RecordOptions, RecordReader
from minorloop.errors import counted

NAME = "simulate"
EXAMPLE = "minorloop simulate model.json inputs.csv --input voltage --save predicted.csv"


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

    reader = RecordReader.of(record, groups=None, sd=None, rows=None, skip=0)
    curves, between = reader.curves, reader.between
    since: Any = reader.start_of_curve
    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        log = scoring.read_inputs(
            known, file, input, time=_common.named(time), curves=curves, start_of_curve=since
        ).replace(start=reader.start)
        now(f"simulating {len(log)} samples")
        found = scoring.simulate(known, log, between=between)  # type: ignore[arg-type]
    y, output = found.y, str(known.output)
    columns: dict[str, Any] = {} if found.t is None else {str(log.time): found.t}
    if curves is not None and log.curves is not None:
        columns[curves] = log.curves
    header = output if known.output != known.input else f"predicted {output}"
    cells = ["" if isnan(value) else value for value in y.tolist()]
    columns |= {str(known.input): found.u, header: cells}
    _common.print_warnings(known.warnings)
    notes = [*log.origin.chosen, *found.notes, *found.of_levels]
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
