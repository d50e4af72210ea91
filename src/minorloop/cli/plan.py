"""``minorloop plan``: which inputs to apply, and for how long."""

from __future__ import annotations

from typing import Annotated

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

NAME = "plan"
_PATTERNS = {
    "decaying": "decaying_staircase",
    "reversal": "reversal_curves",
    "staircase": "staircase",
}
_SHOWN = 24
_MOST = 60
_HOUR = 3600.0


def run(
    pattern: Annotated[str, typer.Argument(help="decaying, reversal or staircase.")],
    low: Annotated[float, typer.Option(help="Least input.")],
    high: Annotated[float, typer.Option(help="Greatest input.")],
    levels: Annotated[int, typer.Option(help="Number of bands.")] = 10,
    hold: Annotated[float, typer.Option(help="Seconds to hold each input.")] = 200.0,
    input: Annotated[str, typer.Option(help="Name and unit of the input.")] = "input",
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
    from minorloop.arrays import uniform_levels
    from minorloop.identification import excitation

    if levels > _MOST:
        raise ParameterError(f"--levels is {levels}; a plan has at most {_MOST} bands")
    grid = uniform_levels(low, high, levels)
    inputs = getattr(excitation, _PATTERNS[pattern])(grid)
    with _common.working("working out what it would determine"):
        report = excitation.report(inputs, grid)
    if save is not None:
        _common.write_csv(save, {input: inputs, "hold [s]": [hold] * inputs.size}, force=force)
    hours = inputs.size * hold / _HOUR
    if as_json:
        figures = {
            "inputs": inputs,
            "hold_s": hold,
            "hours": hours,
            "rank": report.rank,
            "unknowns": report.unknowns,
            "condition": report.condition,
            "excited_fraction": report.excited_fraction,
        }
        _common.print_json(figures)
        return
    shown = " ".join(f"{u:.6g}" for u in inputs[:_SHOWN])
    more = f" ... and {inputs.size - _SHOWN} more" if inputs.size > _SHOWN else ""
    typer.echo(f"{inputs.size} holds of {hold:g} s, {hours:.1f} h")
    typer.echo(f"{report}")
    typer.echo(f"{shown}{more}")
    if save is not None:
        typer.echo(f"written to {save}")
