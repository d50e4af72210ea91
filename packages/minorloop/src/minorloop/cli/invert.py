"""``minorloop invert``: inputs for the targets in a CSV file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, UnreachableError, are, counted

if TYPE_CHECKING:
    from pathlib import Path

    from minorloop.arrays import FloatArray
    from minorloop.dynamics.cascade import CascadeInversion
    from minorloop.lab.timebase import TimeCheck
    from minorloop.modelfile import ModelFile
    from minorloop.operators.inversion import Inversion

NAME = "invert"
EXAMPLE = "minorloop invert model.json targets.csv --target curvature --save inputs.csv"
_SHOWN = 20
"""Most rows of the printed table; ``--save`` and ``--json`` give all."""


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    target: _common.Target,
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
    from minorloop.lab.conversion import read_column

    if hold is not None and time is not None:
        raise ParameterError(
            "--hold and --time cannot be combined: a plan has holds, a trajectory has times; leave "
            "one of them out"
        )
    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        targets = read_column(file, target, known.output.unit)
        times, check = ({}, None) if time is None else _times_of(known, file, time)
        now(f"inverting {targets.size} targets")
        result: Any
        try:
            if hold is None:
                t = next(iter(times.values()), None)
                result = known.invert(targets, start, "clip" if clip else "raise", t=t)  # type: ignore[arg-type]
                columns: dict[str, Any] = {**times, **known.inverse_columns(targets, result)}
            else:
                result, columns = known.inverse_plan(targets, hold, start, clip)
        except UnreachableError as error:
            hint = str(error).replace('pass unreachable="clip"', "pass --clip")
            raise UnreachableError(hint) from None
        if save is not None:
            _common.write_csv(save, columns, force=force)
    notes = [*([] if check is None else _about_times(check)), *_ahead(result)]
    if as_json:
        inputs = {} if save is not None else {"u": result.u, "y": result.y}
        worst = float(abs(result.residual).max())
        figures = {"worst_residual": worst, "unreachable": int((~result.reachable).sum())}
        said = {"notes": notes, "warnings": list(known.warnings)}
        said = {name: texts for name, texts in said.items() if texts}
        _common.print_json({"targets": targets.size, **figures, **inputs, **said})
        return
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    _print(known, targets, result, saved=save is not None)
    if known.operator is not known.model and hold is None and not times:
        typer.echo("each output settles at its target; --time follows targets in time")
    if save is not None:
        typer.echo(f"written to {save}")
    _common.print_warnings(known.warnings)


def _times_of(known: ModelFile, file: Path, column: str) -> tuple[dict[str, FloatArray], TimeCheck]:
    """Return the column of time by its header, in seconds, and what was found in it.

    Raises a `RecordError` if the times run backwards.
    """
    from minorloop.lab.logs import check_order, read_times

    quantity, check = read_times(file, column)
    check_order(file, column, check, strictly=known.has_time)
    return {str(quantity): check.t}, check


def _about_times(check: TimeCheck) -> list[str]:
    """Say what happens in gaps between targets, and what else the times show."""
    said = [*check.of_steps, *check.others]
    if not check.gaps.size:
        return said
    longest = max(check.t[check.gaps + 1] - check.t[check.gaps])
    return [
        f"{counted(check.gaps.size, 'gap')} in the times of the targets, the longest {longest:.4g} "
        "s: the input of the row before is held there, and no target is followed",
        *said,
    ]


def _ahead(result: Any) -> list[str]:
    """Say by how much the inputs of a trajectory are ahead, and what they assume at its end."""
    lead: float = getattr(result, "lead", 0.0)
    if lead <= 0:
        return []
    moves = result.targets[-1] != result.targets[-2]
    return [
        f"the inputs are {lead:.3g} s ahead of the targets, as the output is late; after "
        "the last target it is held"
        + (", although the targets still move there: add rows to follow them on" if moves else "")
    ]


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
