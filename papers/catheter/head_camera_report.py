"""The part of the head's report on its camera alone: Figs 10 and 11 in the form of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

from minorloop.report import Table
from papers.catheter.head_camera import CIRCLES, LAWS, STEPS, CameraStudy
from papers.catheter.head_loop import STEADY, HeadRun, step_figures
from papers.catheter.head_rivals_report import STEP, WORDS
from papers.drawing import new_figure


def _targets(study: CameraStudy) -> tuple[float, ...]:
    """Return the steps in degrees, the highest last."""
    return tuple(sorted({target for _, target in study.steps}))


def highest_steps(study: CameraStudy) -> tuple[float, dict[str, dict[str, float]]]:
    """Return the highest step in degrees, and its figures by the camera alone of each law."""
    highest = _targets(study)[-1]
    runs = {name: run for (name, target), run in study.steps.items() if target == highest}
    return highest, {name: step_figures([run]) for name, run in runs.items()}


def laws_table(study: CameraStudy, sensed: Mapping[tuple[str, str], HeadRun]) -> Table:
    """Return the steps by every law, on pictures and on sensors at the joints."""
    steps, end = _targets(study), end_of(study)
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


def end_of(study: CameraStudy) -> float:
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
