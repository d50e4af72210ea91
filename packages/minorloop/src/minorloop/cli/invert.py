"""``minorloop invert``: inputs for the targets in a CSV file."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import UnreachableError, are

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.modelfile import ModelFile, TargetInversion

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

    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        unreachable: Any = "clip" if clip else "raise"
        try:
            found = known.invert_file(
                file,
                target,
                start=start,  # type: ignore[arg-type]
                unreachable=unreachable,
                hold=hold,
                time=time,
                progress=now,
            )
        except UnreachableError as error:
            hint = str(error).replace('pass unreachable="clip"', "pass --clip")
            raise UnreachableError(hint) from None
    result, warnings = found.result, list(known.warnings)
    inputs = {} if save is not None else {"u": result.u, "y": result.y}
    said = {"notes": found.notes, "warnings": warnings}
    figures = {**found.to_dict(), **inputs, **{name: x for name, x in said.items() if x}}
    show = partial(_print, known, found, saved=save is not None)
    _common.finish(as_json, lambda: figures, show, _common.table(save, found.columns, force))
    if not as_json:
        _common.print_warnings(known.warnings)


def _print(known: ModelFile, found: TargetInversion, *, saved: bool) -> None:
    targets, result = found.targets, found.result
    for note in found.notes:
        typer.echo(f"note: {note}", err=True)
    missed = int((~result.reachable).sum())
    columns = [f"target {known.output}", str(known.input), f"predicted {known.output}"]
    first = [f"{value:.6g}" for value in targets[:_SHOWN]]
    inputs, outputs = _in_six_digits(result.u), _in_six_digits(result.y)
    rows = [list(row) for row in zip(first, inputs, outputs, strict=True)]
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
    if found.settles:
        typer.echo("each output settles at its target; --time follows targets in time")


def _in_six_digits(values: FloatArray) -> list[str]:
    """Return the first numbers with six digits; rounding errors are shown as 0."""
    least = 1e-12 * float(abs(values).max())
    return [f"{value if abs(value) > least else 0:.6g}" for value in values[:_SHOWN]]
