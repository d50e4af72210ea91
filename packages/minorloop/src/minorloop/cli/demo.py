"""``minorloop demo``: position a simulated actuator with two models."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common

if TYPE_CHECKING:
    from minorloop.positioning import Positioning

NAME = "demo"
EXAMPLE = "minorloop demo --out demo --seed 3"


def run(
    out: Annotated[
        Path | None,
        typer.Option(help="New or empty folder for report, data and model."),
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

        result = run_positioning(seed, noise, progress=now)
    steps: list[Callable[[], None]] = [partial(_show, result, as_json)]
    if out is not None:
        steps[:0] = [partial(_save, result, out), partial(_report, result, out, as_json)]
    _common.do_all(steps)


def _show(result: Positioning, as_json: bool) -> None:
    if as_json:
        _common.print_json(result.summary)
        return
    columns = ("target [1/m]", "Preisach [V]", "achieved", "quadratic [V]", "achieved")
    _common.print_table(columns, result.rows, f"{len(result.rows)} curvatures in 1/m, open loop")
    one, other = result.preisach, result.quadratic
    typer.echo(
        f"rms error {one.rms:.3f} 1/m with the Preisach inverse, {other.rms:.3f} 1/m with the "
        f"quadratic: {other.rms / one.rms:.1f} times"
    )
    typer.echo(f"largest error {one.worst:.3f} 1/m and {other.worst:.3f} 1/m")


def _save(result: Positioning, folder: Path) -> None:
    from minorloop import modelfile

    _common.write_csv(
        folder / "staircase.csv",
        {"voltage [V]": result.voltages, "curvature [1/m]": result.settled},
        force=False,
    )
    modelfile.save(
        result.identification.model,
        folder / "model.json",
        input=result.staircase.input,
        output=result.staircase.output,
        provenance=modelfile.Provenance.of(folder / "staircase.csv"),
    )


def _report(result: Positioning, folder: Path, as_json: bool) -> None:
    from minorloop.positioning_report import positioning_report

    path = folder / "report.html"
    with _common.working("drawing the report"):
        _common.write_report(partial(positioning_report, result), path, force=False)
    if not as_json:
        typer.echo(f"report written to {path}; open it in a browser")
