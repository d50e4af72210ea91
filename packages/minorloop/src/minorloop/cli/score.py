"""``minorloop score``: the errors of a model on another record."""

from __future__ import annotations

from functools import partial
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._identification import Outputs

NAME = "score"
EXAMPLE = "minorloop score model.json other.csv --report score.html"

if TYPE_CHECKING:
    from minorloop.lab.records import Quantity
    from minorloop.scoring import ModelScore

_Column = typer.Option(show_default="the name that it has in the model")
_Save = Annotated[Path | None, typer.Option(help="Write the residual of each row to this file.")]


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    input: Annotated[str | None, _Column] = None,
    output: Annotated[str | None, _Column] = None,
    time: _common.Time = None,
    start: _common.Start = "negative",
    curves: _common.Curves = None,
    start_of_curve: _common.StartOfCurve = None,
    groups: _common.Groups = None,
    skip: _common.Skip = 0,
    between: _common.Between = None,
    save: _Save = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
    verbose: _common.Verbose = False,
) -> None:
    """Say how near a model is to a record that it was not identified from.

    If the model does not predict the record, the exit status is 1.
    """
    _common.check_outputs([save, report], inputs=[model, file], force=force)
    from minorloop import modelfile, scoring
    from minorloop.lab.store import is_store

    known = modelfile.read(model)
    named = not is_store(file)  # a store has one input and one output
    columns = {
        "input": input or (known.input.name if named else None),
        "output": output or (known.output.name if named else None),
        "time": time,
        "curves": curves,
        "groups": groups,
        "sd": _common.NONE,
    }
    with _common.working(f"reading {file.name}") as now:
        log = _common.read_record(file, columns, now)
        now(f"scoring {len(log)} samples")
        log = log.replace(start=start, start_of_curve=start_of_curve, skip=skip)
        found = scoring.score(known, log, between=between)  # type: ignore[arg-type]
    outputs = Outputs(save, report, force, as_json, verbose)
    files = (
        _common.Written(save, partial(_write, found, log.time, force), "residuals written to {}"),
        outputs.drawn(partial(found.report, model.name, file.name)),
    )
    _common.print_warnings(known.warnings)
    residual = {} if save is not None else {"residuals": found.error}
    title, notes = f"{model.name} on {file.name}", found.simulation.notes
    outputs.finish(found, title, files, residual, notes)
    outputs.judge(found)


def _write(found: ModelScore, time: Quantity, force: bool, path: Path) -> None:
    """Write inputs, outputs and residuals by header; what is not known is empty."""
    known, t = found.simulation.model, found.simulation.t
    columns = {} if t is None else {str(time): t}
    columns |= {str(known.input): found.u, f"measured {known.output}": found.y}
    columns |= {f"predicted {known.output}": found.prediction}
    columns |= {f"residual {known.output}": found.error}
    cells = {
        header: ["" if isnan(value) else value for value in values.tolist()]
        for header, values in columns.items()
    }
    _common.write_csv(path, cells, force=force)
