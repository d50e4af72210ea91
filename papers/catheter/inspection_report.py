"""The report of the inspection study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Picture, Report, Table
from minorloop_head.procedures.finding_map import draw_finding
from minorloop_head.procedures.sweep_map import draw_pipe_map, finds_table
from minorloop_head.reconstruction.findings import finding_of
from minorloop_head.ultrasound.crack_depth import MEASURED
from papers.catheter.crack_report import crack_pictures, crack_table, crack_words
from papers.catheter.detection_report import detection_pictures, detection_table, limits
from papers.catheter.inspection import CLAIMS, TITLE
from papers.catheter.inspection_servo import SETTLED_PX, SWAY_WAIT
from papers.catheter.judged import JUDGE, judge_words
from papers.catheter.mission import Mission
from papers.catheter.mission_report import (
    draw_crack,
    draw_depths,
    draw_images,
    draw_ring,
    finding_rows,
    place_words,
    save_mission,
)
from papers.claims import claim_table, specimens
from papers.drawing import new_figure

_NARROW = "The floor of a narrow crack reflects too little of a beam to be measured."
_LOOKED = "The camera sees the surface of a defect but gives no depth there."

if TYPE_CHECKING:
    from papers.catheter.inspection import InspectionStudy


def study_report(
    study: InspectionStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """Return the report.

    Parameters
    ----------
    study : InspectionStudy
        The first specimen, which is drawn.
    figures : mapping
        Over all specimens.
    runs : sequence of mapping
        The figures of each specimen.
    """
    report = Report(TITLE, _summary(study.seed, figures, runs))
    report.add(
        "What was found",
        text="Head, camera, pipe and probe are twins: wires of phase, heat and springs, rays that "
        "meet a brushed cylinder between three lights that turn with the head, and pulses through "
        "a lens onto a concave wall. Estimators use their calibration, which has small errors. "
        "Pixels are those of a 320 by 240 image.",
        table=claim_table(CLAIMS, figures),
    )
    _add_servo(report, study, figures["sway"])
    _add_detection(report, study.mission, figures["detection"], runs)
    report.add(
        "Finding cracks beside scratches, drawing marks, welds and stains",
        text=crack_words(figures["cracks"]),
        table=crack_table(figures["cracks"]),
        pictures=crack_pictures([one for run in runs for one in run["cracks"]]),
    )
    report.add(
        "Depths by echoes",
        text="A lens of 8 mm focus, a raster of 36 places, 16 shots at each while the head sways "
        "by a degree, and one fit of all waveforms. Without the lens the beam is as wide as the "
        "disc: where another depth explains the echoes nearly as well, none is given.",
        table=_depth_table(study),
        pictures=[Picture(draw_depths(runs), "Depths of all specimens, less the true ones.")],
    )
    _add_mission(report, study.mission)
    fused = study.sweep.fused
    drawn = draw_pipe_map(fused, picture=fused.picture)
    report.add(
        "A sweep of a partly flooded pipe",
        text="The catheter rolls while the probe fires, line after line, and no camera is used. A "
        "step between neighbouring echoes that is steeper than a smooth wall can be is the edge of "
        "a pit. The camera sees the drained wall. Between the water line and the height at which "
        "the probe gets under water there are neither pictures nor echoes.",
        table=finds_table(fused),
        pictures=[Picture(drawn, "One map of the pipe, unrolled.")],
    )
    return report


def _summary(seed: int, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]) -> str:
    """Return the first paragraph."""
    many, found, missions = len(runs) > 1, figures["detection"], figures["mission"]
    of = missions["of"]
    measured, cracks = (round(missions[key] * of) for key in ("measured", "cracks_found"))
    return (
        f"Servo, finding, tracking, depth and fusion on {specimens(runs)} "
        f"with {'pipes of their own' if many else 'a pipe of its own'}; figures are drawn "
        f"for {'that of ' if many else ''}seed {seed}. "
        f"{found['recall']:.1%} of the holes were found with "
        f"{found['false_per_acquisition']:.2f} false findings an acquisition (on scenes of another "
        f"renderer, by make judge, {JUDGE['recall']:.1%} with "
        f"{JUDGE['false_per_acquisition']:.2f}), depths were off by "
        f"{figures['depth']['bias_um']:.1f} um on average, and in {measured} of {of} "
        f"mission{'s' if of > 1 else ''} the pit was measured, in {cracks} the crack found."
    )


def _add_servo(report: Report, study: InspectionStudy, sway: Mapping[str, float]) -> None:
    report.add(
        "Bringing a point to the middle, and holding it",
        text="The paper's law takes the image Jacobian of a camera at rest; a head that pans turns "
        "about its own axis too, and its lens is carried along in front of the pivot, so that both "
        "columns are added. The wanted angles are those that put the point in the middle, "
        "predicted by the delay of the wires, and an integral of the error. Motion that is too "
        "fast for the wires is removed by shifting the image to the tracked point: "
        f"{sway.get('stabilised_ratio', np.nan):.2f} of the sway of a still head "
        f"remains, {sway['ratio']:.2f} without the shift. By the camera alone, no reading of a "
        "joint is used: the model of the wires brings the head near, and then control uses the "
        "angles that follow from the tracked patch.",
        pictures=[
            Picture(draw_servo(study), "Distance of the true point from the middle of the image.")
        ],
    )


def _add_detection(
    report: Report, mission: Mission, found: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> None:
    outcomes = [outcome for run in runs for outcome in run["outcomes"]]
    pictures = detection_pictures(outcomes)
    if mission.first is not None:
        words = "Fig 14 redrawn: the picked point as first seen, and with the axis sent to it."
        pictures.append(Picture(draw_images(mission), words))
    report.add(
        "Finding holes beside reflections (Fig 14)",
        text=(
            "Three lights, one after the other, and one frame without any: a reflection moves with "
            "its light, the edge of a hole does not, and light from behind is there without any. "
            "Where nothing is near, nine tenths of the outline of a dark hole are within "
            f"{found['plain_edge_px_p90']:.2f} pixels of its edge.",
            limits(outcomes),
            judge_words(),
        ),
        table=detection_table(found),
        pictures=pictures,
    )


def _add_mission(report: Report, mission: Mission) -> None:
    """Add the steps of a mission, its pit, its cracks, and the map once round the pipe."""
    rows = [
        (f"{step.t:.0f} s", step.what, step.outcome, "" if step.succeeded else "failed")
        for step in mission.log
    ]
    report.add(
        "A mission without an operator",
        text="Before the mission, a check whether the head can point the probe in the water. Then "
        "the six steps of the paper's section 5.2, and the two steps that the paper announces. "
        "At the end the mission visits the lines that it saw on the way.",
        table=Table(("time", "step", "outcome", ""), rows),
    )
    if mission.wall is None or mission.pit is None:
        report.add("No pit", text=nothing_found(mission))
    else:
        words = f"The pit, unrolled and in 3-D. {_LOOKED}"
        report.add(
            "The pit",
            text="The outline is that of the image and of the echoes together, the depth that of "
            "the joint fit spread by the footprints of the beams; the rim is the least sure. "
            f"{place_words(mission)}",
            table=finding_rows(mission.finding or finding_of(mission.pit)),
            pictures=[Picture(draw_finding(mission.wall), words)],
        )
    _add_cracks(report, mission)
    if mission.ring is not None:
        words = "The pit is circled; a crack is drawn as traced."
        report.add(
            "Once round the pipe",
            text="What is under water has a profile by echoes, and what the camera saw in the "
            "drained pipe lies on its cylinder. The dashed line is the water, as found.",
            pictures=[Picture(draw_ring(mission), words)],
        )


def _add_cracks(report: Report, mission: Mission) -> None:
    """Add a section for each crack, or the reason why there is none."""
    if not mission.cracks:
        words = "No line was seen again in a near view, so that no crack is reported."
        report.add("No crack", text=words)
    for crack in mission.cracks:
        traced = (
            "The crack and its course (orange), drawn at the measured angles: their errors "
            "separate the two."
        )
        around = f"The wall about it, unrolled and in 3-D. {_LOOKED}"
        report.add(
            "A crack",
            text="Dark under every light, thin, and seen again in a near view. Verdict of the "
            f"echoes on its depth where it is widest: {crack.finding.verdict}. Its width is the "
            "median along the near view; the widest place is the circle."
            + ("" if crack.finding.verdict == MEASURED else f" {_NARROW}"),
            table=finding_rows(crack.finding),
            pictures=[
                Picture(draw_crack(crack), traced),
                Picture(draw_finding(crack.wall), around),
            ],
        )


def save_beside(study: InspectionStudy, folder: Path) -> list[Path]:
    """Write the findings of the first specimen's mission beside the report: table, PLY and glTF."""
    return save_mission(study.mission, folder)


def nothing_found(mission: Mission) -> str:
    """Return a sentence on why a mission has no pit."""
    why = "nothing round was seen" if mission.pit is None else f"verdict: {mission.pit.verdict}"
    return (
        f"The mission of seed {mission.seed} ended without the depth of a pit ({why}); no mesh of "
        "one is written."
    )


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


def _depth_table(study: InspectionStudy) -> Table:
    rows = []
    for kind, scored in ((kind, one) for kind, each in study.scored.items() for one in each):
        pit, truth = scored.found, scored.site.depth
        true = "through" if np.isinf(truth) else f"{1e3 * truth:.3f}"
        depth = f"{1e3 * pit.depth:.3f}" if np.isfinite(pit.depth) else "-"
        sd = pit.depth_sd
        band = f"{1e6 * PER_DEVIATION * sd:.1f}" if np.isfinite(sd) else "-"
        rows.append((kind, true, pit.verdict, depth, band))
    return Table(("scene", "true depth, mm", "verdict", "depth, mm", "90 % band, um"), rows)
