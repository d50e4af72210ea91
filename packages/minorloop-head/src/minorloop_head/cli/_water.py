"""Options for water and gas in the simulated pipe."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop_head.twins.surroundings import Filling

FULL, DRY = "full", "dry"
ROOM = 20.0
AIR = "air"
GASES = (AIR, "nitrogen", "argon", "helium", "forced gas")
"""Those of `minorloop_head.twins.surroundings`, which is not imported for a help text."""
ATMOSPHERE, _PASCAL = 1.01325, 1e5
"""Pressure of the gas in bar without an option, and a bar in Pa."""
_THINNEST, _DENSEST = 0.01, 100.0
_HIGHEST = 9.9
"""Of the water above or below the axis of the pipe, in mm, whose radius is 10 mm."""
_COLDEST, _HOTTEST = 5.0, 60.0

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


@dataclass(frozen=True)
class GivenFilling:
    """What fills the simulated pipe, as given by options."""

    level: str = FULL
    """Of the water: a number in mm, ``full`` or ``dry``."""
    temperature: float = ROOM
    """Of the water, in degrees Celsius."""
    gas: str = AIR
    """Above the water, and in the drained pipe: one of `GASES`."""
    pressure: float = ATMOSPHERE
    """Of the gas, in bar."""

    def filling(self) -> Filling:
        """Return it; a dry pipe has no level.

        Raises
        ------
        ParameterError
            If the level is not in the pipe, the temperature not from 5 to 60 degrees, there is no
            such gas, or its pressure is not from 0.01 to 100 bar.
        """
        from minorloop_head.console.plant import FULL_PIPE, flowing_water

        if not _COLDEST <= self.temperature <= _HOTTEST:
            raise ParameterError(
                f"--temperature is {self.temperature:g}; give {_COLDEST:g} to {_HOTTEST:g} degrees "
                "Celsius"
            )
        if self.gas not in GASES:
            raise ParameterError(f"--gas is {self.gas!r}; give one of {', '.join(GASES)}")
        if not _THINNEST <= self.pressure <= _DENSEST:
            raise ParameterError(
                f"--pressure is {self.pressure:g}; give {_THINNEST:g} to {_DENSEST:g} bar"
            )
        known = {FULL: FULL_PIPE, DRY: None}
        level = known[self.level] if self.level in known else _height(self.level)
        water = flowing_water(level, self.temperature)
        return replace(water, gas=self.gas, pressure=_PASCAL * self.pressure)

    def noted(self) -> dict[str, Any]:
        """Return it for a journal; a level reads the same however it was given."""
        given = self.level in (FULL, DRY)
        return {
            "water [mm above the axis]": self.level
            if given
            else f"{-1e3 * _height(self.level) + 0.0:g}",
            "water [C]": self.temperature,
            "gas": self.gas,
            "gas [bar]": self.pressure,
        }


def _height(text: str) -> float:
    """Return a height in mm above the axis as y in metres, which points down."""
    try:
        height = float(text)
    except ValueError:
        height = float("nan")
    if not abs(height) <= _HIGHEST:
        raise ParameterError(
            f"--water is {text}; give {FULL}, {DRY}, or its height above the axis of the pipe, "
            f"{-_HIGHEST:g} to {_HIGHEST:g} mm"
        )
    return -1e-3 * height
