"""``minorloop reduce``: settled points from a raw log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.lab.conversion import Conversion
    from minorloop.lab.records import Quantity
    from minorloop.lab.reduction import Reduction

NAME = "reduce"
EXAMPLE = (
    'minorloop reduce log.csv --input "voltage [V]" --output distance --laser 20,15,0.02,0.05 '
    "--save points.csv --report reduced.html"
)
_POWERS = range(2, 21)

_Log = Annotated[Path, typer.Argument(help="Raw log: samples of input and sensor.")]
_Input = Annotated[str, typer.Option(help="Column of the input, such as 'voltage [V]'.")]
_Output = Annotated[str, typer.Option(help="Column of the sensor; an empty cell: not measured.")]
_Polynomial = Annotated[
    str | None,
    typer.Option(metavar="C0,C1,...", help="Convert by a polynomial, from the constant on."),
]
_Linear = Annotated[
    str | None, typer.Option(metavar="GAIN,OFFSET", help="Convert by gain times reading + offset.")
]
_Table = Annotated[
    Path | None,
    typer.Option(help="Convert by a table: a file with two columns, reading and value."),
]
_Name = Annotated[str | None, typer.Option(help="Name of the converted output.")]
_Unit = Annotated[str | None, typer.Option(help="Unit of the converted output.")]
_CalibrationSd = Annotated[
    float,
    _common.number_option("Standard deviation of the calibration, in the unit of the output."),
]
_Flip = Annotated[bool, typer.Option("--flip", help="Change the sign of the output.")]
_FlipInput = Annotated[bool, typer.Option("--flip-input", help="Change the sign of the input.")]
_Range = Annotated[
    str | None,
    typer.Option(metavar="LOW:HIGH", help="Range of the sensor; readings beyond are not used."),
]
_Tolerance = Annotated[
    float | None,
    _common.number_option("Slope of a settled output per second; 0.2 % of the span in a hold."),
]
_InputTolerance = Annotated[
    float | None,
    _common.number_option("Changes of the input up to this size are noise; estimated."),
]
_Shortest = Annotated[float, _common.number_option("Shortest hold, in seconds.")]
_Keep = Annotated[
    bool,
    typer.Option("--keep-unsettled", help="Write the outputs of holds that have not settled too."),
]
_Report = Annotated[Path | None, typer.Option(help="Write an HTML report to this file.")]


def run(
    file: _Log,
    input: _Input,
    output: _Output,
    time: _common.Time = None,
    laser: _common.Laser = None,
    linear: _Linear = None,
    polynomial: _Polynomial = None,
    table: _Table = None,
    name: _Name = None,
    unit: _Unit = None,
    calibration_sd: _CalibrationSd = 0.0,
    flip: _Flip = False,
    flip_input: _FlipInput = False,
    range: _Range = None,
    tolerance: _Tolerance = None,
    input_tolerance: _InputTolerance = None,
    shortest: _Shortest = 0.0,
    keep_unsettled: _Keep = False,
    save: _common.Save = None,
    report: _Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Reduce a raw log to settled points: one for each hold of the input."""
    from minorloop.lab.reduction import reduce

    _common.check_outputs([save, report], inputs=[file], force=force)
    chosen = {"laser": laser, "linear": linear, "polynomial": polynomial, "table": table}
    named = {"name": name, "unit": unit, "calibration_sd": calibration_sd}
    limits = _limits(range)
    with _common.working(f"reading {file.name}") as now:
        log = _common.read_log(file, input, output, time, now, needed=True)
        record = log.record
        now(f"reducing {len(record)} samples")
        reduction = reduce(
            record,
            conversion=_conversion(chosen, named, record.output),
            flip=flip,
            flip_input=flip_input,
            limits=limits,
            tolerance=tolerance,
            input_tolerance=input_tolerance,
            shortest=shortest,
            breaks=log.check.breaks if log.check else (),
        )
    if not keep_unsettled and not reduction.count("settled") + reduction.count("extrapolated"):
        raise RecordError(
            f"none of the {reduction.count('unsettled')} holds settled: hold longer; if the input "
            "never rests, identify the record as it is; --keep-unsettled takes the outputs all the "
            "same"
        )
    said = [*log.notes, *reduction.notes]
    steps: list[Callable[[], None]] = [partial(_show, reduction, said, as_json)]
    # Files first: the reader of the output may end.
    if report is not None:
        steps.insert(0, partial(_report, reduction, said, file, report, force, as_json))
    if save is not None:
        steps.insert(0, partial(_save, reduction, keep_unsettled, save, force, as_json))
    _common.do_all(steps)


def _conversion(
    chosen: dict[str, Any], named: dict[str, Any], reading: Quantity
) -> Conversion | None:
    from minorloop.lab.conversion import CalibrationPolynomial, CalibrationTable

    given = [name for name, value in chosen.items() if value is not None]
    if len(given) > 1:
        raise ParameterError(f"--{given[0]} and --{given[1]} are given; give one conversion")
    if given == ["laser"]:
        if any(named.values()):
            raise ParameterError(
                "--laser gives curvature [1/m]; leave --name, --unit and --calibration-sd out"
            )
        return _common.laser_curvature(chosen["laser"], reading.unit)
    if given == ["table"]:
        found = CalibrationTable.from_csv(chosen["table"], calibration_sd=named["calibration_sd"])
        return replace(found, name=named["name"] or found.name, unit=named["unit"] or found.unit)
    coefficients: tuple[float, ...] = (0.0, 1.0)
    if given == ["linear"]:
        gain, *offset = _common.numbers("linear", chosen["linear"], (1, 2), "GAIN,OFFSET")
        coefficients = (*(offset or [0.0]), gain)
    elif given == ["polynomial"]:
        coefficients = tuple(
            _common.numbers("polynomial", chosen["polynomial"], _POWERS, "C0,C1,...")
        )
    elif not any(named.values()):
        return None
    return CalibrationPolynomial(**named, coefficients=coefficients)


def _limits(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise ParameterError(f"--range is {text!r}; give LOW:HIGH, such as 10:30") from None
    return low, high


def _save(reduction: Reduction, keep: bool, path: Path, force: bool, as_json: bool) -> None:
    reduction.to_csv(path, unsettled=keep, force=force)
    if not as_json:
        typer.echo(f"points written to {path}")


def _show(reduction: Reduction, notes: list[str], as_json: bool) -> None:
    if as_json:
        _common.print_json(
            {
                "samples": len(reduction.log),
                "holds": len(reduction) - reduction.count("passed"),
                **{
                    verdict: reduction.count(verdict)
                    for verdict in ("settled", "extrapolated", "unsettled", "passed")
                },
                "points": reduction.columns(unsettled=True),
                "notes": notes,
            }
        )
        return
    _common.print_table(("", ""), reduction.summary(), str(reduction))
    _common.print_advice(notes)


def _report(
    reduction: Reduction, notes: list[str], file: Path, path: Path, force: bool, as_json: bool
) -> None:
    from minorloop.report import reduction_report

    draw = partial(reduction_report, reduction, source=file.name, notes=notes)
    with _common.working("drawing the report"):
        _common.write_report(draw, path, force=force)
    if not as_json:
        typer.echo(f"report written to {path}; open it in a browser")
