"""The option for water and gas in the simulated pipe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.values import called, parsed

if TYPE_CHECKING:
    from minorloop_head.inspection import Water

FULL = "full"
Level = Annotated[
    str,
    typer.Option(
        "--water",
        metavar="MM,KEY=VALUE,...",
        help="With twin:pipe: height of the water above the axis, from -9.9 to 9.9 mm, when the "
        "pipe is flooded; or full, or dry. Its keys: temperature, from 5 to 60 degrees Celsius; "
        "gas in the drained pipe and above the water, which cools the wires: air, nitrogen, argon "
        "or helium, which are still, or 'forced gas', which streams; and its pressure, from 0.01 "
        "to 100 bar: dense gas cools more.",
    ),
]


def water_of(text: str) -> Water:
    """Return the filling of the simulated pipe."""
    from minorloop_head.inspection import Water

    given = parsed(text)
    level = given.kind or given.what
    return called(Water, "--water", {**({"level": level} if level else {}), **given.options})
