"""``minorloop run``: carry a plan out on an actuator, and keep every settled point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._watch import as_duration, watching
from minorloop.errors import StoreError

if TYPE_CHECKING:
    from minorloop.identification.adaptive import Adaptive
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.store import Point, Setup, Store

NAME = "run"
EXAMPLE = "minorloop run --actuator twin:ipmc --plan plan.csv --store runs.sqlite"
_HOLDS = 12


def run(
    actuator: Annotated[
        str,
        typer.Option(
            show_default=False, help="Its address: twin:ipmc, twin:fibre, or visa:bench.json."
        ),
    ],
    plan: Annotated[
        str,
        typer.Option(
            show_default=False,
            help="CSV file, as plan --save writes it; or adaptive, to choose each input by what "
            "was measured before.",
        ),
    ],
    store: Annotated[
        Path, typer.Option(show_default=False, help="Where the points go: a new file.")
    ],
    specimen: Annotated[
        int | None, _common.whole_option("Seed of a twin's specimen; without it, nominal.")
    ] = None,
    noise: Annotated[
        float, _common.number_option("Standard deviation of a twin's sensor, in its unit.")
    ] = 0.0,
    seed: Annotated[int, _common.whole_option("Seed of a twin's noise.")] = 0,
    tolerance: Annotated[
        float | None,
        _common.number_option(
            "Slope of a settled output, its unit per second; without it, what moves the output "
            "by 0.2 % of its span in another hold."
        ),
    ] = None,
    shortest: Annotated[
        float | None,
        _common.number_option("Shortest hold in seconds; without it, a quarter of the longest."),
    ] = None,
    interval: Annotated[
        float | None,
        _common.number_option("Seconds between samples; without it, 1/200 of the least hold."),
    ] = None,
    holds: Annotated[
        int | None, _common.whole_option("Adaptive: holds to spend, 12 if not given.")
    ] = None,
    hours: Annotated[
        float | None, _common.number_option("Adaptive: hours to spend, instead of holds.")
    ] = None,
    hold: Annotated[float, _common.number_option("Adaptive: longest hold in seconds.")] = 200.0,
    low: Annotated[
        float | None, _common.number_option("Adaptive: least input; the actuator's limit.")
    ] = None,
    high: Annotated[
        float | None, _common.number_option("Adaptive: greatest input; the actuator's limit.")
    ] = None,
    step: Annotated[
        float | None, _common.number_option("Adaptive: largest change from hold to hold.")
    ] = None,
    least_gain: Annotated[
        float,
        _common.number_option(
            "Adaptive: stop when a hold should make the model surer by less than this share."
        ),
    ] = 0.0,
    levels: Annotated[int, _common.whole_option("Adaptive: bands of the model.")] = 20,
    as_json: _common.Json = False,
) -> None:
    """Hold each level of a plan until the output settles; resume goes on after any stop."""
    from minorloop.connect import connect
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import check_plan
    from minorloop.lab.store import Setup, Store

    plant = connect(actuator, specimen=specimen, noise=noise, seed=seed)
    adaptive = plan == "adaptive"
    if store.exists():
        raise StoreError(
            f"{store} exists already; minorloop resume --store {store} goes on with a run, "
            "or give another name"
        )
    _common.check_outputs([store], inputs=[] if adaptive else [Path(plan)], force=False)
    settings: dict[str, Any] = {"tolerance": tolerance, "sample_interval": interval}
    if shortest is not None:
        settings["shortest"] = shortest
    names = str(plant.inputs[0]), str(plant.outputs[0])
    setup = Setup(actuator, *names, specimen, seed, {"noise": noise})
    if adaptive:
        budget = (holds, hours, hold)
        setup = replace(setup, design=_design(plant, budget, low, high, step, least_gain, levels))
        chooser = _chooser(setup)
        levels_left_open = [float("nan")] * chooser.most
        wanted = Plan(levels_left_open, hold, input=names[0], **settings)
    else:
        wanted = Plan.from_csv(plan, **settings)
    check_plan(plant, wanted)
    with Store.create(store, wanted, setup) as opened:
        carry_out(plant, opened, as_json)


def carry_out(plant: Actuator, store: Store, as_json: bool) -> None:
    """Do what is left of the plan in a store, and say what came of it."""
    from minorloop.lab.run import run as carry

    chooser = None if store.setup.design is None else _chooser(store.setup)
    choose = None if chooser is None else partial(_chosen, chooser)
    with watching(store, chooser) as watch:
        way = carry(plant, store.plan, store, choose=choose, watch=watch)
    figures = summary(store)
    if chooser is not None:
        figures |= _validated(chooser, store)
    if as_json:
        _common.print_json({**figures, "way": way})
        return
    if way == "finished":
        typer.echo("this run had finished already; nothing was applied")
    if way == "replayed":
        typer.echo("the actuator was taken through its recorded inputs again, unmeasured, first")
    typer.echo(
        f"{figures['points']} of {figures['levels']} levels measured, "
        f"{figures['settled']} settled, {figures['extrapolated']} extrapolated, "
        f"{figures['unsettled']} unsettled, held for {as_duration(figures['held_s'])} in all"
    )
    if chooser is not None:
        _print_validation(figures)
    typer.echo(f"kept in {store.path}; next: minorloop identify {store.path}")


def _design(
    plant: Actuator,
    budget: tuple[int | None, float | None, float],
    low: float | None,
    high: float | None,
    step: float | None,
    least_gain: float,
    levels: int,
) -> dict[str, Any]:
    """What chooses the levels, as it is kept in the store."""
    from minorloop.identification.design import budget as as_holds
    from minorloop.lab.actuator import check_input

    holds, hours, hold = budget
    if holds is None and hours is None:
        holds = _HOLDS
    channel = plant.inputs[0]
    chosen = {
        "low": channel.low if low is None else low,
        "high": channel.high if high is None else high,
        "levels": levels,
        "holds": as_holds(holds, hours, hold),
        "least_gain": least_gain,
    }
    for end in ("low", "high"):
        check_input(plant.inputs, chosen[end])
    return chosen if step is None else {**chosen, "step": step}


def _chooser(setup: Setup) -> Adaptive:
    from minorloop.identification.adaptive import Adaptive

    return Adaptive(**(setup.design or {}), seed=setup.seed)


def _chosen(chooser: Adaptive, points: Sequence[Point]) -> float | None:
    return chooser.choose([point.input for point in points], [point.value for point in points])


def _validated(chooser: Adaptive, store: Store) -> dict[str, Any]:
    """The score on the holds that are never fitted, and what was repeated."""
    points = store.points()
    u, y = [point.input for point in points], [point.value for point in points]
    found = chooser.validation(u, y)
    roles = chooser.roles(u, y)
    return {
        "holds": roles.count("design") + roles.count("repeat"),
        "knocked": [k for k, role in enumerate(roles) if role == "knocked"],
        "validation": None
        if found is None
        else {
            "holds": int(found.measured.size),
            "nrmse": found.nrmse,
            "covered": found.covered,
        },
    }


def _print_validation(figures: dict[str, Any]) -> None:
    for index in figures["knocked"]:
        typer.echo(f"hold {index + 1} lay far outside its band; it was repeated and left out")
    score = figures["validation"]
    if score is not None:
        typer.echo(
            f"model from {figures['holds']} holds; on {score['holds']} more, never fitted: "
            f"{score['nrmse']:.2%} of range rms, {score['covered']} of {score['holds']} within "
            "their 90 % bands"
        )


def summary(store: Store) -> dict[str, Any]:
    """What a store is about, and how far it has come."""
    points = store.points()
    verdicts = [point.verdict for point in points]
    return {
        "store": str(store.path),
        "actuator": store.setup.address,
        "specimen": store.setup.specimen,
        "seed": store.setup.seed,
        **store.setup.options,
        "input": store.setup.input,
        "output": store.setup.output,
        "levels": len(store.plan),
        "points": len(points),
        "finished": store.finished,
        **{name: verdicts.count(name) for name in ("settled", "extrapolated", "unsettled")},
        "held_s": sum(point.held for point in points),
    }
