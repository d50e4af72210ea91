"""Options for water and gas in the simulated pipe."""

from __future__ import annotations

from typing import Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of

FULL, DRY = "full", "dry"
ROOM = 20.0
AIR = "air"
GASES = (AIR, "nitrogen", "argon", "helium", "forced gas")
"""Those of `minorloop_head.twins.surroundings`, which a help text does not wait for."""
ATMOSPHERE = 1.01325
"""Pressure of the gas in bar without an option."""

Level = Annotated[
    str,
    typer.Option(
        "--water",
        metavar="MM",
        help="With twin:pipe: height of the water above the axis, from -9.9 to 9.9 mm, when the "
        "pipe is flooded; or full, or dry.",
    ),
]
Gas = Annotated[
    str,
    typer.Option(
        help="With twin:pipe: gas in the drained pipe and above the water, which cools the wires: "
        "air, nitrogen, argon or helium, which are still, or 'forced gas', which streams.",
        autocompletion=one_of(GASES),
    ),
]
Pressure = Annotated[
    float,
    typer.Option(
        parser=_common.number,
        metavar="BAR",
        help="With twin:pipe: pressure of the gas, from 0.01 to 100 bar; dense gas cools more.",
    ),
]
Temperature = Annotated[
    float,
    _common.number_option(
        "With twin:pipe: temperature of the water, from 5 to 60 degrees Celsius."
    ),
]
