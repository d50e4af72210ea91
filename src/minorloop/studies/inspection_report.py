"""The report of the inspection study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.inspection.mesh import vertices_of
from minorloop.report import Picture, Report, Table
from minorloop.studies.claims import claim_table, specimens
from minorloop.studies.drawing import new_figure
from minorloop.studies.inspection import CLAIMS, TITLE
from minorloop.studies.inspection_servo import SETTLED_PX, SWAY_WAIT

if TYPE_CHECKING:
    from minorloop.studies.inspection import InspectionStudy

_BAND = 1.6449


def study_report(
    study: InspectionStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """The page.

    Parameters
    ----------
    study : InspectionStudy
        The first specimen, which is drawn.
    figures : mapping
        Over all specimens.
    runs : sequence of mapping
        The figures of each specimen.
    """
    mission = study.mission
    report = Report(
        TITLE,
        f"Servo, finding, tracking, depth and fusion on {specimens(runs)} with their own pipes; "
        f"figures are drawn for that of seed {study.seed}. {figures['detection']['recall']:.1%} of "
        f"the holes were found with {figures['detection']['false_per_acquisition']:.2f} false "
        f"findings an acquisition, and depths were off by {figures['depth']['bias_um']:.1f} um on "
        "average.",
    )
    report.add(
        "What was found",
        text="Head, camera, pipe and probe are twins: wires of phase, heat and springs, rays that "
        "meet a brushed cylinder between three lights that turn with the head, and pulses through "
        "a lens onto a concave wall. What estimates knows each of them as it would be calibrated, "
        "a little off. Pixels are those of a 320 by 240 image.",
        table=claim_table(CLAIMS, figures),
    )
    report.add(
        "Bringing a point to the middle, and holding it",
        text="The paper's law takes the image Jacobian of a camera at rest; a head that pans turns "
        "about its own axis too, and its lens is carried along in front of the pivot, so that both "
        "columns are added, and the integral has the sign of the proportional term. Against sway "
        "the head is told where its joints should read for the point to be in the middle, foretold "
        "by as much as the wires are late.",
        pictures=[
            Picture(draw_servo(study), "Distance of the true point from the middle of the image.")
        ],
    )
    report.add(
        "Finding holes beside reflections (Fig 14)",
        text="Three lights, one after the other, and one frame without any: a reflection moves "
        "with its light, the edge of a hole does not, and light from behind is there without any.",
        table=_detection_table(figures),
        pictures=[Picture(draw_images(study), "The picked point as first seen, and centred.")]
        if mission.first is not None
        else (),
    )
    report.add(
        "Depths by echoes",
        text="A lens of 8 mm focus, a raster of 36 places, 16 shots at each while the head sways "
        "by a degree, and one fit of all waveforms. Without the lens the beam is as wide as the "
        "disc, and many pits are not heard at all.",
        table=_depth_table(study),
    )
    rows = [(f"{step.t:.0f} s", step.what, step.outcome) for step in mission.log]
    report.add(
        "A mission without a hand",
        text="The six steps of the paper's section 5.2, with the two that it announces.",
        table=Table(("time", "step", "outcome"), rows),
        pictures=[Picture(draw_wall(study), "The finding, unrolled, with its uncertainty, in 3-D.")]
        if mission.wall is not None
        else (),
    )
    return report


def draw_servo(study: InspectionStudy) -> Any:
    """Distances against time: centring, and holding against sway."""
    figure, (left, right) = new_figure(1, 2, height=3.6)
    for name, words in (("sensor", "with angle sensor"), ("camera", "camera only")):
        run = study.runs[name]
        left.plot(run.t, run.off, label=words)
    left.axhline(SETTLED_PX, color="0.3", lw=0.8, ls="--")
    left.set(xlabel="time [s]", ylabel="off the middle [px]", yscale="log")
    for name, words in (("still", "angles held, not looking"), ("swayed", "tracked and held")):
        run = study.runs[name]
        late = run.t > SWAY_WAIT
        right.plot(run.t[late], run.off[late], label=words)
    right.set(xlabel="time [s]", title="sway of 1 degree")
    for axes in (left, right):
        axes.legend(frameon=False)
    return figure


def draw_images(study: InspectionStudy) -> Any:
    """The picked point as it was first seen, and when it had been centred."""
    figure, axes = new_figure(1, 2, height=3.9)
    mission = study.mission
    pictures = ((mission.first, mission.pixel, "picked"), (mission.centred, None, "centred"))
    for one, (image, pixel, title) in zip(axes, pictures, strict=True):
        one.grid(False)
        one.set_axis_off()
        if image is None:
            continue
        one.imshow(image, cmap="gray", vmin=0, vmax=255)
        middle = np.array(image.shape[::-1]) / 2 if pixel is None else pixel
        one.plot(*middle, "s", ms=22, mec="C1", mfc="none", mew=1.4)
        one.set_title(title)
    return figure


def draw_wall(study: InspectionStudy) -> Any:
    """Depth, its standard deviation, and the wall in three dimensions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 3.4), layout="constrained")
    wall = study.mission.wall
    if wall is None:
        return figure
    depth = np.where(np.isfinite(wall.depth), wall.depth, np.nan)
    half = wall.patch.columns * wall.patch.step * 5e2
    extent = (-half, half, -half, half)
    for place, (values, title) in enumerate(((depth, "depth [mm]"), (wall.sd, "deviation [mm]"))):
        axes = figure.add_subplot(1, 3, place + 1)
        shown = axes.imshow(1e3 * values, origin="lower", extent=extent, cmap="viridis")
        figure.colorbar(shown, ax=axes, shrink=0.8)
        axes.set(title=title, xlabel="around [mm]", ylabel="along [mm]")
    solid: Any = figure.add_subplot(1, 3, 3, projection="3d")
    points = vertices_of(wall)
    around = points[..., :2] @ points.reshape(-1, 3)[:, :2].mean(axis=0)
    height = around / np.linalg.norm(points.reshape(-1, 3)[:, :2].mean(axis=0))
    x, y = np.meshgrid(
        np.linspace(-half, half, depth.shape[1]), np.linspace(-half, half, depth.shape[0])
    )
    solid.plot_surface(x, y, 1e3 * (height - height.min()), cmap="viridis_r", linewidth=0)
    solid.set(xlabel="around [mm]", ylabel="along [mm]", zlabel="outwards [mm]")
    solid.view_init(elev=50)
    return figure


def _detection_table(figures: Mapping[str, Any]) -> Table:
    found = figures["detection"]
    low, high = found["recall_interval"]
    rows = [
        (
            "three lights and none",
            f"{found['recall']:.1%} ({low:.1%} to {high:.1%})",
            f"{found['false_per_acquisition']:.3f}",
        )
    ]
    for mode, words in (("single", "one frame"), ("dither", "five turns of 2 degrees")):
        rows.append(
            (
                words,
                f"{found[f'{mode}_recall']:.1%}",
                f"{found[f'{mode}_false_per_acquisition']:.3f}",
            )
        )
    return Table(("acquisition", f"found of {found['scenes']}", "false, an acquisition"), rows)


def _depth_table(study: InspectionStudy) -> Table:
    rows = []
    for kind, scored in [(kind, one) for kind, each in study.scored.items() for one in each]:
        pit, truth = scored.found, scored.sounding.depth
        rows.append(
            (
                kind,
                "through" if np.isinf(truth) else f"{1e3 * truth:.3f}",
                pit.verdict,
                f"{1e3 * pit.depth:.3f}" if np.isfinite(pit.depth) else "-",
                f"{1e6 * _BAND * pit.depth_sd:.1f}" if np.isfinite(pit.depth_sd) else "-",
            )
        )
    return Table(("scene", "true depth, mm", "verdict", "depth, mm", "90 % band, um"), rows)
