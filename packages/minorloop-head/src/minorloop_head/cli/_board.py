"""``minorloop head board``: firmware of a board, from the file of a head or from model files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common

_Models = Annotated[
    list[Path],
    typer.Argument(help="The file of a head, or one model file for each axis.", show_default=False),
]
_Out = Annotated[Path, typer.Option(help="The folder for the C.", show_default=False)]
_Float32 = Annotated[bool, typer.Option("--float32", help="Compute in single precision.")]
_Memory = Annotated[
    int | None,
    _common.whole_option(
        "Extrema of the input that the C can remember, at least 6; 32 if not given."
    ),
]
_Interval = Annotated[float, _common.seconds_option("Seconds between steps of the feedforward.")]
_Rate = Annotated[
    float | None,
    _common.number_option(
        "Fastest change of an input in its unit per second; without it the whole range in one "
        "interval."
    ),
]
_Patience = Annotated[
    float,
    _common.seconds_option(
        "Seconds without a question after which the board goes to its safe inputs."
    ),
]


def board(
    models: _Models,
    out: _Out,
    float32: _Float32 = False,
    memory: _Memory = None,
    interval: _Interval = 0.04,
    rate: _Rate = None,
    patience: _Patience = 1.0,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Write firmware for a Cortex-M4 board with feedforward on the board."""
    options = {} if memory is None else {"memory": memory}
    from minorloop_head.board import board_of

    with _common.working("writing firmware"):
        code = board_of(
            models,
            _common.print_warnings,
            rate=rate,
            interval=interval,
            patience=patience,
            float32=float32,
            **options,
        )
        code.write(out, force=force)
    figures = {"table_bytes": code.table_bytes, "state_bytes": code.state_bytes}
    if as_json:
        _common.print_json({"folder": str(out), "files": list(code.files), **figures})
        return
    rows = [
        ("files", ", ".join(code.files)),
        ("constant tables", f"{code.table_bytes} bytes"),
        ("states of the models", f"{code.state_bytes} bytes"),
    ]
    _common.print_table(("", ""), rows, f"firmware written to {out}")
    typer.echo(f"next: make -C {out}, and read {out / 'README.md'}")
