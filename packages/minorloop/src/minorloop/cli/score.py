"""``minorloop score``: the errors of a model on another record."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._identification import RecordOptions, RecordReader, show_scored

NAME = "score"
EXAMPLE = "minorloop score model.json other.csv --report score.html"

_Column = typer.Option(show_default="the name that it has in the model")
_SAME = (
    "the model was identified from this file, so its error here says little about other inputs; "
    "score another record, or identify with --holdout 0.3"
)
_Save = Annotated[Path | None, typer.Option(help="Write the residual of each row to this file.")]


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    input: Annotated[str | None, _Column] = None,
    output: Annotated[str | None, _Column] = None,
    time: _common.Time = None,
    record: RecordOptions = None,
    save: _Save = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
    verbose: _common.Verbose = False,
) -> None:
    """Compute the errors of a model on a record that it was not identified from.

    If the model does not predict the record, the exit status is 1.
    """
    _common.check_outputs([save, report], inputs=[model, file], force=force)
    from minorloop import modelfile, scoring
    from minorloop.lab._store_file import is_store

    known = modelfile.read(model)
    if not is_store(file):  # a store has one input and one output
        input, output = input or known.input.name, output or known.output.name
    reader = RecordReader.of(record, sd=_common.NONE)
    between: Any = reader.between
    with _common.working(f"reading {file.name}") as now:
        log = reader.read(file, input, output, time, now)
        if known.provenance.is_of(file):
            log = log.with_origin(notes=(_SAME, *log.origin.notes))
        now(f"scoring {len(log)} samples")
        found = scoring.score(known, log, between=between)
    _common.print_warnings(known.warnings)
    show_scored(
        found,
        f"{model.name} on {file.name}",
        as_json,
        verbose,
        _common.table(save, found.columns(log.time), force, "residuals written to {}"),
        _common.drawn(report, partial(found.report, model.name, file.name), force),
        figures={} if save is not None else {"residuals": found.error},
    )
