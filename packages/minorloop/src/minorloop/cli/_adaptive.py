"""Options and output of runs that choose their own inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli._common import HOLD

if TYPE_CHECKING:
    from minorloop.identification.adaptive import Adaptive, RunFindings
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.store import Point, Store


def design_of(plant: Actuator, options: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of `Adaptive` that the options of run give, for the store.

    Raises a `ParameterError` if the budget is too small; a `LimitError` if the range is beyond the
    limits of the actuator.
    """
    from minorloop.identification.adaptive import Adaptive, design_holds
    from minorloop.lab.actuator import check_input

    channel = plant.inputs[0]
    holds, hours = options["holds"], options["hours"]
    if holds is None and hours is None:
        holds = Adaptive.holds
    names = "low", "high", "levels", "step"
    design = {
        "low": channel.low,
        "high": channel.high,
        "levels": Adaptive.levels,
        "holds": design_holds(holds, hours, options["hold"] or HOLD),
        "least_gain": options["least_gain"] or 0.0,
        **{name: options[name] for name in names if options[name] is not None},
    }
    for end in ("low", "high"):
        check_input(plant.inputs, design[end])
    return design


def next_level(chooser: Adaptive, points: Sequence[Point]) -> float | None:
    """Return the level that follows these points; None where they are enough."""
    chooser.learn_noise([point.sd for point in points])
    return chooser.choose(*_inputs_and_outputs(points))


def findings_of(chooser: Adaptive, store: Store) -> RunFindings:
    """Return what the points of a store show."""
    return chooser.findings(*_inputs_and_outputs(store.points()))


def as_json(found: RunFindings) -> dict[str, Any]:
    """Return what ``--json`` prints of a run that chose its inputs."""
    score = found.validation
    return {
        "holds": found.holds,
        "outliers": list(found.outliers),
        "repeated": list(found.repeated),
        "changes": list(found.changes),
        "validation": score
        and {
            "holds": int(score.measured.size),
            "nrmse": score.nrmse,
            "covered": score.covered,
            "trusted": score.trusted,
        },
        "warnings": list(found.warnings),
    }


def print_findings(found: RunFindings) -> None:
    """Print which holds were left out, and the score on the validation holds."""
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


def progress(figures: dict[str, Any]) -> str:
    """Return how many levels a run measured, of those it may measure."""
    from minorloop.identification.adaptive import REPEATS

    points, unused = figures["points"], figures["levels"] - figures["points"]
    if not figures["finished"]:
        return f"{points} of at most {figures['levels']} levels measured"
    if not unused:
        return f"{points} levels measured"
    kept = f"{unused} kept for repetitions were" if unused <= REPEATS else f"{unused} more were"
    return f"{points} levels measured; {kept} not needed"


def _inputs_and_outputs(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    return [point.input for point in points], [point.value for point in points]
