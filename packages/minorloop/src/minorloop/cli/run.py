"""``minorloop run``: carry out a plan on an actuator, and store every settled point."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from minorloop.cli import _adaptive, _common, _conversion
from minorloop.cli._run_progress import watching
from minorloop.errors import InstrumentError
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import Choose, ResumeMode, RunProgress
    from minorloop.lab.store import Setup, Store

NAME = "run"
EXAMPLE = "minorloop run --actuator twin:ipmc --plan plan.csv --store runs.sqlite"
SLOW = 1.2
"""A warning is given from this ratio of the sample interval of a hold to that of the plan."""
_ADAPTIVE = ("holds", "hours", "hold", "low", "high", "step", "least_gain", "levels")


class RunCommand(TyperCommand):
    """``minorloop run``; its help lists the addresses that exist."""

    def get_help(self, ctx: Any) -> str:
        """Return the help with the addresses."""
        from minorloop.connect import addresses

        (actuator,) = (each for each in self.params if each.name == "actuator")
        actuator.help = f"Its address: {', '.join(addresses())}."  # type: ignore[attr-defined]
        return super().get_help(ctx)


COMMAND = RunCommand


def run(
    actuator: _common.Address,
    plan: Annotated[
        str,
        typer.Option(
            show_default=False,
            help="CSV file, as plan --save writes it; or adaptive, to choose each input from the "
            "measurements before it.",
        ),
    ],
    store: Annotated[Path, typer.Option(show_default=False, help="New file for the points.")],
    input: _common.Input = None,
    output: _common.Output = None,
    laser: _conversion.Laser = None,
    linear: _conversion.Linear = None,
    polynomial: _conversion.Polynomial = None,
    table: _conversion.Table = None,
    name: _conversion.Name = None,
    unit: _conversion.Unit = None,
    specimen: _common.Specimen = None,
    noise: _common.Noise = 0.0,
    seed: _common.Seed = 0,
    tolerance: Annotated[
        float | None,
        _common.number_option(
            "Slope of a settled output, in its unit per second; if not given, the slope that moves "
            "the output by 0.2 % of its span in another hold."
        ),
    ] = None,
    shortest: Annotated[
        float | None,
        _common.seconds_option("Shortest hold in seconds; a quarter of the longest if not given."),
    ] = None,
    interval: Annotated[
        float | None,
        _common.seconds_option(
            "Seconds between samples; if not given, 1/200 of the shortest hold, or what the meter "
            "needs."
        ),
    ] = None,
    holds: Annotated[
        int | None,
        _common.whole_option(
            "Adaptive: holds of the design, 12 if not given; 4 for validation and up to 3 "
            "repetitions are added."
        ),
    ] = None,
    hours: Annotated[
        float | None,
        _common.number_option(
            "Adaptive: hours at most, validation and repetitions included, instead of holds."
        ),
    ] = None,
    hold: Annotated[
        float | None, _common.seconds_option("Adaptive: longest hold in seconds, 200 if not given.")
    ] = None,
    low: Annotated[
        float | None, _common.number_option("Adaptive: least input; the limit if not given.")
    ] = None,
    high: Annotated[
        float | None, _common.number_option("Adaptive: greatest input; the limit if not given.")
    ] = None,
    step: Annotated[
        float | None, _common.number_option("Adaptive: largest change from hold to hold.")
    ] = None,
    least_gain: Annotated[
        float | None,
        _common.number_option(
            "Adaptive: stop when a hold would reduce the standard deviation by a smaller share."
        ),
    ] = None,
    levels: Annotated[
        int | None, _common.whole_option("Adaptive: bands of the model, 20 if not given.")
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Carry out a plan: levels held until the output settles, or sines; resume continues it."""
    from minorloop.lab.run import answer_time, check_plan
    from minorloop.lab.store import Setup, Store
    from minorloop.lab.wrapped_actuator import single_channel

    given = locals()
    options = {name: given[name] for name in _ADAPTIVE}
    adaptive = plan == "adaptive"
    if not adaptive:
        why = f"is for --plan adaptive, not for a plan in a file ({plan})"
        _common.refuse_given(options, why)
    settings = {"tolerance": tolerance, "sample_interval": interval, "shortest": shortest}
    conversion = _conversion.ConversionOptions(laser, linear, polynomial, table, name, unit)
    with _common.connected(actuator, specimen=specimen, noise=noise, seed=seed) as whole:
        channel = single_channel(whole, _input(whole, plan, input), output)
        plant = conversion.converted(channel)
        _common.check_new_store(store)
        _common.check_outputs([store], inputs=[] if adaptive else [Path(plan)], force=False)
        names = str(plant.inputs[0]), str(plant.outputs[0])
        given_to = {"noise": noise, **conversion.for_setup(channel.outputs[0])}
        setup = Setup(actuator, *names, specimen, seed, given_to)
        if adaptive:
            setup = replace(setup, design=_adaptive.design_of(plant, options))
        wanted = _wanted(plan, setup, _common.HOLD if hold is None else hold, settings)
        if interval is None:
            wanted = wanted.slowed(answer_time(plant))
        check_plan(plant, wanted)
        _note_left_out(wanted)
        with Store.create(store, wanted, setup) as opened:
            carry_out(plant, opened, as_json)


def _input(plant: Actuator, plan: str, given: str | None) -> str | None:
    """Return the input as given, or the one of several that a column of the plan has."""
    from minorloop.lab.columns import read_headers

    if given is not None or len(plant.inputs) == 1 or plan == "adaptive":
        return given
    headers = read_headers(Path(plan))
    found = [str(channel) for channel in plant.inputs if str(channel) in headers]
    return found[0] if len(found) == 1 else None


def _wanted(plan: str, setup: Setup, longest: float, settings: dict[str, Any]) -> Plan:
    """Return the plan of a file, or one whose levels are open."""
    from minorloop.identification.reading import chooser_of
    from minorloop.lab.columns import read_headers
    from minorloop.lab.plan import Plan

    if setup.design is None:
        known = setup.input in read_headers(Path(plan))
        return Plan.from_csv(plan, input=setup.input if known else None, **settings)
    levels_left_open = [float("nan")] * chooser_of(setup, []).most
    return Plan(levels_left_open, longest, input=setup.input, **settings)


def _note_left_out(plan: Plan) -> None:
    """Print which sines will be left out; refuse a plan of sines that cannot be evaluated.

    Raises a `SignalError` if no frequency has a sine at every amplitude.
    """
    from minorloop.identification.sine_response import at_every_amplitude

    if plan.sines:
        sines = [(sine.frequency, sine.amplitude) for sine in plan.sines]
        if left := at_every_amplitude(*map(list, zip(*sines, strict=True)))[1]:
            typer.echo(f"note: when this run is evaluated, {left}", err=True)


def carry_out(plant: Actuator, store: Store, as_json: bool) -> None:
    """Carry out the rest of the plan in a store, and print the results."""
    chooser = None
    if store.setup.design is not None:
        from minorloop.identification.reading import chooser_of

        chooser = chooser_of(store.setup, store.points())
    choose = None if chooser is None else partial(_adaptive.next_level, chooser)
    mode, faults = carry_out_levels(plant, store, choose)
    if store.plan.sines:
        _print_sines(store, mode, as_json)
        return
    figures = summary(store)
    found = None if chooser is None else _adaptive.findings_of(chooser, store)
    if found is not None:
        figures |= _adaptive.as_json(found)
    figures["warnings"] = [*figures.get("warnings", []), *run_warnings(plant, figures), *faults]
    if as_json:
        _common.print_json({**figures, "mode": mode})
        return
    print_mode(mode)
    levels = f"{figures['points']} of {figures['levels']} levels measured"
    typer.echo(
        f"{levels if chooser is None else _adaptive.progress(figures)}, "
        f"{figures['settled']} settled, {figures['extrapolated']} extrapolated, "
        f"{figures['unsettled']} unsettled, held for {as_duration(figures['held_s'])} in all"
    )
    if said := sampling(figures):
        typer.echo(said)
    if found is not None:
        _adaptive.print_findings(found)
    _common.print_advice(figures["warnings"])
    typer.echo(f"kept in {store.path}; next: minorloop identify {store.path}")


def _print_sines(store: Store, mode: ResumeMode, as_json: bool) -> None:
    """Print how many sines there are."""
    totals, planned = store.totals(), len(store.plan)
    count, held = totals["points"], totals["held"]
    if as_json:
        about = {"store": str(store.path), "actuator": store.setup.address}
        counts = {"sines": count, "planned": planned, "finished": store.finished}
        _common.print_json({**about, **counts, "held_s": held, "mode": mode})
        return
    print_mode(mode)
    typer.echo(f"{count} of {planned} sines measured, {as_duration(held)} in all")
    typer.echo(f"kept in {store.path}; next: minorloop frequency {store.path}")


def carry_out_levels(
    plant: Actuator,
    store: Store,
    choose: Choose | None,
    again: str | None = None,
) -> tuple[ResumeMode, list[str]]:
    """Carry out the rest of a run and show its progress; if it ends, it says how to continue.

    ``again`` says how, if not with resume. Returns the mode, and what was wrong with points.
    """
    if again is None:
        again = f"continue with minorloop resume --store {shlex.quote(str(store.path))}"
    from minorloop.drive import MismatchError
    from minorloop.lab.run import run as carry

    warnings = []

    try:
        with watching(store) as watch:

            def noted(progress: RunProgress) -> None:
                watch(progress)
                if progress.warning:
                    warnings.append(progress.warning)

            return carry(plant, store.plan, store, choose=choose, watch=noted), warnings
    except KeyboardInterrupt:
        if not store.finished:
            safe = "the actuator has confirmed that it is safe"  # or another error comes here
            typer.echo(f"{_kept(store)}; {safe}; {again}", err=True)
        raise
    except InstrumentError as error:
        left = "" if store.finished else f"; {again}"
        if isinstance(error, MismatchError):
            left = (
                "; when that is corrected, begin a new drive with another --store, because to "
                "resume this one, with what it keeps, gives the same error"
            )
        raise type(error)(f"{error}; {_kept(store)}{left}") from None


def _kept(store: Store) -> str:
    what = "sines" if store.plan.sines else "levels"
    return f"{len(store)} of {len(store.plan)} {what} are kept"


def print_mode(mode: ResumeMode) -> None:
    """Say how the actuator was brought to the first level, where that is not obvious."""
    if mode == "finished":
        typer.echo("this run was finished already; nothing was applied")
    if mode == "replayed":
        typer.echo("first the recorded inputs were applied again, unmeasured")


def run_warnings(plant: Actuator, figures: dict[str, Any]) -> list[str]:
    """Return what the user of a finished run must know: of the bench, the holds and the meter."""
    return [*getattr(plant, "warnings", ()), *_unsettled(figures), *_slow(figures)]


def _unsettled(figures: dict[str, Any]) -> list[str]:
    """Return a warning if half of the holds or more had not settled."""
    if not figures["points"] or 2 * figures["unsettled"] < figures["points"]:
        return []
    return [
        f"{figures['unsettled']} of {figures['points']} points had not settled and are no "
        "settled outputs; hold longer"
    ]


def _slow(figures: dict[str, Any]) -> list[str]:
    """Return a warning if the meter was slower than the plan."""
    asked, most = figures["sample_interval_s"], figures["longest_interval_s"]
    if most is None or most <= SLOW * asked:
        return []
    return [
        f"the meter was slow at times: samples were up to {most:.3g} s apart, not {asked:g} "
        "s; their times are the true ones"
    ]


def sampling(figures: dict[str, Any]) -> str:
    """Return in words how often the output was read, and how well the times are known.

    Empty where the times are exact, as for a twin, or not known.
    """
    if not figures["time_uncertainty_s"] or figures["median_interval_s"] is None:
        return ""
    return (
        f"read every {figures['median_interval_s']:.3g} s, "
        f"times known to {figures['time_uncertainty_s']:.2g} s"
    )


def summary(store: Store) -> dict[str, Any]:
    """Return the actuator, the specimen and the progress of a store, by name."""
    totals = store.totals()
    return {
        "store": str(store.path),
        "actuator": store.setup.address,
        "specimen": store.setup.specimen,
        "seed": store.setup.seed,
        **store.setup.options,
        "input": store.setup.input,
        "output": store.setup.output,
        "levels": len(store.plan),
        "points": totals["points"],
        "finished": store.finished,
        **{name: totals[name] for name in ("settled", "extrapolated", "unsettled")},
        "held_s": totals["held"],
        "sample_interval_s": store.plan.sample_interval,
        "median_interval_s": totals["median_interval"],
        "longest_interval_s": totals["longest_interval"],
        "time_uncertainty_s": totals["time_uncertainty"],
    }
