"""``minorloop demo``: position a simulated actuator with and without a model of hysteresis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common

if TYPE_CHECKING:
    from minorloop.studies.positioning import Positioning

NAME = "demo"


def run(
    out: Annotated[Path | None, typer.Option(help="Folder for report, data and model.")] = None,
    seed: Annotated[int, typer.Option(help="Draws specimen and targets.")] = 0,
    noise: Annotated[float, typer.Option(help="Noise of the curvature sensor, 1/m.")] = 0.0,
    as_json: _common.Json = False,
) -> None:
    """Measure, identify, invert and drive an ionic polymer strip (a simulated one)."""
    if out is not None:
        from minorloop.files import make_folder

        make_folder(out)
    with _common.working("starting") as now:
        from minorloop.studies.positioning import run_positioning

        result = run_positioning(seed, noise, progress=now)
        if out is not None:
            now("writing the report")
            _write(result, out)
    if as_json:
        _common.print_json(result.summary)
        return
    _print(result)
    if out is not None:
        typer.echo(f"report written to {out / 'report.html'}; open it in a browser")


def _print(result: Positioning) -> None:
    rows = [
        (f"{target:.2f}", f"{a:.3f}", f"{ya:.2f}", f"{b:.3f}", f"{yb:.2f}")
        for target, a, ya, b, yb in zip(
            result.targets,
            result.preisach.voltages,
            result.preisach.achieved,
            result.quadratic.voltages,
            result.quadratic.achieved,
            strict=True,
        )
    ]
    columns = ("target [1/m]", "Preisach [V]", "achieved", "quadratic [V]", "achieved")
    _common.print_table(columns, rows, f"{len(rows)} curvatures, open loop")
    ratio = result.quadratic.rms / result.preisach.rms
    typer.echo(
        f"rms error {result.preisach.rms:.3f} 1/m with the Preisach inverse, "
        f"{result.quadratic.rms:.3f} 1/m with the quadratic: {ratio:.1f} times"
    )
    typer.echo(
        f"largest error {result.preisach.worst:.3f} 1/m against {result.quadratic.worst:.3f} 1/m"
    )


def _write(result: Positioning, folder: Path) -> None:
    from minorloop import modelfile
    from minorloop.studies.positioning_report import positioning_report

    positioning_report(result).write(folder / "report.html")
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
