"""``minorloop run``: carry a plan out on an actuator, and keep every settled point."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _adaptive, _common
from minorloop.cli._watch import as_duration, watching
from minorloop.errors import InstrumentError, ParameterError, StoreError

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.plan import Plan
    from minorloop.lab.store import Setup, Store

NAME = "run"
EXAMPLE = "minorloop run --actuator twin:ipmc --plan plan.csv --store runs.sqlite"
SLOW = 1.2
"""Sample intervals of the plan from which on those of a hold count as longer."""
_ADAPTIVE = ("holds", "hours", "hold", "low", "high", "step", "least_gain", "levels")


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
        _common.number_option(
            "Seconds between samples; without it, 1/200 of the least hold, or what the meter takes."
        ),
    ] = None,
    holds: Annotated[
        int | None,
        _common.whole_option(
            "Adaptive: holds to spend, 12 if not given; 4 for validation and up to 3 repetitions "
            "come on top."
        ),
    ] = None,
    hours: Annotated[
        float | None,
        _common.number_option(
            "Adaptive: hours to spend at most, validation and repetitions included, instead of "
            "holds."
        ),
    ] = None,
    hold: Annotated[
        float | None, _common.number_option("Adaptive: longest hold in seconds, 200 if not given.")
    ] = None,
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
        float | None,
        _common.number_option(
            "Adaptive: stop when a hold should make the model surer by less than this share."
        ),
    ] = None,
    levels: Annotated[
        int | None, _common.whole_option("Adaptive: bands of the model, 20 if not given.")
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Hold each level of a plan until the output settles; resume goes on after any stop."""
    from minorloop.lab.run import answer_time, check_plan
    from minorloop.lab.store import Setup, Store

    given = locals()
    options = {name: given[name] for name in _ADAPTIVE}
    adaptive = plan == "adaptive"
    if not adaptive:
        _refuse(options, plan)
    settings: dict[str, Any] = {"tolerance": tolerance, "sample_interval": interval}
    if shortest is not None:
        settings["shortest"] = shortest
    with _common.connected(actuator, specimen=specimen, noise=noise, seed=seed) as plant:
        if store.exists():
            raise StoreError(
                f"{store} exists already; minorloop resume --store {store} goes on with a run, "
                "or give another name"
            )
        _common.check_outputs([store], inputs=[] if adaptive else [Path(plan)], force=False)
        names = str(plant.inputs[0]), str(plant.outputs[0])
        setup = Setup(actuator, *names, specimen, seed, {"noise": noise})
        if adaptive:
            setup = replace(setup, design=_adaptive.design_of(plant, options))
        wanted = _wanted(plan, setup, _adaptive.HOLD if hold is None else hold, settings)
        if interval is None:
            wanted = wanted.slowed(answer_time(plant))
        check_plan(plant, wanted)
        with Store.create(store, wanted, setup) as opened:
            carry_out(plant, opened, as_json)


def _wanted(plan: str, setup: Setup, longest: float, settings: dict[str, Any]) -> Plan:
    """The plan of a file, or one whose levels are open."""
    from minorloop.lab.plan import Plan

    if setup.design is None:
        return Plan.from_csv(plan, **settings)
    levels_left_open = [float("nan")] * _adaptive.chooser_of(setup, []).most
    return Plan(levels_left_open, longest, input=setup.input, **settings)


def carry_out(plant: Actuator, store: Store, as_json: bool) -> None:
    """Do what is left of the plan in a store, and say what came of it."""
    from minorloop.lab.run import run as carry

    chooser = (
        None if store.setup.design is None else _adaptive.chooser_of(store.setup, store.points())
    )
    choose = None if chooser is None else partial(_adaptive.chosen, chooser)
    try:
        with watching(store, chooser) as watch:
            way = carry(plant, store.plan, store, choose=choose, watch=watch)
    except InstrumentError as error:
        left = (
            ""
            if store.finished
            else (f", and minorloop resume --store {shlex.quote(str(store.path))} goes on")
        )
        kept = f"{len(store)} of {len(store.plan)} levels are kept"
        raise type(error)(f"{error}; {kept}{left}") from None
    figures = summary(store)
    if chooser is not None:
        figures |= _adaptive.findings(chooser, store)
    figures["warnings"] = [
        *getattr(plant, "warnings", ()),
        *figures.get("warnings", []),
        *_unsettled(figures),
        *_slow(figures),
    ]
    if as_json:
        _common.print_json({**figures, "way": way})
        return
    if way == "finished":
        typer.echo("this run had finished already; nothing was applied")
    if way == "replayed":
        typer.echo("the actuator was taken through its recorded inputs again, unmeasured, first")
    levels = f"{figures['points']} of {figures['levels']} levels measured"
    typer.echo(
        f"{levels if chooser is None else _adaptive.measured(figures)}, "
        f"{figures['settled']} settled, {figures['extrapolated']} extrapolated, "
        f"{figures['unsettled']} unsettled, held for {as_duration(figures['held_s'])} in all"
    )
    if said := sampling(figures):
        typer.echo(said)
    if chooser is not None:
        _adaptive.print_findings(figures)
    _common.print_advice(figures["warnings"])
    typer.echo(f"kept in {store.path}; next: minorloop identify {store.path}")


def _refuse(options: dict[str, Any], plan: str) -> None:
    """Options of adaptive runs, where a plan says all that."""
    for name, value in options.items():
        if value is not None:
            raise ParameterError(
                f"--{name.replace('_', '-')} is for --plan adaptive, and {plan} says what to hold; "
                "leave it out"
            )


def _unsettled(figures: dict[str, Any]) -> list[str]:
    """A warning where half of the holds or more had not settled."""
    if not figures["points"] or 2 * figures["unsettled"] < figures["points"]:
        return []
    return [
        f"{figures['unsettled']} of {figures['points']} points had not settled, so that they say "
        "little of settled outputs; hold longer"
    ]


def _slow(figures: dict[str, Any]) -> list[str]:
    """A warning where the meter did not give the samples that the plan asks for."""
    asked, most = figures["sample_interval_s"], figures["longest_interval_s"]
    if most is None or most <= SLOW * asked:
        return []
    return [
        f"the meter was slow at times: samples were up to {most:.3g} s apart, not {asked:g} "
        "s; their times are the true ones"
    ]


def sampling(figures: dict[str, Any]) -> str:
    """How often the output was read, in words, and how well the times are known.

    Empty where the times are exact, as those of a twin, or the store does not know.
    """
    if not figures["time_uncertainty_s"] or figures["median_interval_s"] is None:
        return ""
    return (
        f"read every {figures['median_interval_s']:.3g} s, "
        f"times known to {figures['time_uncertainty_s']:.2g} s"
    )


def summary(store: Store) -> dict[str, Any]:
    """What a store is about, and how far it has come."""
    points = store.points()
    verdicts = [point.verdict for point in points]
    intervals = [p.sample_interval for p in points if p.sample_interval > 0]
    doubts = [p.time_uncertainty for p in points if p.time_uncertainty >= 0]
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
        "sample_interval_s": store.plan.sample_interval,
        "median_interval_s": median(intervals) if intervals else None,
        "longest_interval_s": max(intervals, default=None),
        "time_uncertainty_s": max(doubts, default=None),
    }
