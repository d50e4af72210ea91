"""``minorloop identify``: a model from a CSV file."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.cli._data_sheet import DataSheet, numbers_of, write_model
from minorloop.cli._identification import (
    Data,
    Outputs,
    check_units,
    identify,
    of_plane,
    of_vibration,
    of_viscosity,
    refuse_others,
    rough_oscillator,
)
from minorloop.errors import ParameterError

NAME = "identify"
EXAMPLE = (
    'minorloop identify run.csv --input "voltage [V]" --output curvature '
    "--holdout 0.3 --save model.json --report report.html"
)
DYNAMICS = ("none", "auto", "operator", "linear")
_BETWEEN = ("band", "straight", "held")
_OF_OSCILLATORS = ("oscillator", "period", "between")
_OF_CREEP = (
    *("creep", "rate", "levels", "spacing", "diagonal", "smoothness"),
    *("start", "curves", "start_of_curve"),
)
"""Options that fits of an oscillator, and fits with time in the plane, have."""

_Data = Annotated[
    Path | None,
    typer.Argument(
        help="Table with one header line: CSV, .mat or .xlsx; or an experiment store of run. "
        "None with --from-loop.",
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
_Spacing = Annotated[
    str, typer.Option(help="Thresholds: uniform, or adaptive (denser where the output is steep).")
]
_Dynamics = Annotated[
    str,
    typer.Option(
        help="none, or auto: dead time, poles and creep too, chosen by the error; operator or "
        "linear: the same, and which of both comes first; needs --time.",
        autocompletion=one_of(DYNAMICS),
    ),
]
_Creep = Annotated[
    str,
    typer.Option(
        help="none, or after-effect by left-out error: auto, thermal (thresholds relax with the "
        "logarithm of time) or spectrum (cells creep); needs --time.",
        autocompletion=one_of(("none", "auto", "thermal", "spectrum")),
    ),
]
_Rate = Annotated[
    bool, typer.Option("--rate", help="Compare viscous relays too; needs --time and two rates.")
]
_Oscillator = Annotated[
    str | None,
    typer.Option(
        help="Hysteresis inside a vibrating structure, input force, output displacement: unknown, "
        "or a model file with a rough oscillator; needs --time.",
        show_default=False,
    ),
]
_Period = Annotated[
    int | None,
    _common.whole_option(
        "With --oscillator: rows after which the record repeats; the first period is settled."
    ),
]
_Between = Annotated[
    str | None,
    typer.Option(
        help="With --oscillator: force between rows: band (no content above half the sampling "
        "rate), straight or held.",
        show_default="band",
        autocompletion=one_of(_BETWEEN),
    ),
]
_Signed = Annotated[
    bool, typer.Option("--signed", help="Allow negative weights, for butterfly loops.")
]
_Noise = Annotated[
    float | None,
    _common.number_option("Standard deviation of a measured output, where known; for the prior."),
]
_Sd = Annotated[
    str | None,
    typer.Option(
        help="Column of the standard deviation of each output, by which it counts; or none.",
        show_default="sd, as reduce writes it, or that of a store",
    ),
]
_Mean = Annotated[
    str, typer.Option(help="Mean of the prior: zero, or ridge (fitted to the record).")
]
_Rows = Annotated[
    str | None,
    typer.Option(
        metavar="A:B", help="Rows to use, counted from 0 after the header, B not included."
    ),
]
_Rank = Annotated[
    bool, typer.Option("--rank", help="Compute the rank for more than 3000 unknowns too.")
]
_FromLoop = Annotated[
    tuple[str, str, str] | None,
    typer.Option(
        metavar="HC BR BMAX",
        help="Make the model from a data sheet instead: coercivity, remanence and saturation.",
    ),
]
_Field = Annotated[
    float | None,
    _common.number_option("With --from-loop: input at saturation; 5 HC if not given."),
]
_Save = Annotated[Path | None, typer.Option(help="Write the model to this file.")]
_Report = Annotated[Path | None, typer.Option(help="Write an HTML report to this file.")]


def run(
    context: typer.Context,
    file: _Data = None,
    input: _Input = None,
    output: _Output = None,
    time: _common.Time = None,
    levels: _common.Levels = None,
    spacing: _Spacing = "uniform",
    relay: _common.Relay = "bipolar",
    diagonal: _common.Diagonal = None,
    lag: _common.Lag = None,
    dynamics: _Dynamics = "none",
    creep: _Creep = "none",
    rate: _Rate = False,
    oscillator: _Oscillator = None,
    period: _Period = None,
    between: _Between = None,
    slope: _common.Slope = None,
    signed: _Signed = False,
    smoothness: _common.Smoothness = "auto",
    prior: _common.Prior = None,
    noise: _Noise = None,
    sd: _Sd = None,
    mean: _Mean = "zero",
    start: _common.Start = "negative",
    rows: _Rows = None,
    holdout: _common.Holdout = 0.0,
    curves: _common.Curves = None,
    start_of_curve: _common.StartOfCurve = None,
    groups: _common.Groups = None,
    skip: _common.Skip = 0,
    rank: _Rank = False,
    from_loop: _FromLoop = None,
    field: _Field = None,
    save: _Save = None,
    report: _Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Identify a hysteresis model from measured data, and say how far to trust it.

    If the model is not to be trusted, it is written with warnings, and the exit status is 1.
    """
    if from_loop is not None:
        loop = numbers_of(from_loop)
        sheet = DataSheet(loop, field, input or "input", output or "output")
        write_model(context, sheet, save, force, as_json)
        return
    if file is None:
        raise ParameterError(
            "Missing argument 'file'; see minorloop identify --help, or give --from-loop HC BR BMAX"
        )
    _common.refuse_given({"field": field}, "is given without --from-loop")
    _common.check_outputs([save, report], inputs=[file], force=force)
    columns = {"input": input, "output": output, "time": time, "curves": curves}
    data, outputs = Data(file, columns, rows), Outputs(save, report, force, as_json)
    strength = _common.number_or_auto("smoothness", smoothness, float)
    if oscillator is not None:
        refuse_others(context, _OF_OSCILLATORS, "--oscillator")
        vibration = partial(_vibration, rough_oscillator(oscillator), period, between or "band")
        done = identify(data, vibration, {"skip": skip}, "--oscillator")
        outputs.finish(of_vibration(done.found, done.record), done)
        return
    _common.refuse_given({"period": period, "between": between}, "is given without --oscillator")
    of_record = {"start": start, "start_of_curve": start_of_curve, "skip": skip}
    if creep != _common.NONE or rate:
        refuse_others(context, _OF_CREEP, "--creep or --rate")
        viscous: Any = True if rate else "auto" if creep == "auto" else False
        kind = (levels, creep, viscous, diagonal or "reversible", spacing)
        viscosity = partial(_viscosity, kind, strength)
        done = identify(data, viscosity, of_record, "a fit with --creep or --rate")
        outputs.finish(of_viscosity(done.found, done.record), done)
        return
    from minorloop.arrays import check_option

    check_option("--dynamics", dynamics, DYNAMICS)
    if sd not in (None, _common.NONE):
        for name, used in (("noise", noise), ("dynamics", dynamics != _common.NONE)):
            if used not in (None, False):
                raise ParameterError(
                    f"--sd cannot be combined with --{name}; leave one of them out"
                )
    options = {
        "levels": levels,
        "spacing": spacing,
        "relay": relay,
        "diagonal": diagonal,
        "slope": slope,
        "signed": signed,
        "smoothness": strength,
        "prior": prior,
        "noise": noise,
        "mean": mean,
        "lag": _common.as_lag(lag),
        "holdout": holdout,
        **of_record,
    }
    data = replace(data, columns={**columns, "sd": sd, "groups": groups})
    done = identify(data, partial(_plane, options, dynamics), {})
    moving = None if dynamics == _common.NONE else done.found
    static = done.found if moving is None else moving.static
    outputs.finish(of_plane(static, done.record, moving, rank), done)


def _plane(options: dict[str, Any], dynamics: str, record: Any, say: Any) -> Any:
    """Identify a plane, with dynamics unless there are none."""
    from minorloop.identification import Dynamics
    from minorloop.identification.pipeline import Options

    asked = Options.of(options)
    if dynamics == _common.NONE:
        return asked.identify(record, say)
    if asked.law.lag not in ("auto", 0):
        raise ParameterError("--dynamics finds the dead time itself; leave --lag out")
    law = Dynamics(asked.law, dynamics)  # type: ignore[arg-type]
    return law.identify(record.replace(**asked.of_record), asked.prior, asked.holdout)


def _viscosity(kind: Any, strength: Any, record: Any, say: Any) -> Any:
    """Identify a law of time in the plane."""
    from minorloop.identification import Smooth, Viscosity

    levels, *others = kind
    law = Viscosity(levels or Viscosity.levels, *others)
    return law.identify(record, Smooth(strength), say=say)


def _vibration(rough: Any, period: int | None, between: Any, record: Any, say: Any) -> Any:
    """Identify an oscillator."""
    from minorloop.identification.oscillator import Vibration

    check_units(record)
    return Vibration(rough, period, between).identify(record, say=say)
