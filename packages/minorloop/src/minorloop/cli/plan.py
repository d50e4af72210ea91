"""``minorloop plan``: inputs to apply, and how long to hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, counted
from minorloop.files import check_name
from minorloop.values import as_duration, called, numbers, parsed

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.identification.excitation import ExcitationReport
    from minorloop.lab.plan import Plan

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
_SHOWN = 24
"""Most inputs that are printed."""
_RANKED = 60
"""Most bands for which it takes only seconds to compute what a plan determines."""
_HOLD = "hold [s]"


def run(
    pattern: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="decaying or reversal (determine the plane), staircase (one loop), or "
            "sines:KEY=VALUE,... (frequency response) with frequencies=F1,F2,... in Hz, "
            "amplitudes=A1,A2,..., each at every frequency, preamble (input that saturates the "
            "actuator before each sine), offset (mean of the input, 0), settling (seconds before "
            "periods are measured, five of the slowest time constants; three periods at least), "
            "measured (periods, 2), samples (of a period, 240) and tick (of the bench in seconds: "
            "frequencies are rounded to whole ticks).",
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
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Plan the measurement that identifies an actuator."""
    value = parsed(pattern)
    _common.check_outputs([save], force=force)
    _common.check_word("plan", value.kind, (*_PATTERNS, _SINES))
    check_name("--input", input)
    if value.kind == _SINES:
        given = {"low": low, "high": high, "levels": levels}
        _common.refuse_given(given, "is not for a plan of sines")
        plan = _sines(value.options, hold, input)
        known = {"input": str(plan.input), "sines": [asdict(sine) for sine in plan.sines]}
        content: dict[str, Any] = {**known, "hours": plan.duration / 3600}
        file = _common.Written(save, partial(plan.to_csv, force=force))
        _common.finish(as_json, lambda: content, partial(_print_sines, plan), file)
        return
    if low is None or high is None:
        raise ParameterError(f"Missing option '--{'low' if low is None else 'high'}'")
    if input == _HOLD:
        raise ParameterError(f"--input is {_HOLD!r}, the header of hold times; give another name")
    inputs, report = _planned(value.kind, low, high, 10 if levels is None else levels)
    file = _common.table(save, {input: inputs, _HOLD: [hold] * inputs.size}, force)
    figures, show = partial(_figures, inputs, hold, report), partial(_print, inputs, hold, report)
    _common.finish(as_json, figures, show, file)


def _sines(options: Mapping[str, str], hold: float, input: str) -> Plan:
    """Return the plan of sines that options describe."""
    from minorloop.lab.plan import Plan
    from minorloop.lab.sines import grid

    each = {
        name: numbers(options[name], range(1, 1001), name, "F1,F2,...")
        for name in ("frequencies", "amplitudes")
        if name in options
    }
    return Plan.of_sines(called(grid, "plan sines", {**options, **each}, hold=hold), input)


def _print_sines(plan: Plan) -> None:
    typer.echo(f"{counted(len(plan), 'sine')}, {as_duration(plan.duration)} in all")
    kinds = dict.fromkeys((s.frequency, s.discarded, s.measured, s.samples) for s in plan.sines)
    rows = [[f"{row[0]:.6g}", *map(str, row[1:])] for row in kinds]
    _common.print_table(("frequency [Hz]", "discarded", "measured periods", "samples"), rows)


def _planned(
    pattern: str, low: float, high: float, levels: int
) -> tuple[FloatArray, ExcitationReport | None]:
    """Return the inputs, and a report of what they determine if there are few bands."""
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
