"""``minorloop identify``: a model from a record."""

from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.cli._identification import (
    SHEET,
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
from minorloop.errors import ParameterError, counted
from minorloop.values import TextValue, called, numbers

NAME = "identify"
EXAMPLE = (
    'minorloop identify run.csv --input "voltage [V]" --output curvature '
    "--holdout 0.3 --save model.json --report report.html"
)

_Data = Annotated[
    Path | None,
    typer.Argument(
        help="Table with one header line: CSV, .mat or .xlsx; or an experiment store of run. "
        "None with --law sheet.",
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
    file: _Data = None,
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
    _common.check_outputs([save, report], inputs=[file] if file else [], force=force)
    value = law_value(law)
    if value.kind == SHEET:
        names = input or "input", output or "output"
        _of_data_sheet(value, names, save, force, as_json, verbose)
        return
    if file is None:
        raise ParameterError("Missing argument 'file'; see minorloop identify --help")
    from minorloop.modelfile import Provenance

    reader, wanted = RecordReader.of(record, between=None), law_of(value)
    assumed = prior_of(prior)
    with _common.working(f"reading {file.name}") as now:
        log = reader.read(file, input, output, time, now)
        check_times(value.kind, file, log)
        doing = f"identifying from {counted(len(log.t[log.part]), 'row')}"
        now(doing)
        with compilation_said(lambda sentence: now(sentence, kept=True)):
            provenance, began = Provenance.of(file), perf_counter()
            found = wanted.identify(log, assumed, holdout, lambda stage: now(f"{doing}: {stage}"))
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


def _of_data_sheet(
    value: TextValue,
    names: tuple[str, str],
    save: Path | None,
    force: bool,
    as_json: bool,
    verbose: bool,
) -> None:
    """Make a model from the loop of a data sheet, write it and print what it is."""
    from minorloop import modelfile
    from minorloop.identification.data_sheet import from_loop

    loop = numbers(value.what, (3,), "--law sheet", "sheet:HC,BR,BMAX")
    named = dict(zip(("coercivity", "remanence", "saturation"), loop, strict=True))
    with _common.working("drawing ridges with this loop"):
        found = called(from_loop, "--law sheet", value.options, **named)
    kept = partial(modelfile.save, found, input=names[0], output=names[1], force=force)
    title = f"{names[1]} against {names[0]}: Preisach, {found.model.bands} bands"
    file = _common.Written(save, kept, "model written to {}")
    show_scored(found, title, as_json, verbose, file, judged=False)
