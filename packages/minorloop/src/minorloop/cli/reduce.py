"""``minorloop reduce``: settled points from a raw log."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import RecordError
from minorloop.values import called, ends, parsed

NAME = "reduce"
EXAMPLE = (
    'minorloop reduce log.csv --input "voltage [V]" --output distance '
    "--convert laser:20,15,0.02,0.05 --save points.csv --report reduced.html"
)

_Log = Annotated[Path, typer.Argument(help="Raw log: samples of input and sensor.")]
_Input = Annotated[str, typer.Option(help="Column of the input, such as 'voltage [V]'.")]
_Output = Annotated[str, typer.Option(help="Column of the sensor; an empty cell: not measured.")]
_Flip = Annotated[
    str | None, typer.Option(help="Change the sign of the output, the input or both.")
]
_Holds = Annotated[
    str,
    typer.Option(
        metavar="KEY=VALUE,...",
        help="range=LOW:HIGH of the sensor, beyond which readings are not used; tolerance: slope "
        "of a settled output per second, 0.2 % of the span in a hold; input_tolerance: changes of "
        "the input that are noise, estimated; shortest hold in seconds.",
    ),
]
_Keep = Annotated[
    bool,
    typer.Option("--keep-unsettled", help="Write the outputs of holds that have not settled too."),
]


def run(
    file: _Log,
    input: _Input,
    output: _Output,
    time: _common.Time = None,
    convert: _common.Convert = None,
    flip: _Flip = None,
    holds: _Holds = "",
    keep_unsettled: _Keep = False,
    save: _common.Save = None,
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Reduce a raw log to settled points: one for each hold of the input."""
    from minorloop.lab.conversion import from_text
    from minorloop.lab.logs import read_log
    from minorloop.lab.reduction import reduce
    from minorloop.report import reduction_report

    _common.check_outputs([save, report], inputs=[file], force=force)
    keys: dict[str, Any] = dict(parsed(holds).options)
    if limits := keys.pop("range", None):
        keys["limits"] = ends(limits, "range", float, "LOW:HIGH, such as 10:30")
    with _common.working(f"reading {file.name}") as now:
        names: dict[str, Any] = {"input": input, "output": output, "time": _common.named(time)}
        progress = _common.reading(file, now)
        record = read_log(file, **names, sd=None, progress=progress)
        if record.origin.why_untimed:
            raise RecordError(record.origin.why_untimed)
        now(f"reducing {len(record)} samples")
        reduction = called(
            reduce,
            "--holds",
            keys,
            record=record,
            conversion=None if convert is None else from_text(convert, record.output),
            flip=flip,
        )
    if not keep_unsettled and not reduction.count("settled") + reduction.count("extrapolated"):
        raise RecordError(
            f"none of the {reduction.count('unsettled')} holds settled: {reduction.remedy}; if the "
            "input never rests, identify the record as it is; --keep-unsettled takes the outputs "
            "all the same"
        )
    said = [*record.notes, *reduction.notes]
    save_points = partial(reduction.to_csv, unsettled=keep_unsettled, force=force)
    draw = partial(reduction_report, reduction, source=file.name, notes=said)

    def show() -> None:
        _common.print_table(("", ""), reduction.summary(), str(reduction))
        _common.print_advice(said)

    _common.finish(
        as_json,
        lambda: {**reduction.to_dict(), "notes": said},
        show,
        _common.Written(save, save_points, "points written to {}"),
        _common.drawn(report, draw, force),
    )
