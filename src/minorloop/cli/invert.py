"""``minorloop invert``: the inputs that bring a model to the targets in a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common
from minorloop.errors import NotInvertibleError, UnreachableError

NAME = "invert"
_SHOWN = 20


def run(
    model: Annotated[Path, typer.Argument(help="Model file.")],
    file: Annotated[Path, typer.Argument(help="CSV file with one header line.")],
    target: Annotated[str, typer.Option(help="Column of the outputs wanted.")],
    clip: Annotated[bool, typer.Option("--clip", help="Go as near as the model can.")] = False,
    start: Annotated[str, typer.Option(help="negative, positive or demagnetised.")] = "negative",
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Find the inputs that bring the output to each target in turn."""
    _common.check_outputs([save], force=force)
    from minorloop import modelfile
    from minorloop.operators.relays import RelayModel

    known = modelfile.read(model)
    targets = _common.read_column(file, target)
    if isinstance(known.model, RelayModel):
        raise NotInvertibleError(
            f"{model} holds a relay-by-relay model, which has no exact inverse; identify a "
            "Preisach model on the same levels"
        )
    try:
        result = known.model.invert(targets, start, "clip" if clip else "raise")  # type: ignore[arg-type]
    except UnreachableError as error:
        hint = str(error).replace('pass unreachable="clip"', "pass --clip")
        raise UnreachableError(hint) from None
    if save is not None:
        columns = {
            str(known.input): result.u,
            f"target {known.output}": targets,
            f"predicted {known.output}": result.y,
            "reachable": result.reachable.astype(int),
        }
        _common.write_csv(save, columns, force=force)
    if as_json:
        inputs = {} if save is not None else {"u": result.u, "y": result.y}
        worst = {"worst_residual": result.worst, "unreachable": int((~result.reachable).sum())}
        _common.print_json({"targets": targets.size, **worst, **inputs})
        return
    rows = [
        (f"{t:.6g}", f"{u:.6g}", f"{y:.6g}", "" if ok else "out of reach")
        for t, u, y, ok in zip(targets, result.u, result.y, result.reachable, strict=True)
    ]
    columns_shown = (f"target {known.output}", str(known.input), f"predicted {known.output}", "")
    _common.print_table(columns_shown, rows[:_SHOWN])
    if len(rows) > _SHOWN:
        typer.echo(f"... {len(rows) - _SHOWN} more; --save FILE writes them all")
    if save is not None:
        typer.echo(f"written to {save}")
