"""``minorloop demo``: position a simulated actuator with two models."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _common

NAME = "demo"
EXAMPLE = "minorloop demo --out demo --seed 3"


def run(
    out: Annotated[
        Path | None, typer.Option(help="New or empty folder for report, data and model.")
    ] = None,
    seed: Annotated[int, _common.whole_option("Seed of specimen and targets, 0 or more.")] = 0,
    noise: Annotated[
        float, _common.number_option("Standard deviation of the curvature sensor, in 1/m.")
    ] = 0.0,
    as_json: _common.Json = False,
) -> None:
    """Measure, identify, invert and drive a simulated ionic polymer strip."""
    if out is not None:
        from minorloop.files import make_folder

        make_folder(out)
    with _common.working("starting") as now:
        from minorloop.positioning import run_positioning
        from minorloop.positioning_report import positioning_report

        result = run_positioning(seed, noise, progress=now)
    if out is not None:
        result.save(out)
    one, other = result.preisach, result.quadratic
    columns = ("target [1/m]", "Preisach [V]", "achieved", "quadratic [V]", "achieved")

    def show() -> None:
        title = f"{len(result.rows)} curvatures in 1/m, open loop"
        _common.print_table(columns, result.rows, title)
        typer.echo(
            f"rms error {one.rms:.3f} 1/m with the Preisach inverse, {other.rms:.3f} 1/m with the "
            f"quadratic: {other.rms / one.rms:.1f} times"
        )
        typer.echo(f"largest error {one.worst:.3f} 1/m and {other.worst:.3f} 1/m")

    report = None if out is None else out / "report.html"
    draw = partial(positioning_report, result)
    _common.finish(as_json, lambda: result.summary, show, _common.drawn(report, draw, force=False))
