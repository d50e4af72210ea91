"""``minorloop identify``: a model from a CSV file."""

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.cli._identification import (
    OF_RECORD,
    PRINTED,
    Outputs,
    identify,
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
_OF_OSCILLATORS = (*OF_RECORD, "oscillator", "period", "between")
_OF_CREEP = (
    *OF_RECORD,
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
    report: _common.Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
    verbose: _common.Verbose = False,
) -> None:
    """Identify a hysteresis model from measured data, and say how far to trust it.

    If the model is not to be trusted, it is written with warnings, and the exit status is 1.
    """
    outputs = Outputs(save, report, force, as_json, verbose)
    if from_loop is not None:
        refuse_others(context, PRINTED, "--from-loop")
        _from_loop(from_loop, field, (input or "input", output or "output"), outputs)
        return
    if file is None:
        raise ParameterError(
            "Missing argument 'file'; see minorloop identify --help, or give --from-loop HC BR BMAX"
        )
    _common.refuse_given({"field": field}, "is given without --from-loop")
    _common.check_outputs([save, report], inputs=[file], force=force)
    columns = {"input": input, "output": output, "time": time, "curves": curves}
    of_record: dict[str, Any] = {"skip": skip}
    strength = _common.number_or_auto("smoothness", smoothness, float)
    if oscillator is not None:
        refuse_others(context, _OF_OSCILLATORS, "--oscillator")
        from minorloop.identification.oscillator import Vibration

        rough: Any = rough_oscillator(oscillator)
        vibration = Vibration(rough, period, between or "band")  # type: ignore[arg-type]
        _finish(outputs, identify(file, columns, rows, vibration, of_record, "--oscillator"))
        return
    _common.refuse_given({"period": period, "between": between}, "is given without --oscillator")
    of_record |= {"start": start, "start_of_curve": start_of_curve}
    if creep != _common.NONE or rate:
        refuse_others(context, _OF_CREEP, "--creep or --rate")
        from minorloop.identification import Smooth, Viscosity

        viscous: Any = True if rate else "auto" if creep == "auto" else False
        kind: Any = (creep, viscous, diagonal or "reversible", spacing)
        viscosity, timed = Viscosity(levels or 25, *kind), "a fit with --creep or --rate"
        prior_used = Smooth(strength)
        done = identify(file, columns, rows, viscosity, of_record, timed, prior=prior_used)
        _finish(outputs, done)
        return
    from minorloop.arrays import check_option
    from minorloop.identification import Dynamics
    from minorloop.identification.pipeline import Options

    check_option("--dynamics", dynamics, DYNAMICS)
    for name, used in (("noise", noise), ("dynamics", dynamics != _common.NONE)):
        if sd not in (None, _common.NONE) and used not in (None, False):
            raise ParameterError(f"--sd cannot be combined with --{name}; leave one of them out")
    lag_used = _common.as_lag(lag)
    asked = Options.of(
        {
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
            "lag": lag_used,
        }
    )
    law: Any = asked.law
    if dynamics != _common.NONE:
        law = Dynamics(asked.law, dynamics)  # type: ignore[arg-type]
    columns |= {"sd": sd, "groups": groups}
    of_record |= asked.of_record
    done = identify(file, columns, rows, law, of_record, prior=asked.prior, holdout=holdout)
    if rank:
        _ = getattr(done[0], "static", done[0]).rank  # shown where it was computed
    _finish(outputs, done)


def _finish(outputs: Outputs, done: tuple[Any, Any, float]) -> None:
    """Write and print a fit with the origin of its record and its seconds."""
    found, provenance, seconds = done
    save = partial(found.save, provenance=provenance, force=outputs.force)
    draw = partial(found.report, str(provenance.data))
    files = _common.Written(outputs.save, save, "model written to {}"), outputs.drawn(draw)
    outputs.finish(found, found.headline, files, {"seconds": seconds})
    outputs.judge(found)


def _from_loop(
    texts: tuple[str, str, str], field: float | None, names: tuple[str, str], outputs: Outputs
) -> None:
    """Make a model from the loop of a data sheet, write it and print what it is."""
    try:
        hc, br, bmax = (float(text) for text in texts)
    except ValueError:
        given = " ".join(texts)
        raise ParameterError(f"--from-loop is {given!r}; give three numbers, HC BR BMAX") from None
    from minorloop import modelfile
    from minorloop.identification.data_sheet import from_loop

    _common.check_outputs([outputs.save], force=outputs.force)
    with _common.working("drawing ridges with this loop"):
        found = from_loop(hc, br, bmax, field)
    options: dict[str, Any] = {"input": names[0], "output": names[1], "force": outputs.force}
    save = _common.Written(
        outputs.save, partial(modelfile.save, found, **options), "model written to {}"
    )
    title = f"{names[1]} against {names[0]}: Preisach, {found.model.bands} bands"
    outputs.finish(found, title, [save], {})
