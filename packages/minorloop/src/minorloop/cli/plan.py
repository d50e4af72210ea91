"""``minorloop plan``: inputs to apply, and how long to hold them."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.errors import ParameterError, counted
from minorloop.files import check_name
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from pathlib import Path

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
_SINES = "sines"
_OF_SINES = ("frequencies", "amplitudes", "preamble", "offset", "settling", "cycles", "samples")
_SHOWN = 24
"""Most inputs that are printed."""
_RANKED = 60
"""Bands up to which computing what a plan determines takes seconds only."""
_HOLD = "hold [s]"


def run(
    pattern: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="decaying or reversal (determine the plane), staircase (one loop), or sines "
            "(frequency response).",
            autocompletion=one_of([*_PATTERNS, _SINES]),
        ),
    ],
    low: Annotated[
        float | None, _common.number_option("Least input; for all plans but sines.")
    ] = None,
    high: Annotated[
        float | None, _common.number_option("Greatest input; for all plans but sines.")
    ] = None,
    levels: Annotated[
        int | None, _common.whole_option("Bands between them, 250 at most; 10 if not given.")
    ] = None,
    hold: Annotated[
        float,
        _common.seconds_option(
            "Seconds to hold each input; of sines, the preamble and the offset."
        ),
    ] = 200.0,
    input: Annotated[
        str, typer.Option(help="Header of the column of the input: its name and unit.")
    ] = "input",
    frequencies: Annotated[
        str | None, typer.Option(metavar="F1,F2,...", help="Sines: frequencies in Hz.")
    ] = None,
    amplitudes: Annotated[
        str | None,
        typer.Option(metavar="A1,A2,...", help="Sines: amplitudes, each at every frequency."),
    ] = None,
    preamble: Annotated[
        float | None,
        _common.number_option("Sines: input that saturates the actuator before each sine."),
    ] = None,
    offset: Annotated[
        float | None, _common.number_option("Sines: mean of the input, 0 if not given.")
    ] = None,
    settling: Annotated[
        float | None,
        _common.number_option(
            "Sines: seconds before periods are measured, five of the slowest time constants; three "
            "periods at least."
        ),
    ] = None,
    cycles: Annotated[
        float | None, _common.number_option("Sines: measured periods, 2 if not given.")
    ] = None,
    samples: Annotated[
        float | None, _common.number_option("Sines: samples of a period, 240 if not given.")
    ] = None,
    tick: Annotated[
        float | None,
        _common.seconds_option(
            "Sines: tick of the bench in seconds; frequencies are rounded to whole ticks."
        ),
    ] = None,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Plan the measurement that identifies an actuator."""
    given = locals()
    _common.check_outputs([save], force=force)
    if pattern not in (*_PATTERNS, _SINES):
        known = ", ".join((*_PATTERNS, _SINES))
        raise ParameterError(f"there is no plan {pattern!r}; give one of {known}")
    _check_options(pattern, given)
    if pattern == _SINES:
        _plan_sines(given, input, save, force, as_json)
        return
    if low is None or high is None:
        raise ParameterError(f"Missing option '--{'low' if low is None else 'high'}'")
    check_name("--input", input)
    if input == _HOLD:
        raise ParameterError(f"--input is {_HOLD!r}, the header of hold times; give another name")
    inputs, report = _planned(pattern, low, high, 10 if levels is None else levels)
    if save is not None:
        _common.write_csv(save, {input: inputs, _HOLD: [hold] * inputs.size}, force=force)
    if as_json:
        _common.print_json(_figures(inputs, hold, report))
        return
    _print(inputs, hold, report)
    if save is not None:
        typer.echo(f"written to {save}")


def _check_options(pattern: str, given: dict[str, Any]) -> None:
    """Refuse options of another kind of plan, and sines without what they need."""
    others = ("low", "high", "levels") if pattern == _SINES else (*_OF_SINES, "tick")
    _common.refuse_given({name: given[name] for name in others}, f"is not for a plan of {pattern}")
    for name in ("frequencies", "amplitudes", "preamble") if pattern == _SINES else ():
        if given[name] is None:
            raise ParameterError(f"--{name} is missing; a plan of sines needs it")


def _plan_sines(
    given: dict[str, Any], input: str, save: Path | None, force: bool, as_json: bool
) -> None:
    """Write and print a plan of sines."""
    from minorloop.lab.plan import Plan
    from minorloop.lab.sines import grid

    check_name("--input", input)
    names = {"offset": "offset", "settling": "settling", "cycles": "measured"}
    names |= {"samples": "samples", "tick": "tick"}
    options: dict[str, Any] = {
        theirs: given[mine] for mine, theirs in names.items() if given[mine] is not None
    }
    sines = grid(
        _numbers("frequencies", given["frequencies"]),
        _numbers("amplitudes", given["amplitudes"]),
        preamble=given["preamble"],
        hold=given["hold"],
        **options,
    )
    plan = Plan.of_sines(sines, input)
    if save is not None:
        plan.to_csv(save, force=force)
    if as_json:
        known = {"input": str(plan.input), "sines": [asdict(sine) for sine in sines]}
        _common.print_json({**known, "hours": plan.duration / 3600})
        return
    typer.echo(f"{counted(len(plan), 'sine')}, {as_duration(plan.duration)} in all")
    kinds = dict.fromkeys((s.frequency, s.discarded, s.measured, s.samples) for s in sines)
    rows = [[f"{row[0]:.6g}", *map(str, row[1:])] for row in kinds]
    _common.print_table(("frequency [Hz]", "discarded", "measured periods", "samples"), rows)
    if save is not None:
        typer.echo(f"written to {save}")


def _numbers(name: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(
            f"--{name} is {text!r}; give numbers separated by commas, such as 0.1,1"
        ) from None


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
    return {"inputs": inputs, "hold_s": hold, "hours": inputs.size * hold / 3600, **known}


def _print(inputs: FloatArray, hold: float, report: ExcitationReport | None) -> None:
    typer.echo(
        f"{counted(inputs.size, 'hold')} of {hold:g} s, {as_duration(inputs.size * hold)} in all"
    )
    typer.echo(
        str(report) if report else f"what more than {_RANKED} bands determine is not computed"
    )
    shown = " ".join(f"{u:.6g}" for u in inputs[:_SHOWN])
    more = f" ... and {inputs.size - _SHOWN} more" if inputs.size > _SHOWN else ""
    typer.echo(f"{shown}{more}")
