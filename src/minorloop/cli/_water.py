"""Options for the water in the simulated pipe."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.head.twins.surroundings import Filling

FULL, DRY = "full", "dry"
ROOM = 20.0
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
Temperature = Annotated[
    float,
    _common.number_option(
        "With twin:pipe: temperature of the water, from 5 to 60 degrees Celsius."
    ),
]


def water_of(level: str, temperature: float) -> Filling:
    """Return what fills the simulated pipe when it is flooded; a dry one has no level.

    Parameters
    ----------
    level : str
        A number in mm, ``full`` or ``dry``.
    temperature : float
        In degrees Celsius.

    Raises
    ------
    ParameterError
        If the level is not in the pipe, or the temperature not from 5 to 60.
    """
    from minorloop.head.console.plant import FULL_PIPE, flowing_water

    if not _COLDEST <= temperature <= _HOTTEST:
        raise ParameterError(
            f"--temperature is {temperature:g}; give {_COLDEST:g} to {_HOTTEST:g} degrees Celsius"
        )
    known = {FULL: FULL_PIPE, DRY: None}
    return flowing_water(known[level] if level in known else _height(level), temperature)


def noted(level: str, temperature: float) -> dict[str, Any]:
    """Return level and temperature for a journal; a level reads the same however it was given."""
    known = level if level in (FULL, DRY) else f"{-1e3 * _height(level) + 0.0:g}"
    return {"water [mm above the axis]": known, "water [C]": temperature}


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
