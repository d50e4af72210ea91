"""Runs of sines: begun by ``run``, continued by ``resume``."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from minorloop.cli import _common
from minorloop.cli._run_progress import watching
from minorloop.errors import InstrumentError
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.store import Setup, Store


def begin(plant: Actuator, file: str, store: Path, setup: Setup, as_json: bool) -> None:
    """Carry out a plan of sines on the actuator of a setup, in a new store.

    Raises a `ParameterError` if the actuator cannot carry out the plan; a `SignalError` if no
    frequency has a sine at every amplitude, so that the run could not be evaluated; a `LimitError`
    if an input is beyond the limits.
    """
    from minorloop.identification.sine_response import at_every_amplitude
    from minorloop.lab.sine_run import check_sines, sine_design
    from minorloop.lab.sines import SinePlan
    from minorloop.lab.store import Store

    plan = SinePlan.from_csv(file)
    left = at_every_amplitude([s.frequency for s in plan], [s.amplitude for s in plan])[1]
    check_sines(plant, plan)
    if left:
        typer.echo(f"note: when this run is evaluated, {left}", err=True)
    known = replace(setup, design=sine_design(plan, plant))
    with Store.create(store, plan.holds(), known) as opened:
        carry_out(plant, opened, as_json)


def carry_out(plant: Actuator, store: Store, as_json: bool) -> None:
    """Carry out the rest of the sines of a store, and print how many there are."""
    from minorloop.lab.sine_run import planned_sines, run_sines

    unit = store.outputs[0].unit
    what = [
        f"{sine.frequency:.6g} Hz, {sine.amplitude:.6g} {unit}"
        for sine in planned_sines(store).sines
    ]
    try:
        with watching(store, what) as watch:
            mode = run_sines(plant, store, watch=watch)
    except InstrumentError as error:
        raise type(error)(
            f"{error}; {len(store)} of {len(store.plan)} sines are kept; continue with minorloop "
            f"resume --store {shlex.quote(str(store.path))}"
        ) from None
    totals = store.totals()
    count, held = totals["points"], totals["held"]
    if as_json:
        about = {"store": str(store.path), "actuator": store.setup.address}
        counts = {"sines": count, "planned": len(store.plan), "finished": store.finished}
        _common.print_json({**about, **counts, "held_s": held, "mode": mode})
        return
    if mode == "finished":
        typer.echo("this run was finished already; nothing was applied")
    typer.echo(f"{count} of {len(store.plan)} sines measured, {as_duration(held)} in all")
    typer.echo(f"kept in {store.path}; next: minorloop frequency {store.path}")


def is_sines(setup: Setup) -> bool:
    """Whether the store of a run has sines."""
    return "sines" in (setup.design or {})
