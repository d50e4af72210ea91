"""``minorloop identify``: a model from a record."""

from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.cli._identification import (
    LawOption,
    PriorOption,
    RecordOptions,
    RecordReader,
    check_times,
    law_of,
    law_value,
    prior_of,
    show_scored,
)
from minorloop.errors import counted

NAME = "identify"
EXAMPLE = (
    'minorloop identify run.csv --input "voltage [V]" --output curvature '
    "--holdout 0.3 --save model.json --report report.html"
)

_Data = Annotated[
    Path,
    typer.Argument(
        help="Table with one header line: CSV, .mat or .xlsx; or an experiment store of run.",
        show_default=False,
    ),
]
_Input = Annotated[
    str | None,
    typer.Option(help="Column of the input: voltage, or the whole header, 'voltage [V]'."),
]
_Output = Annotated[
    str | None, typer.Option(help="Column of the output; an empty cell: not measured.")
]
_Save = Annotated[Path | None, typer.Option(help="Write the model to this file.")]


def run(
    file: _Data,
    input: _Input = None,
    output: _Output = None,
    time: _common.Time = None,
    record: RecordOptions = None,
    law: LawOption = None,
    prior: PriorOption = "auto",
    holdout: _common.Holdout = 0.0,
    save: _Save = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
    verbose: _common.Verbose = False,
) -> None:
    """Identify a hysteresis model from measured data, and say how far to trust it.

    If the model is not to be trusted, it is written with warnings, and the exit status is 1.
    """
    _common.check_outputs([save, report], inputs=[file], force=force)
    value, reader = law_value(law), RecordReader.of(record, between=None)
    reader.check(file, input, output)
    from minorloop.modelfile import Provenance

    chosen = law_of(value)
    assumed = prior_of(prior)
    with _common.working(f"reading {file.name}") as now:
        log = reader.read(file, input, output, time, now)
        check_times(value.kind, file, log)
        doing = f"identifying from {counted(len(log.t[log.part]), 'row')}"
        now(doing)
        with compilation_said(lambda sentence: now(sentence, kept=True)):
            provenance, began = Provenance.of(file), perf_counter()
            found = chosen.identify(log, assumed, holdout, lambda stage: now(f"{doing}: {stage}"))
            seconds = perf_counter() - began
    kept = partial(found.save, provenance=provenance, force=force)
    show_scored(
        found,
        found.headline,
        as_json,
        verbose,
        _common.Written(save, kept, "model written to {}"),
        _common.drawn(report, partial(found.report, str(provenance.data)), force),
        figures={"seconds": seconds},
    )
