"""Output of runs, drives and resumed runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._run_progress import carry_out_levels
from minorloop.values import as_duration

if TYPE_CHECKING:
    from minorloop.drive import DriveResult
    from minorloop.identification.adaptive import RunFindings
    from minorloop.measurement import RunResult

SHOWN: dict[str, Any] = {"carry": carry_out_levels, "say": partial(typer.echo, err=True)}
"""Arguments of a measurement that show its progress."""


def show(found: RunResult, as_json: bool, report: Path | None = None, force: bool = False) -> None:
    """Print what was measured, after the report of a drive; exit with 1 if it missed targets."""
    drive = found.drive
    if report is not None and drive is not None:
        from minorloop.drive_report import drive_report

        drive_report(drive, found.figures, found.warnings).write(report, force=force)
    if as_json:
        _common.print_json(found.to_dict())
    else:
        _print(found)
    if drive is not None and drive.missed:
        # Exit status after a drive that missed targets: 2 would mean that it failed
        raise typer.Exit(1)


def _print(found: RunResult) -> None:
    figures = found.figures
    if found.mode == "finished":
        typer.echo("this run was finished already; nothing was applied")
    if found.mode == "replayed":
        typer.echo("first the recorded inputs were applied again, unmeasured")
    if found.drive is not None:
        _print_drive(found.drive, figures)
    elif "sines" in figures:
        held = as_duration(figures["held_s"])
        typer.echo(f"{figures['sines']} of {figures['planned']} sines measured, {held} in all")
    else:
        typer.echo(
            f"{_levels(figures, found.findings)}, {figures['settled']} settled, "
            f"{figures['extrapolated']} extrapolated, {figures['unsettled']} unsettled, "
            f"held for {as_duration(figures['held_s'])} in all"
        )
        if said := sampling(figures):
            typer.echo(said)
    if found.findings is not None:
        _print_findings(found.findings)
    _common.print_advice(found.warnings)
    verb = "frequency" if "sines" in figures else "identify"
    following = "" if found.drive is not None else f"; next: minorloop {verb} {figures['store']}"
    typer.echo(f"kept in {figures['store']}{following}")


def _print_drive(result: DriveResult, known: Mapping[str, Any]) -> None:
    unit = known["output"]
    columns = [f"target {unit}", str(known["input"]), "achieved", "error", "sd", "holds", ""]
    _common.print_table(columns, result.rows)
    score = result.summary()
    if score["rms"] is not None:
        typer.echo(f"error: {score['rms']:.3g} rms, {score['worst']:.3g} at most, in {unit}")
    if math.isfinite(result.offset):
        typer.echo(f"the sensor reads {result.offset:+.4g} more than the model in saturation")


def _levels(figures: Mapping[str, Any], findings: RunFindings | None) -> str:
    """Return in words how many levels a run measured, and how many it might have."""
    points, unused = figures["points"], figures["levels"] - figures["points"]
    if findings is None:
        return f"{points} of {figures['levels']} levels measured"
    if not figures["finished"]:
        return f"{points} of at most {figures['levels']} levels measured"
    if not unused:
        return f"{points} levels measured"
    from minorloop.identification.adaptive import REPEATS

    kept = f"{unused} kept for repetitions were" if unused <= REPEATS else f"{unused} more were"
    return f"{points} levels measured; {kept} not needed"


def _print_findings(found: RunFindings) -> None:
    """Print the holds that were left out, and the score on the validation holds."""
    for index in found.outliers:
        if index in found.changes:
            continue
        again = "it was repeated and left out" if index in found.repeated else "it is left out"
        typer.echo(f"hold {index + 1} lay far outside its band or was not measured; {again}")
    score = found.validation
    if score is not None:
        count = score.measured.size
        typer.echo(
            f"model from {found.holds} holds; on {count} more, never fitted: "
            f"{score.nrmse:.2%} of range rms, {score.covered} of {count} within their 90 % bands"
        )


def sampling(figures: Mapping[str, Any]) -> str:
    """Return in words how often the output was read, and how well the times are known.

    Empty if the times are exact, as for a twin, or unknown.
    """
    if not figures["time_uncertainty_s"] or figures["median_interval_s"] is None:
        return ""
    return (
        f"read every {figures['median_interval_s']:.3g} s, "
        f"times known to {figures['time_uncertainty_s']:.2g} s"
    )
