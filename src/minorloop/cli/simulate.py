"""``minorloop simulate``: what a model gives for the inputs in a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common

NAME = "simulate"


def run(
    model: Annotated[Path, typer.Argument(help="Model file.")],
    file: Annotated[Path, typer.Argument(help="CSV file with one header line.")],
    input: Annotated[str, typer.Option(help="Column of the input.")],
    start: Annotated[str, typer.Option(help="negative, positive or demagnetised.")] = "negative",
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Simulate a model on the inputs in a file, lag included."""
    _common.check_outputs([save], force=force)
    from minorloop import modelfile
    from minorloop.identification.baseline import delayed

    known = modelfile.read(model)
    u = _common.read_column(file, input)
    with _common.working(f"simulating {u.size} samples"):
        y = delayed(known.model.simulate(u, start), known.lag)  # type: ignore[arg-type]
        if save is not None:
            _common.write_csv(save, {str(known.input): u, str(known.output): y}, force=force)
    if as_json:
        outputs = {} if save is not None else {"y": y}
        _common.print_json({"samples": y.size, "least": y.min(), "greatest": y.max(), **outputs})
        return
    unit = f" {known.output.unit}" if known.output.unit else ""
    typer.echo(f"{y.size} samples of {known.output.name}, {y.min():.6g} to {y.max():.6g}{unit}")
    if save is not None:
        typer.echo(f"written to {save}")
    else:
        typer.echo("nothing was written; --save FILE writes inputs and outputs")
