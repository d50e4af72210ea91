"""The part of the head's report on its camera alone: Figs 10 and 11 in the form of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from minorloop.report import Picture, Report, Table
from minorloop_head.control.by_camera import AGE
from minorloop_head.twins.pipe import Pipe
from papers.catheter.head_camera import CIRCLES, LAWS, STEPS, CameraStudy
from papers.catheter.head_loop import STEADY, HeadRun, step_figures
from papers.catheter.head_rivals_report import STEP, WORDS, where_better
from papers.catheter.picture_sensor import DROPPED
from papers.drawing import new_figure


def add_camera(
    report: Report,
    study: CameraStudy,
    over_all: Mapping[str, Any],
    sensed: Mapping[tuple[str, str], HeadRun],
    seed: int,
) -> None:
    """Add the sections on the camera alone.

    Parameters
    ----------
    report : Report
    study : CameraStudy
        Of the specimen that is drawn.
    over_all : mapping
        Figures over all specimens.
    sensed : mapping of (what, controller) to HeadRun
        The same steps with sensors at the joints, to compare with.
    seed : int
        Of the specimen that is drawn, for captions.
    """
    figures = over_all["camera"]
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
            "The table is of the specimen that is drawn. Of several steps it gives the worst, as "
            "the rows of the first table do, which are medians over all specimens.",
            f"Steady rms is of the last {STEADY:.0f} s of a run. Runs by the camera last "
            f"{_end(study):.0f} s, those with joint sensors longer, so the last column has the "
            "same seconds of both. PI, alone or with the inverse, needs most of a run to settle: "
            "its steady rms by the camera still has the end of the approach, as it has with joint "
            "sensors in the same seconds. Given time, PI turns until the readings agree with the "
            "target, so that the error of the calibration is left by the camera. Adaptive has the "
            "options of joint sensors: with those of the observer by the camera, each change of "
            "its operator would move the angle about the target.",
            "What follows is of the camera alone and the step of "
            f"{_targets(study)[-1]:g} degrees. "
            f"{where_better(STEP, _highest_steps(study), LAWS[0])}",
        ),
        table=_laws(study, sensed),
        pictures=[
            Picture(draw_steps(study), f"Fig 10, by the camera alone: steps of pan. Seed {seed}.")
        ],
    )
    _add_circle(report, study, seed)


def _add_circle(report: Report, study: CameraStudy, seed: int) -> None:
    """Add Fig 11."""
    report.add(
        "Fig 11: circles on the wall",
        text="Circles on the unrolled wall of a pipe of "
        f"{2e3 * Pipe.radius:.0f} mm, about a hole that was picked in the first picture. The path "
        "is known, so that the target is ahead of it by the response of the law. The circle of "
        "the paper is 20 to 25 mm across. One of 20 mm is within reach about a hole 32 mm along "
        "the pipe from the pivot of the head. About a nearer one it is not: a wire pulls in one "
        "direction only, and within some degrees of its cold end it returns too slowly to follow. "
        "Far along the pipe the line of sight meets the wall at a flat angle, so that the same "
        "error of an angle is a larger distance there: 0.33 mm for 0.1 degrees at the far end of "
        "that circle, and 0.14 mm on that of 8 mm about a hole 22 mm along the pipe.",
        pictures=[
            Picture(
                draw_wall_circles(study),
                "Fig 11, by the camera alone: where the optical axis meets the wall, X around the "
                f"pipe and Y along it, from the hole. Seed {seed}.",
            ),
        ],
    )


def _targets(study: CameraStudy) -> tuple[float, ...]:
    """Return the steps in degrees, the highest last."""
    return tuple(sorted({target for _, target in study.steps}))


def _highest_steps(study: CameraStudy) -> dict[str, dict[str, float]]:
    """Return the figures of the highest step by the camera alone, of each law."""
    highest = _targets(study)[-1]
    return {name: step_figures([run]) for (name, to), run in study.steps.items() if to == highest}


def _laws(study: CameraStudy, sensed: Mapping[tuple[str, str], HeadRun]) -> Table:
    """Return the steps by every law, on pictures and on sensors at the joints."""
    steps, end = _targets(study), _end(study)
    found = {("camera", *key): run for key, run in study.steps.items()}
    for name, target in product(LAWS, steps):
        if (f"step {target:g}", name) in sensed:
            found["joint sensors", name, target] = sensed[f"step {target:g}", name]
    rows = []
    several = dict.fromkeys((steps, steps[-1:]))
    for targets, name, how in product(several, LAWS, ("camera", "joint sensors")):
        own = [found.get((how, name, target)) for target in targets]
        runs = [run for run in own if run is not None]
        if len(runs) == len(targets) and (name, targets[0]) in study.steps:
            of = step_figures(runs)
            which = ", ".join(f"{target:g}" for target in targets)
            late = max(_late(run, end) for run in runs)
            cells = (*(each.text(of) for each in STEP), f"{late:.2f}")
            rows.append((WORDS[name], how, which, *cells))
    seconds = f"rms from {end - STEADY:.0f} to {end:.0f} s, deg"
    return Table(
        ("controller", "sensor", "steps, deg", *(each.heading for each in STEP), seconds), rows
    )


def _end(study: CameraStudy) -> float:
    """Return the duration of the steps by the camera alone, in seconds."""
    return float(min(run.t[-1] for run in study.steps.values()))


def _late(run: HeadRun, end: float) -> float:
    """Return the rms error of the first axis in the last seconds before a time, in degrees."""
    chosen = (run.t > end - STEADY) & (run.t <= end)
    return float(np.sqrt(np.mean(run.error[chosen, 0] ** 2)))


def draw_steps(study: CameraStudy) -> Any:
    """Draw Fig 10: the angle against time, one curve for each target."""
    figure, axes = new_figure()
    for target in STEPS:
        run = study.steps.get((LAWS[0], target))
        if run is not None:
            (line,) = axes.plot(run.t, run.truth.angle[:, 0], label=f"{target:g} degrees")
            axes.axhline(target, color=line.get_color(), linewidth=0.6, linestyle=":")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("angle [deg]")
    axes.legend()
    return figure


def draw_wall_circles(study: CameraStudy) -> Any:
    """Draw Fig 11: the circle on the unrolled wall, in millimetres."""
    figure, axes = new_figure()
    for name, run in study.circles.items():
        circle = CIRCLES[name]
        words = f"{2e3 * circle.radius:.0f} mm across, in {circle.period:g} s: {run.rms:.2f} mm rms"
        axes.plot(*run.wanted.T, "k:", lw=0.8)
        axes.plot(*run.reached.T, label=words)
    axes.plot(0.0, 0.0, "k+", label="hole")
    axes.set_xlabel("X, around the pipe [mm]")
    axes.set_ylabel("Y, along the pipe [mm]")
    axes.set_aspect("equal")
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure
