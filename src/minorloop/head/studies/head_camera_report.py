"""The part of the head's report on its camera alone: Figs 10 and 11 in the form of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minorloop.head.control.by_camera import AGE
from minorloop.head.studies.head_camera import LAWS, RADIUS, STEPS, CameraStudy
from minorloop.head.studies.head_loop import HeadRun
from minorloop.head.studies.picture_sensor import DROPPED
from minorloop.report import Picture, Report, Table
from minorloop.studies.drawing import new_figure


def add_camera(
    report: Report, study: CameraStudy, sensed: Mapping[tuple[str, str], HeadRun]
) -> None:
    """Add the section on the camera alone.

    Parameters
    ----------
    report : Report
    study : CameraStudy
        Of the specimen that is drawn.
    sensed : mapping of (what, controller) to HeadRun
        The same steps with sensors at the joints, to compare with.
    """
    figures = study.figures()
    low, high = (2e3 * RADIUS, 20.0)
    report.add(
        "Figs 10 and 11: the camera alone",
        text=(
            "The head of the paper has no sensor at its joints: the camera is its only feedback. "
            "Here both wires are identified, and both axes are controlled, by the angles at which "
            "patches of the wall agree with the pictures. 25 pictures a second, their angles used "
            f"{AGE} frames later, {100 * DROPPED:.0f} % of them lost; lens, mount and pipe are "
            "known with the errors that a calibration leaves. Scores use the true angles.",
            f"A picture gives the angles within {figures['reading_rms_deg']:.2f} degrees rms while "
            f"the head moves; {figures['pictures_missed_pct']:.1f} % give none. The model that was "
            "identified from pictures predicts random holds within "
            f"{figures['static_rms_deg']:.2f} degrees rms.",
            f"The circle of the paper is 20 to 25 mm across. Inside a pipe of {high:.0f} mm it is "
            f"{low:.0f} mm: a larger one is out of reach. It is drawn on the unrolled wall about a "
            "hole that was picked in the first picture; the path is known, so that the target is "
            "ahead of it by the response of the law.",
        ),
        table=_laws(study, sensed),
        pictures=[
            Picture(draw_steps(study), "Fig 10, by the camera alone: steps of one axis."),
            Picture(
                draw_wall_circles(study),
                "Fig 11, by the camera alone: where the optical axis meets the wall.",
            ),
        ],
    )


def _laws(study: CameraStudy, sensed: Mapping[tuple[str, str], HeadRun]) -> Table:
    """Return the step of 40 degrees by every law, on pictures and on sensors at the joints."""
    rows = []
    for name in LAWS:
        pair = study.steps.get((name, STEPS[-1])), sensed.get((f"step {STEPS[-1]:g}", name))
        for how, run in zip(("camera", "joint sensors"), pair, strict=True):
            if run is not None:
                numbers = (run.settle, run.overshoot, run.steady)
                rows.append((name.replace("_", " "), how, *(f"{x:.2f}" for x in numbers)))
    columns = ("controller", "sensor", "settling, s", "overshoot, %", "steady rms, deg")
    return Table(columns, rows)


def draw_steps(study: CameraStudy) -> Any:
    """Draw Fig 10: the angle against time, one curve for each target."""
    figure, axes = new_figure()
    for target in STEPS:
        run = study.steps.get((LAWS[0], target))
        if run is not None:
            (line,) = axes.plot(run.t, run.truth.angle[:, 0], label=f"{target:g} degrees")
            axes.axhline(target, color=line.get_color(), linewidth=0.6, linestyle=":")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("angle (deg)")
    axes.legend()
    return figure


def draw_wall_circles(study: CameraStudy) -> Any:
    """Draw Fig 11: the circle on the unrolled wall, in millimetres."""
    figure, axes = new_figure()
    for period, circle in study.circles.items():
        axes.plot(*circle.reached.T, label=f"in {period:g} s, {circle.rms:.2f} mm rms")
    for circle in list(study.circles.values())[:1]:
        axes.plot(*circle.wanted.T, "k:", label="wanted")
    axes.plot(0.0, 0.0, "k+", label="hole")
    axes.set_xlabel("X [mm]")
    axes.set_ylabel("Y [mm]")
    axes.set_aspect("equal")
    axes.legend()
    return figure
