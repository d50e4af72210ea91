"""``minorloop invert``: inputs for the targets in a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import NotInvertibleError, ParameterError, UnreachableError, are, counted

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.dynamics.cascade import CascadeInversion
    from minorloop.lab.timebase import TimeCheck
    from minorloop.modelfile import ModelFile
    from minorloop.operators.inversion import Inversion

NAME = "invert"
EXAMPLE = "minorloop invert model.json targets.csv --target curvature --save inputs.csv"
_TIME_CONSTANTS = 5.0
"""Time constants after which less than 1 % is left."""
_SHOWN = 20
"""Most rows of the printed table; ``--save`` and ``--json`` give all."""


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    target: Annotated[str, typer.Option(help="Column of the wanted outputs, in order.")],
    clip: Annotated[
        bool, typer.Option("--clip", help="Go as near as possible to targets out of reach.")
    ] = False,
    start: _common.Start = "negative",
    hold: Annotated[
        float | None,
        _common.seconds_option(
            "Seconds to hold each input: --save then writes a plan for run, saturation first."
        ),
    ] = None,
    time: _common.Time = None,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Compute the inputs that bring the output to each target in turn.

    With --time, a model with dynamics follows the targets in time, from rest at the lowest input;
    with --hold, one with after-effect reaches each target at the end of its hold. Without them,
    each input is the one at which the output settles.
    """
    _common.check_outputs([save], inputs=[model, file], force=force)
    from minorloop import modelfile

    if hold is not None and time is not None:
        raise ParameterError(
            "--hold and --time cannot be combined: a plan has holds, a trajectory has times; leave "
            "one of them out"
        )
    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        targets = _common.read_column(file, target, known.output.unit)
        times, check = ({}, None) if time is None else _common.times_of(known, file, time)
        if hold is not None:
            times = _ends_of_holds(known, hold, targets.size)
        notes = [] if check is None else [*_gaps(check), *check.of_steps, *check.others]
        now(f"inverting {targets.size} targets")
        result = _inverted(known, model, times, targets, start, clip)
        notes += _ahead(result)
        if save is not None:
            columns: dict[str, Any] = {
                **({} if hold is not None else times),
                **known.inverse_columns(targets, result),
            }
            if hold is not None:
                columns = _as_plan(known, columns, start, hold)
            _common.write_csv(save, columns, force=force)
    if as_json:
        inputs = {} if save is not None else {"u": result.u, "y": result.y}
        worst = {
            "worst_residual": float(abs(result.residual).max()),
            "unreachable": int((~result.reachable).sum()),
        }
        said = {"notes": notes, "warnings": list(known.warnings)}
        said = {name: texts for name, texts in said.items() if texts}
        _common.print_json({"targets": targets.size, **worst, **inputs, **said})
        return
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    _print(known, targets, result, saved=save is not None)
    if known.operator is not known.model and not times:
        typer.echo("each output settles at its target; --time follows targets in time")
    if save is not None:
        typer.echo(f"written to {save}")
    _common.print_warnings(known.warnings)


def _gaps(check: TimeCheck) -> list[str]:
    """Say what happens in gaps between targets."""
    if not check.gaps.size:
        return []
    longest = max(check.t[check.gaps + 1] - check.t[check.gaps])
    return [
        f"{counted(check.gaps.size, 'gap')} in the times of the targets, the longest {longest:.4g} "
        "s: the input of the row before is held there, and no target is followed"
    ]


def _ahead(result: Inversion | CascadeInversion) -> list[str]:
    """Say by how much the inputs of a trajectory are ahead, and what they assume at its end."""
    from minorloop.dynamics.cascade import CascadeInversion

    if not isinstance(result, CascadeInversion) or result.lead <= 0:
        return []
    moves = result.targets[-1] != result.targets[-2]
    return [
        f"the inputs are {result.lead:.3g} s ahead of the targets, as the output is late; after "
        "the last target it is held"
        + (", although the targets still move there: add rows to follow them on" if moves else "")
    ]


def _ends_of_holds(known: ModelFile, hold: float, count: int) -> dict[str, FloatArray]:
    """Return when the holds of a model with after-effect end; nothing for other models."""
    from numpy import arange

    from minorloop.operators.after_effect import AfterEffect

    if not isinstance(known.model, AfterEffect):
        return {}
    return {"time [s]": hold * arange(1.0, count + 1)}


def _as_plan(
    known: ModelFile, columns: dict[str, Any], start: str, hold: float
) -> dict[str, list[Any]]:
    """Return the columns with holds, after a first row that saturates the actuator."""
    levels = getattr(known.operator, "levels", None)
    if levels is None or start == "demagnetised":
        raise ParameterError(
            "--hold writes a plan that begins in saturation, which needs a model with levels and "
            "--start negative or positive; use minorloop drive, or leave --hold out"
        )
    first = float(levels[0] if start == "negative" else levels[-1])
    plan = {name: ["", *values] for name, values in columns.items()}
    plan[str(known.input)][0] = first
    plan["hold [s]"] = [
        max(2 * hold, _settled_after(known)),
        *[hold] * (len(plan[str(known.input)]) - 1),
    ]
    return plan


def _settled_after(known: ModelFile) -> float:
    """Return the seconds after which the slowest after-effect of a model has settled to 1 %."""
    from minorloop.operators.after_effect import AfterEffect

    if not isinstance(known.model, AfterEffect):
        return 0.0
    return _TIME_CONSTANTS * max([known.model.settling, *known.model.times], default=0.0)


def _inverted(
    known: ModelFile,
    path: Path,
    times: dict[str, FloatArray],
    targets: FloatArray,
    start: str,
    clip: bool,
) -> Inversion | CascadeInversion:
    from minorloop.dynamics.cascade import Cascade
    from minorloop.dynamics.linear import Linear
    from minorloop.operators.after_effect import AfterEffect
    from minorloop.operators.relays import RelayModel

    if isinstance(known.operator, RelayModel):
        raise NotInvertibleError(
            f"{path} has a relay-by-relay model, which has no exact inverse; identify a "
            "Preisach model on the same levels"
        )
    unreachable = "clip" if clip else "raise"
    try:
        in_time = known.model
        if not isinstance(in_time, Cascade) and known.lag_seconds:  # a lag is a dead time
            in_time = Cascade(known.operator, Linear.lags(delay=known.lag_seconds))
        if times and isinstance(in_time, Cascade):
            return in_time.invert(
                next(iter(times.values())),
                targets,
                start,
                before=_rest(known, start),
                unreachable=unreachable,  # type: ignore[arg-type]
                between="held",
            )
        if times and isinstance(known.model, AfterEffect):
            t = next(iter(times.values()))
            return known.model.invert(t, targets, start, unreachable)  # type: ignore[arg-type]
        return known.operator.invert(targets, start, unreachable)  # type: ignore[arg-type]
    except UnreachableError as error:
        hint = str(error).replace('pass unreachable="clip"', "pass --clip")
        raise UnreachableError(hint) from None


def _rest(known: ModelFile, start: str) -> float:
    """Return the input at which the actuator rests before the first target."""
    levels = getattr(known.operator, "levels", None)
    if levels is None or start == "demagnetised":
        return 0.0
    return float(levels[0] if start == "negative" else levels[-1])


def _print(
    known: ModelFile, targets: FloatArray, result: Inversion | CascadeInversion, *, saved: bool
) -> None:
    missed = int((~result.reachable).sum())
    columns = [f"target {known.output}", str(known.input), f"predicted {known.output}"]
    wanted = [f"{value:.6g}" for value in targets[:_SHOWN]]
    found = _in_six_digits(result.u), _in_six_digits(result.y)
    rows = [list(row) for row in zip(wanted, *found, strict=True)]
    if missed:
        columns.append("")
        for row, ok in zip(rows, result.reachable[:_SHOWN], strict=True):
            row.append("" if ok else "out of reach")
    _common.print_table(columns, rows)
    if targets.size > _SHOWN:
        how = "" if saved else "; --save FILE writes them all"
        typer.echo(f"... {targets.size - _SHOWN} more{how}")
    if missed:
        typer.echo(f"{missed} of {targets.size} targets {are(missed)} out of reach of the model")


def _in_six_digits(values: FloatArray) -> list[str]:
    """Return the first numbers as text; rounding errors are shown as 0."""
    least = 1e-12 * float(abs(values).max())
    return [f"{value if abs(value) > least else 0:.6g}" for value in values[:_SHOWN]]
