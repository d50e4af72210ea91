"""The report of the inspection study: what its template names, its tables and the servo."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop_head.procedures.sweep_map import draw_pipe_map
from minorloop_head.reconstruction.findings import finding_of
from minorloop_head.ultrasound.crack_depth import MEASURED
from papers.catheter.detection_report import limits, verdict_words
from papers.catheter.inspection import InspectionStudy, gather, run_study
from papers.catheter.inspection_servo import SETTLED_PX, SWAY_WAIT
from papers.catheter.judged import JUDGE, judge_words
from papers.catheter.mission import Mission
from papers.catheter.mission_cracks import SeenCrack
from papers.catheter.mission_report import place_words, save_mission
from papers.catheter.pipe_map import PipeMap
from papers.catheter.scan_trials import ScoredScan
from papers.drawing import new_figure
from papers.harness import Study


def names(
    study: InspectionStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return what the template names beside figures."""
    many, missions, mission = len(runs) > 1, figures["mission"], study.mission
    cracks = [one for run in runs for one in run["cracks"]]
    finding = mission.finding or (mission.pit and finding_of(mission.pit))
    return {
        "own_pipes": "pipes of their own" if many else "a pipe of its own",
        "drawn": f"{'that of ' if many else ''}seed {study.seed}",
        "measured": round(missions["measured"] * missions["of"]),
        "cracked": round(missions["cracks_found"] * missions["of"]),
        "missions": f"mission{'s' if missions['of'] > 1 else ''}",
        "JUDGE": JUDGE,
        "judge_words": judge_words,
        "limits": limits,
        "place_words": place_words,
        "verdict_words": verdict_words,
        "outcomes": [outcome for run in runs for outcome in run["outcomes"]],
        "missed_cracks": [one for one in cracks if one.width > 0 and not one.found],
        "false_cracks": [one for one in cracks if one.false],
        "pits": [{"finding": finding, "wall": mission.wall}] if _has_pit(mission) else [],
        "rings": [] if mission.ring is None else [mission.ring],
    }


def _has_pit(mission: Mission) -> bool:
    return mission.wall is not None and mission.pit is not None


def without_pit(mission: Mission) -> str:
    """Return why a mission has no pit; nothing if it has one."""
    return "" if _has_pit(mission) else nothing_found(mission)


def without_crack(mission: Mission) -> str:
    """Return why a mission has no crack; nothing if it has one."""
    why = "No line was seen again in a near view, so that no crack is reported."
    return "" if mission.cracks else why


def narrow_words(crack: SeenCrack) -> str:
    """Return why a crack has no depth; nothing if it has one."""
    why = " The floor of a narrow crack reflects too little of a beam to be measured."
    return "" if crack.finding.verdict == MEASURED else why


def save_beside(study: InspectionStudy, folder: Path) -> list[str]:
    """Write the findings of the first specimen's mission beside the report: table, PLY and glTF."""
    written = save_mission(study.mission, folder)
    if not written:
        print(nothing_found(study.mission), file=sys.stderr)
    return [f"written: {path}" for path in written]


def nothing_found(mission: Mission) -> str:
    """Return a sentence on why a mission has no pit."""
    why = "nothing round was seen" if mission.pit is None else f"verdict: {mission.pit.verdict}"
    return (
        f"The mission of seed {mission.seed} ended without the depth of a pit ({why}); no mesh of "
        "one is written."
    )


def draw_swept(fused: PipeMap) -> Any:
    """Draw the map of a sweep with the pictures of the drained part."""
    return draw_pipe_map(fused, picture=fused.picture)


def log_table(mission: Mission) -> Table:
    """Return the steps of a mission."""
    rows = [
        (f"{step.t:.0f} s", step.what, step.outcome, "" if step.succeeded else "failed")
        for step in mission.log
    ]
    return Table(("time", "step", "outcome", ""), rows)


def depth_table(scored: Mapping[str, Sequence[ScoredScan]]) -> Table:
    """Return the depths of all scans beside the true ones."""
    rows = []
    for kind, scan in ((kind, one) for kind, each in scored.items() for one in each):
        pit, truth = scan.found, scan.site.depth
        true = "through" if np.isinf(truth) else f"{1e3 * truth:.3f}"
        depth = f"{1e3 * pit.depth:.3f}" if np.isfinite(pit.depth) else "-"
        sd = pit.depth_sd
        band = f"{1e6 * PER_DEVIATION * sd:.1f}" if np.isfinite(sd) else "-"
        rows.append((kind, true, pit.verdict, depth, band))
    return Table(("scene", "true depth, mm", "verdict", "depth, mm", "90 % band, um"), rows)


def draw_servo(study: InspectionStudy) -> Any:
    """Draw distances against time: centring, and holding against sway."""
    figure, (left, right) = new_figure(1, 2, height=3.6)
    for name, words in (("sensor", "with angle sensor"), ("camera", "camera only")):
        run = study.runs[name]
        left.plot(run.t, run.off, label=words)
    left.axhline(SETTLED_PX, color="0.3", lw=0.8, ls="--")
    left.set(xlabel="time [s]", ylabel="off the middle [px]", yscale="log")
    still, swayed = study.runs["still"], study.runs["swayed"]
    late = swayed.t > SWAY_WAIT
    right.plot(still.t, still.off, label="constant angles, without camera")
    right.plot(swayed.t[late] - SWAY_WAIT, swayed.off[late], label="tracked and held")
    if swayed.left is not None:
        right.plot(swayed.t[late] - SWAY_WAIT, swayed.left[late], label="and the picture shifted")
    right.set(xlabel="time [s]", ylabel="off the middle [px]", title="sway of 1 degree")
    right.set_ylim(0.0, 1.5 * float(max(still.off.max(), swayed.off[late].max(initial=0.0))))
    left.legend(frameon=False)
    right.legend(frameon=False, loc="upper right")
    return figure


STUDY = Study(
    "inspection",
    "In-pipe inspection with a catheter head",
    run_study,
    gather,
    {
        "missions": "papers.catheter.missions",
        "scans": "papers.catheter.scans",
        "sweeps": "papers.catheter.sweep_trials",
    },
    page=__name__,
    beside=save_beside,
)
