"""``minorloop devices``: list actuators and other devices, and check that they answer."""

from dataclasses import asdict
from typing import Annotated

import typer

from minorloop.cli import _common

NAME = "devices"
EXAMPLE = "minorloop devices bench:bench.toml"
_FAILED = 1
_UNSAFE = 3


def run(
    address: Annotated[
        list[str] | None,
        typer.Argument(
            show_default=False,
            help="Actuators and others to open, make safe and read; without any, all are listed.",
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """List devices; or open actuators and others, make them safe, and read each channel."""
    from minorloop.devices import present, probed

    rows = [row for each in address for row in probed(each)] if address else list(present())
    cells = [(row.address, row.what, row.state) for row in rows]
    _common.finish(
        as_json,
        lambda: {"devices": [asdict(row) for row in rows]},
        lambda: _common.print_table(("address", "what", "state"), cells),
    )
    if any(row.error for row in rows):
        raise typer.Exit(_UNSAFE if any("by hand" in row.state for row in rows) else _FAILED)
