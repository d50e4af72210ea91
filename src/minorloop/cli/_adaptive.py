"""What the verbs say about runs that chose their own inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.identification.adaptive import Adaptive, Validation
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.store import Point, Setup, Store

HOLDS, HOLD, LEVELS = 12, 200.0, 20


def design_of(plant: Actuator, options: dict[str, Any]) -> dict[str, Any]:
    """What chooses the levels, as it is kept in the store; ``options`` are those of run.

    Raises
    ------
    ParameterError
        If the budget is none.
    LimitError
        If the range is beyond the limits of the actuator.
    """
    from minorloop.lab.actuator import check_input

    channel = plant.inputs[0]
    chosen = {
        "low": channel.low if options["low"] is None else options["low"],
        "high": channel.high if options["high"] is None else options["high"],
        "levels": LEVELS if options["levels"] is None else options["levels"],
        "holds": _holds(options["holds"], options["hours"], options["hold"] or HOLD),
        "least_gain": options["least_gain"] or 0.0,
    }
    for end in ("low", "high"):
        check_input(plant.inputs, chosen[end])
    return chosen if options["step"] is None else {**chosen, "step": options["step"]}


def _holds(holds: int | None, hours: float | None, hold: float) -> int:
    """The design's share of a budget: validation and repetitions are within the hours."""
    from minorloop.identification.adaptive import REPEATS, VALIDATION
    from minorloop.identification.design import budget

    if holds is None and hours is None:
        return HOLDS
    count = budget(holds, hours, hold)
    if hours is None:
        return count
    if count < VALIDATION + REPEATS + 3:
        least = (VALIDATION + REPEATS + 3) * hold / 3600
        raise ParameterError(
            f"{hours:g} h are {count} holds of {hold:g} s, and {VALIDATION} validate and {REPEATS} "
            f"are kept for repetitions; give {least:.3g} h or more"
        )
    return count - VALIDATION - REPEATS


def chooser_of(setup: Setup, points: Sequence[Point]) -> Adaptive:
    """What chose the levels of a store, with the noise that its points show."""
    from minorloop.identification.adaptive import Adaptive

    chooser = Adaptive(**(setup.design or {}), seed=setup.seed)
    chooser.learn_noise([point.sd for point in points])
    return chooser


def chosen(chooser: Adaptive, points: Sequence[Point]) -> float | None:
    """The level that follows these points."""
    chooser.learn_noise([point.sd for point in points])
    return chooser.choose(*columns(points))


def columns(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    """Inputs and settled outputs."""
    return [point.input for point in points], [point.value for point in points]


def findings(chooser: Adaptive, store: Store) -> dict[str, Any]:
    """The score on the holds that are never fitted, what was set aside, and what is wrong."""
    u, y = columns(store.points())
    roles, changes = chooser.roles(u, y), chooser.changes(u, y)
    found = chooser.validation(u, y)
    return {
        "holds": sum(role in ("design", "repeat") for role in roles),
        "knocked": [k for k, role in enumerate(roles) if role == "outlier"],
        "repeated": [k for k in range(len(u) - 1) if roles[k] == "outlier" and u[k] == u[k + 1]],
        "changes": changes,
        "validation": found and _score(found),
        "warnings": warnings(chooser, u, y),
    }


def _score(found: Validation) -> dict[str, Any]:
    return {
        "holds": int(found.measured.size),
        "nrmse": found.nrmse,
        "covered": found.covered,
        "trusted": found.trusted,
    }


def warnings(chooser: Adaptive, u: list[float], y: list[float]) -> list[str]:
    """What is wrong with the model of a run; one sentence each."""
    from minorloop.errors import MinorloopError
    from minorloop.identification.advising import fault_warnings

    said = [
        f"hold {k + 1} contradicts the model and its repetition gave the same: the actuator (or "
        f"its sensor) changed at about hold {k + 1}, or no such model follows it; the bands are "
        "widened by as much"
        for k in chooser.changes(u, y)
    ]
    found = chooser.validation(u, y)
    if found is not None and not found.trusted:
        said.append(
            f"do not trust this model: {found.covered} of {found.measured.size} validation holds "
            f"lie within their 90 % bands, with an error of {found.nrmse:.2%} of range"
        )
    try:
        return [*said, *fault_warnings(chooser.identification(u, y))]
    except MinorloopError:
        return said  # Too few points for a model yet.


def print_findings(figures: dict[str, Any]) -> None:
    """What was left out, and the score."""
    import typer

    for index in figures["knocked"]:
        if index in figures["changes"]:
            continue
        again = "it was repeated and left out" if index in figures["repeated"] else "it is left out"
        typer.echo(f"hold {index + 1} lay far outside its band or was not measured; {again}")
    score = figures["validation"]
    if score is not None:
        typer.echo(
            f"model from {figures['holds']} holds; on {score['holds']} more, never fitted: "
            f"{score['nrmse']:.2%} of range rms, {score['covered']} of {score['holds']} within "
            "their 90 % bands"
        )


def measured(figures: dict[str, Any]) -> str:
    """How many levels a run took, of those it may take."""
    from minorloop.identification.adaptive import REPEATS

    points, unused = figures["points"], figures["levels"] - figures["points"]
    if not figures["finished"]:
        return f"{points} of at most {figures['levels']} levels measured"
    if not unused:
        return f"{points} levels measured"
    kept = f"{unused} kept for repetitions were" if unused <= REPEATS else f"{unused} more were"
    return f"{points} levels measured; {kept} not needed"
