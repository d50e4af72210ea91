"""What ``minorloop head sweep`` does: a map of the flooded wall, and what is found in it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError, counted
from minorloop_head.cli._journal import FINISHED, NAME, Journal, Resumed
from minorloop_head.cli._sweep_journal import burst_line, kept_bursts
from minorloop_head.cli._water import GivenFilling

if TYPE_CHECKING:
    from minorloop_head.procedures.sweep import SweepState
    from minorloop_head.ultrasound.c_scan import CScan

_CAPTION = (
    "The pipe, unrolled. The colours are the same in every report, so that maps can be compared."
)


def carried_out(
    actuator: str,
    around: Sequence[float],
    along: Sequence[float],
    out: Path,
    specimen: int | None,
    seed: int,
    water: GivenFilling,
    *,
    resume: bool = False,
) -> dict[str, Any]:
    """Sweep a part of the wall, and return the content of ``findings.json``.

    Each burst is in the journal as soon as it was fired, and the map of all of them is kept after
    an interruption.

    Parameters
    ----------
    actuator : str
        Address; only the simulated pipe has a probe.
    around, along : (first, last)
        In degrees and mm.
    out : path
        New or empty folder.
    specimen, seed : int
        Of the simulated head, and of its noise and its pipe.
    water : GivenFilling
        What fills the pipe.
    resume : bool
        Whether to go on with the sweep in the folder, which was cut off.
    """
    from contextlib import nullcontext

    from minorloop.files import new_folder
    from minorloop.lab.signals import ended_by_signals
    from minorloop_head.console.identified_head import head_of
    from minorloop_head.console.plant import open_plant, open_tip
    from minorloop_head.console.settings import PIPE, is_pipe
    from minorloop_head.procedures.rig import InspectionRig
    from minorloop_head.procedures.sweep import ProbeSweep
    from minorloop_head.reconstruction.depth_map import Patch
    from minorloop_head.twins.head import Head
    from minorloop_head.ultrasound.c_scan import c_scan

    if not is_pipe(actuator):
        raise ParameterError(
            f"the actuator {actuator} is not a head with an ultrasonic probe; give {PIPE}, the "
            "only address that has one"
        )
    phi = math.radians(around[0]), math.radians(around[1])
    z = 1e-3 * along[0], 1e-3 * along[1]
    begun = {
        "actuator": actuator,
        "specimen": specimen,
        "seed": seed,
        "around [deg]": list(around),
        "along [mm]": list(along),
        **water.noted(),
    }
    filling = water.filling()
    if filling.level is None:
        raise ParameterError("a dry pipe cannot be swept; give --water a height, or leave it out")
    before = Resumed.of(out, begun, "sweep") if resume else Resumed()
    bursts = kept_bursts(out / NAME, before.lines, z)
    opened = nullcontext(out) if resume else new_folder(out)
    working = _common.working("identifying the head", logged=True)
    with ended_by_signals(exiting=True), opened as folder, working as now:
        plant = open_plant(actuator, specimen=specimen, seed=seed, water=filling)
        flow = getattr(plant, "flood", None)
        tip, view = open_tip(actuator, specimen=specimen, seed=seed, flow=flow, water=filling)
        control = head_of(actuator, specimen)
        rig, sweep = InspectionRig(plant, tip, control, view), ProbeSweep(calibration=view)
        state = sweep.begin(phi, z, control=control, bursts=bursts)
        if state.refused:
            raise ParameterError(f"the sweep is {state.refused}")
        first = state.lines
        if before.damaged:
            now(before.set_aside(folder, counted(len(bursts), "burst")), kept=True)
        journal = Journal(folder, begun, before.lines, bursts=len(bursts))

        def told(new: SweepState) -> None:
            nonlocal state
            for burst in new.bursts[len(state.bursts) :]:
                journal.note("burst", **burst_line(burst))
            # A short sweep ends before the next text of a log is due.
            begins = new.stage == "line" and state.stage != "line" and new.lines == first
            state = new
            now(progress(new), kept=begins)

        def kept(ended: str) -> dict[str, Any]:
            patch = Patch.ring(*z, radius=view.radius)
            scan = c_scan(state.bursts, view.probe_at((0.0, 0.0)), patch)
            about = {**begun, "head": Head(specimen).serial, "began": journal.began}
            content = _kept(scan, ended, state, folder, phi, about)
            journal.note("end", why=ended)
            return content

        try:
            try:
                told(rig.run(sweep, state, told))
            finally:
                plant.safe()
            return kept(state.trouble or FINISHED)
        except KeyboardInterrupt:
            typer.echo(f"{summary(kept('interrupted'))}; kept in {out}", err=True)
            raise
        except OutputError:
            typer.echo(_common.go_on(folder), err=True)
            raise
        finally:
            journal.close()


def progress(state: SweepState) -> str:
    """Return what a sweep does now, and how much of its area and how many bursts are fired."""
    words = {
        "travel": "on the way to",
        "run up": "run-up to",
        "line": "firing",
        "return": "on the way back to",
    }
    done = f"{state.progress:.0%} of the area, {counted(len(state.bursts), 'burst')}"
    return f"{words[state.stage]} line {state.lines + 1}: {done}"


def _kept(
    found: CScan,
    ended: str,
    state: SweepState,
    folder: Path,
    around: tuple[float, float],
    about: dict[str, Any],
) -> dict[str, Any]:
    """Write findings and report, and return the content of ``findings.json``."""
    from minorloop.files import write_atomically
    from minorloop.report import Picture, Report, Table
    from minorloop_head.procedures.sweep_map import (
        draw_pipe_map,
        find_rows,
        finds_table,
        mapped_share,
    )
    from minorloop_head.reconstruction.findings import save_findings

    rows = [one.finding(found.wall.patch.radius) for one in found.finds]
    water = found.water
    content = {
        **about,
        "ended": ended,
        "bursts": len(state.bursts),
        "lines": state.lines,
        "mapped": round(mapped_share(found, around), 3),
        "water line below the axis [mm]": [round(1e3 * v, 2) for v in (water.height, water.sd)]
        if water.seen
        else None,
        "water level": water.words,
        "findings": find_rows(found),
    }
    save_findings(rows, folder / "findings.csv", force=True)
    write_atomically(folder / "findings.json", json.dumps(content, indent=1) + "\n")

    def drawn() -> Report:
        report = Report("Sweep of the flooded wall", summary(content))
        report.add("Finds", table=finds_table(found))
        report.add("What was swept", table=Table(("", ""), _facts(content)))
        drawing = draw_pipe_map(found, around)
        report.add("Map", pictures=[Picture(drawing, _CAPTION)])
        return report

    _common.write_report(drawn, folder / "report.html", force=True)
    return content


def _facts(content: dict[str, Any]) -> list[list[str]]:
    """Return what was swept, by what, and when, as rows of a table."""
    known = {
        "began": content["began"],
        "ended": content["ended"],
        "head": content["head"],
        "at": content["actuator"],
        "around the pipe": "{:g} to {:g} degrees".format(*content["around [deg]"]),
        "along the pipe": "{:g} to {:g} mm".format(*content["along [mm]"]),
        "water above the axis, as given": content["water [mm above the axis]"],
        "level of the water, by echoes": content["water level"],
        "temperature of the water": f"{content['water [C]']:g} C",
        "gas": f"{content['gas']}, {content['gas [bar]']:g} bar",
    }
    return [[name, str(value)] for name, value in known.items()]


def summary(content: dict[str, Any]) -> str:
    """Return what was found in how many bursts, and how it ended."""
    finds, bursts = counted(len(content["findings"]), "find"), counted(content["bursts"], "burst")
    found = f"{finds} in {bursts} on {counted(content['lines'], 'line')}"
    if content["bursts"] and not content["mapped"]:
        found += "; no echo of the wall, so that nothing is mapped; sweep below the water"
    elif content["bursts"]:
        found += f"; {content['mapped']:.0%} of the wall mapped"
    return f"{found}; {content['ended']}"


def show(content: dict[str, Any], out: Path) -> None:
    """Print the finds."""
    rows = content["findings"]
    if rows:
        cells = [["-" if each is None else str(each) for each in row.values()] for row in rows]
        _common.print_table(list(rows[0]), cells)
    typer.echo(summary(content))
    typer.echo(f"kept in {out}")
