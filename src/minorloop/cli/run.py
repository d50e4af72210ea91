"""``minorloop run``: carry a plan out on an actuator, and keep every settled point."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._watch import as_duration, watching

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.store import Store

NAME = "run"
EXAMPLE = "minorloop run --actuator twin:ipmc --plan plan.csv --store runs.sqlite"


def run(
    actuator: Annotated[
        str, typer.Option(show_default=False, help="Its address: twin:ipmc or twin:fibre.")
    ],
    plan: Annotated[
        Path, typer.Option(show_default=False, help="CSV file, as plan --save writes it.")
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
    as_json: _common.Json = False,
) -> None:
    """Hold each level of a plan until the output settles; resume goes on after any stop."""
    from minorloop.connect import connect
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import check_plan
    from minorloop.lab.store import Setup, Store

    _common.check_outputs([store], inputs=[plan], force=False)
    settings: dict[str, Any] = {"tolerance": tolerance, "sample_interval": interval}
    if shortest is not None:
        settings["shortest"] = shortest
    wanted = Plan.from_csv(plan, **settings)
    plant = connect(actuator, specimen=specimen, noise=noise, seed=seed)
    check_plan(plant, wanted)
    names = str(plant.inputs[0]), str(plant.outputs[0])
    setup = Setup(actuator, *names, specimen, seed, {"noise": noise})
    with Store.create(store, wanted, setup) as opened:
        carry_out(plant, opened, as_json)


def carry_out(plant: Actuator, store: Store, as_json: bool) -> None:
    """Do what is left of the plan in a store, and say what came of it."""
    from minorloop.lab.run import run as carry

    with watching(store) as watch:
        way = carry(plant, store.plan, store, watch=watch)
    figures = summary(store)
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
    typer.echo(f"kept in {store.path}; next: minorloop identify {store.path}")


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
