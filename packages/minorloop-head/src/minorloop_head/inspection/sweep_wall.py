"""Sweep of a part of the flooded wall by ultrasound: its map, and the defects in it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.errors import OutputError, ParameterError, counted
from minorloop.files import PathLike, write_atomically
from minorloop.lab.signals import ended_by_signals
from minorloop.report import Picture, Report, Table
from minorloop_head.inspection.journal import (
    FINISHED,
    NEW,
    Before,
    EndLine,
    Journal,
    Told,
    folder_for,
    go_on,
    refusing,
    untold,
)
from minorloop_head.inspection.lines import BurstLine, SweepLine, check_burst, check_new
from minorloop_head.inspection.report import Reported, written
from minorloop_head.procedures.sweep import ProbeSweep, SweptArea
from minorloop_head.procedures.sweep_map import draw_pipe_map, find_rows, finds_table, mapped_share
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.reconstruction.findings import save_findings
from minorloop_head.ultrasound.c_scan import CScan, c_scan

if TYPE_CHECKING:
    from minorloop_head.inspection.heads import InspectedHead
    from minorloop_head.ultrasound.wall_echoes import SweptBurst

_CAPTION = (
    "The pipe, unrolled. The colours are the same in every report, so that maps can be compared."
)
_STAGES = {
    "travel": "on the way to",
    "run up": "run-up to",
    "line": "firing",
    "return": "on the way back to",
}


@dataclass(frozen=True, eq=False)
class SweptWall(Reported):
    """Result of a sweep."""

    scan: CScan
    """Map of amplitude and depth, with the finds."""

    @property
    def summary(self) -> str:
        """Sentence on the finds, the number of bursts, and the end of the sweep."""
        return _summary(self.content)


def sweep(
    head: InspectedHead,
    out: PathLike,
    around: Sequence[float],
    along: Sequence[float],
    *,
    resume: bool = False,
    told: Told = untold,
) -> SweptWall:
    """Map a part of the flooded wall by ultrasound, and find pits and cracks in it.

    Each burst is in the journal as soon as it was fired, and an interruption keeps the map of all
    bursts: a note on the exception says so.

    Parameters
    ----------
    head : InspectedHead
        As of `swept_head`.
    out : path
        New or empty folder for journal, findings and report.
    around : (first, last)
        Angles round the pipe in radians, pi / 2 at the bottom.
    along : (first, last)
        Places along the pipe in metres.
    resume : bool
        Whether to continue the interrupted sweep in the folder, from any line of its journal.
    told : callable
        Called with texts on the progress, and ``kept=True`` with texts that matter later.

    Returns
    -------
    SweptWall

    Raises
    ------
    ParameterError
        If the part is too small, too large or not in the pipe, the head does not reach the wall,
        or the sweep in the folder is another one or finished.
    RecordError
        If a line of the journal has an impossible value.
    OutputError
        If the folder is not empty, or cannot be written.
    """
    folder, phi, z = Path(out), (around[0], around[1]), (along[0], along[1])
    own = {name: value for name, value in head.begun.items() if name != "head"}
    degrees = [round(math.degrees(each), 9) for each in phi]
    begun = {**own, "around [deg]": degrees, "along [mm]": [round(1e3 * each, 9) for each in z]}
    before = Before.of(folder, begun, "sweep", SweepLine) if resume else NEW
    bursts = _kept_bursts(before, z)
    with (
        ended_by_signals(exiting=True),
        folder_for(folder, resume=resume),
        head.opened(lambda entry: None) as rig,
    ):
        procedure = ProbeSweep(calibration=rig.calibration)
        area = procedure.area(phi, z, bursts)
        if refused := procedure.point.out_of_reach(rig.control):
            raise ParameterError(f"the sweep is {refused}")
        first, known, stage = area.lines, len(bursts), area.stage
        if before.damaged:
            told(before.set_aside(counted(len(bursts), "burst")), kept=True)
        journal = Journal(folder, begun, before, clock=lambda: rig.t, bursts=len(bursts))
        about = {**begun, "head": head.begun["head"], "began": journal.began}

        def each() -> None:
            nonlocal known, stage
            for burst in area.bursts[known:]:
                journal.note(BurstLine, **BurstLine.values(burst))
            # A short sweep may end before the next text of a log is due.
            begins = area.stage == "line" and stage != "line" and area.lines == first
            known, stage = len(area.bursts), area.stage
            told(progress(area), kept=begins)

        def kept(ended: str) -> SweptWall:
            patch = Patch.ring(*z, radius=rig.calibration.radius)
            scan = c_scan(area.bursts, rig.calibration.probe_at((0.0, 0.0)), patch)
            found = SweptWall(_content(scan, ended, area, about), folder, scan)
            _write(found, phi)
            journal.note(EndLine, why=ended)
            return found

        try:
            try:
                rig.run(procedure.sweep(area), each)
                each()
            finally:
                rig.plant.safe()
            return kept(area.trouble or FINISHED)
        except KeyboardInterrupt as error:
            error.add_note(f"{kept('interrupted').summary}; kept in {folder}")
            raise
        except OutputError as error:
            error.add_note(go_on(folder))
            raise
        finally:
            journal.close()


def _kept_bursts(before: Before, along: tuple[float, float]) -> list[SweptBurst]:
    """Return the bursts of the journal of a sweep."""
    found, traces = [], dict[Any, str]()
    for where, line in before.each(BurstLine):
        with refusing(where):
            check_burst(line, along)
            check_new(traces, ((line.fired, line.spot), line.trace), where)
            found.append(line.restored())
    return found


def progress(area: SweptArea) -> str:
    """Return the stage of a sweep, the share of its area, and the number of bursts, as a text."""
    done = f"{area.progress:.0%} of the area, {counted(len(area.bursts), 'burst')}"
    return f"{_STAGES[area.stage]} line {area.lines + 1}: {done}"


def _content(found: CScan, ended: str, area: SweptArea, about: dict[str, Any]) -> dict[str, Any]:
    """Return the content of ``findings.json``."""
    water = found.water
    return {
        **about,
        "ended": ended,
        "bursts": len(area.bursts),
        "lines": area.lines,
        "mapped": round(mapped_share(found, area.phi), 3),
        "water line below the axis [mm]": [round(1e3 * v, 2) for v in (water.height, water.sd)]
        if water.seen
        else None,
        "water level": water.words,
        "findings": find_rows(found),
    }


def _write(found: SweptWall, around: tuple[float, float]) -> None:
    """Write findings and report."""
    rows = [one.finding(found.scan.wall.patch.radius) for one in found.scan.finds]
    save_findings(rows, found.folder / "findings.csv", force=True)
    write_atomically(found.folder / "findings.json", json.dumps(found.content, indent=1) + "\n")
    written(lambda: _sweep_report(found, around), found.report)


def _sweep_report(found: SweptWall, around: tuple[float, float]) -> Report:
    """Return the report of a sweep between two angles in radians."""
    content = found.content
    facts = {
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
    report = Report("Sweep of the flooded wall", found.summary)
    report.add("Finds", table=finds_table(found.scan))
    swept = Table(("", ""), [[name, str(value)] for name, value in facts.items()])
    report.add("What was swept", table=swept)
    report.add("Map", pictures=[Picture(draw_pipe_map(found.scan, around), _CAPTION)])
    return report


def _summary(content: dict[str, Any]) -> str:
    finds, bursts = counted(len(content["findings"]), "find"), counted(content["bursts"], "burst")
    found = f"{finds} in {bursts} on {counted(content['lines'], 'line')}"
    if content["bursts"] and not content["mapped"]:
        found += "; no echo of the wall, so that nothing is mapped; sweep below the water"
    elif content["bursts"]:
        found += f"; {content['mapped']:.0%} of the wall mapped"
    return f"{found}; {content['ended']}"
