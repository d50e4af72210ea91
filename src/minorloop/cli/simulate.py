"""``minorloop simulate``: what a model gives for the inputs in a CSV file."""

from __future__ import annotations

from typing import Annotated

import typer

from minorloop.cli import _common

NAME = "simulate"
EXAMPLE = "minorloop simulate model.json inputs.csv --input voltage --save predicted.csv"


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    input: Annotated[str, typer.Option(help="Column of the input, in the unit of the model.")],
    start: _common.Start = "negative",
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Predict the output for the inputs in a file, lag included."""
    _common.check_outputs([save], inputs=[model, file], force=force)
    from minorloop import modelfile
    from minorloop.identification.baseline import delayed

    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        u = _common.read_column(file, input)
        now(f"simulating {u.size} samples")
        y = delayed(known.model.simulate(u, start), known.lag)  # type: ignore[arg-type]
        if save is not None:
            now(f"writing {save.name}")
            output = str(known.output)
            header = output if known.output != known.input else f"predicted {output}"
            _common.write_csv(save, {str(known.input): u, header: y}, force=force)
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
