"""``minorloop plan``: inputs to apply, and how long to hold them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.errors import ParameterError
from minorloop.files import check_name
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.identification.excitation import ExcitationReport

NAME = "plan"
EXAMPLE = (
    "minorloop plan decaying --low -1.2 --high 1.2 --levels 10 --hold 200 "
    '--input "voltage [V]" --save plan.csv'
)
_PATTERNS = {
    "decaying": "decaying_staircase",
    "reversal": "reversal_curves",
    "staircase": "staircase",
}
_SHOWN = 24
"""Most inputs that are printed."""
_RANKED = 60
"""Bands up to which computing what a plan determines takes seconds only."""
_HOLD = "hold [s]"
_HOUR = 3600.0


def run(
    pattern: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="decaying or reversal (determine the plane), or staircase (one loop).",
            autocompletion=one_of(lambda: list(_PATTERNS)),
        ),
    ],
    low: Annotated[float, _common.number_option("Least input.")],
    high: Annotated[float, _common.number_option("Greatest input.")],
    levels: Annotated[int, _common.whole_option("Bands between them, 250 at most.")] = 10,
    hold: Annotated[float, _common.number_option("Seconds to hold each input.")] = _common.HOLD,
    input: Annotated[
        str, typer.Option(help="Header of the column of the input: its name and unit.")
    ] = "input",
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Plan the measurement that identifies an actuator."""
    _common.check_outputs([save], force=force)
    if pattern not in _PATTERNS:
        known = ", ".join(_PATTERNS)
        raise ParameterError(f"there is no plan {pattern!r}; give one of {known}")
    if not 0 < hold < float("inf"):
        raise ParameterError(f"--hold is {hold}; give a positive number of seconds")
    check_name("--input", input)
    if input == _HOLD:
        raise ParameterError(f"--input is {_HOLD!r}, the header of hold times; give another name")
    inputs, report = _planned(pattern, low, high, levels)
    if save is not None:
        _common.write_csv(save, {input: inputs, _HOLD: [hold] * inputs.size}, force=force)
    if as_json:
        _common.print_json(_figures(inputs, hold, report))
        return
    _print(inputs, hold, report)
    if save is not None:
        typer.echo(f"written to {save}")


def _planned(
    pattern: str, low: float, high: float, levels: int
) -> tuple[FloatArray, ExcitationReport | None]:
    """Return the inputs, and what they determine if that is quickly computed."""
    from minorloop.arrays import uniform_levels
    from minorloop.identification import excitation
    from minorloop.identification.design_matrix import check_bands

    check_bands(levels)
    grid = uniform_levels(low, high, levels)
    inputs: FloatArray = getattr(excitation, _PATTERNS[pattern])(grid)
    if levels > _RANKED:
        return inputs, None
    with _common.working("computing what it would determine"):
        return inputs, excitation.report(inputs, grid)


def _figures(inputs: FloatArray, hold: float, report: ExcitationReport | None) -> dict[str, Any]:
    keys = ("rank", "unknowns", "condition", "excited_fraction")
    known = {key: getattr(report, key) if report else None for key in keys}
    return {"inputs": inputs, "hold_s": hold, "hours": inputs.size * hold / _HOUR, **known}


def _print(inputs: FloatArray, hold: float, report: ExcitationReport | None) -> None:
    typer.echo(f"{inputs.size} holds of {hold:g} s, {as_duration(inputs.size * hold)} in all")
    typer.echo(
        str(report) if report else f"what more than {_RANKED} bands determine is not computed"
    )
    shown = " ".join(f"{u:.6g}" for u in inputs[:_SHOWN])
    more = f" ... and {inputs.size - _SHOWN} more" if inputs.size > _SHOWN else ""
    typer.echo(f"{shown}{more}")
