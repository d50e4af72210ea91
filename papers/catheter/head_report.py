"""The report of the catheter head study: the paper's figures drawn for the twin, and more."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from minorloop.drawing.operators import draw_density
from minorloop.report import Table
from minorloop_head.control.head import AGE
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.twins.surroundings import Cooling
from papers.catheter.head import (
    DEFAULT,
    IMPOSSIBLE,
    PERIODS,
    RAMP_AT,
    TARGETS,
    gather,
    run_study,
)
from papers.catheter.head_camera import CIRCLES, LAWS
from papers.catheter.head_loop import (
    DISTURBED,
    HIGHEST,
    HOTTEST,
    STEADY,
    TICK,
    HeadRun,
    step_figures,
)
from papers.catheter.head_ramps import NAMED, Ramps
from papers.catheter.head_rivals_report import STEP, WORDS, ControllerFigure, where_better
from papers.catheter.head_static import CURRENT
from papers.catheter.picture_sensor import DROPPED
from papers.drawing import WITH_ROOM, draw, level, panel
from papers.harness import Results, Study, rms

_COLOURS = {"pi": "C3", "feedforward_pi": "C4", "internal_model": "C1", "observer": "C0"}
"""Controllers that are drawn, the default last, on top. In steps, the others lie between the
internal model and the observer."""
_ROUNDING = 1e-9
"""Error of an inverse in percent of the range that is of the floating-point numbers only."""
RIVALS = (
    *STEP,
    ControllerFigure("disturbed_settle_s", "settling when disturbed", "s", 1, least=TICK),
    ControllerFigure("disturbed_rms_deg", "steady rms when disturbed", "deg"),
    ControllerFigure("ambient_ramp_max_deg", "worst with ambient +10 K", "deg"),
    ControllerFigure("circle_rms_deg", f"circle in {PERIODS[1]:g} s, rms", "deg"),
    ControllerFigure("energy_A2s", "energy", "A²s", 1),
)
"""Figures of the controllers in the table of Fig 10."""


def names(study: Results, *_: Any) -> dict[str, Any]:
    """Return what the template names beside figures."""
    steps = study.camera.steps
    highest = max(target for _, target in steps)
    laws = {name: step_figures([run]) for (name, step), run in steps.items() if step == highest}
    return {
        "drawn": _drawn(study),
        "interval_ms": 1e3 * TICK,
        "body_share": Cooling().share,
        "camera_end": end_of(study.camera),
        "camera_step": highest,
        "camera_laws": laws,
        "HIGHEST": HIGHEST,
        "HOTTEST": HOTTEST,
        "AGE": AGE,
        "DROPPED": DROPPED,
        "where_better": where_better,
    }


def holds(*values: float | str) -> str:
    """Return whether the first value is no larger than the others; of several groups, each of them.

    Groups are apart by ``/``. If some hold only, a statement holds in part.
    """
    groups: list[list[float]] = [[]]
    for value in values:
        if isinstance(value, str):
            groups.append([])
        else:
            groups[-1].append(value)
    held = [all(first <= other for other in others) for first, *others in groups]
    if all(held):
        return "holds"
    return "holds in part" if any(held) else "does not hold here"


def _drawn(study: Results) -> dict[str, dict[str, float]]:
    """Return how the steps of each controller settle, and the time of a step of the loop in ms."""
    found = {}
    for name in WORDS:
        runs = [study.runs[f"step {target:g}", name] for target in TARGETS]
        took = np.concatenate([run.step_seconds[1:] for run in runs])
        settled = [run.settle for run in runs]
        found[name] = {
            "least": min(settled),
            "most": max(settled),
            "twice": 2 * min(settled),
            "step_ms": 1e3 * float(np.median(took)),
        }
    return found


def laws_table(camera: Results, sensed: Mapping[tuple[str, str], HeadRun]) -> Table:
    """Return the steps by every law, on pictures and on sensors at the joints."""
    steps, end = tuple(sorted({target for _, target in camera.steps})), end_of(camera)
    found = {("camera", *key): run for key, run in camera.steps.items()}
    for name, target in product(LAWS, steps):
        if (f"step {target:g}", name) in sensed:
            found["joint sensors", name, target] = sensed[f"step {target:g}", name]
    rows = []
    several = dict.fromkeys((steps, steps[-1:]))
    for targets, name, how in product(several, LAWS, ("camera", "joint sensors")):
        runs = [run for target in targets if (run := found.get((how, name, target))) is not None]
        if len(runs) == len(targets) and (name, targets[0]) in camera.steps:
            of, which = step_figures(runs), ", ".join(f"{target:g}" for target in targets)
            late = max(_late(run, end) for run in runs)
            cells = (*(each.text(of) for each in STEP), f"{late:.2f}")
            rows.append((WORDS[name], how, which, *cells))
    columns = ("controller", "sensor", "steps, deg", *(each.heading for each in STEP))
    return Table((*columns, f"rms from {end - STEADY:.0f} to {end:.0f} s, deg"), rows)


def end_of(camera: Results) -> float:
    """Return the duration of the steps by the camera alone, in seconds."""
    return float(min(run.t[-1] for run in camera.steps.values()))


def _late(run: HeadRun, end: float) -> float:
    """Return the rms error of the first axis in the last seconds before a time, in degrees."""
    return rms(run.error[(run.t > end - STEADY) & (run.t <= end), 0])


def draw_loops(study: Results) -> Any:
    """Draw Fig 2: reversal curves of the mesh, and the density of the operator on power."""
    paper, operator = study.static.paper, study.static.wires[0].model.operator
    lines: list[Any] = []
    for top in paper.model.levels[4:]:
        way = np.concatenate([np.linspace(0.0, top, 120), np.linspace(top, 0.0, 120)])
        lines.append((way, paper.model.simulate(way), "C0 - 0.5"))
    lines[-1] = (*lines[-1], "mesh, interpolated")
    measured = (paper.u, paper.y, "C1 . 4", "measured, settled")
    labels: dict[str, Any] = {"input_label": "effective power [A²]", "output_label": "angle [deg]"}
    density = partial(draw_density, model=operator, **labels)
    left = panel("command [V]", "angle [deg]", measured, *lines, title="mesh of 0.1 V")
    return draw(left, density, columns=2, height=4.2)


def draw_arbitrary(study: Results) -> Any:
    """Draw Fig 5: command, actual and predicted angle, and errors under the arbitrary input."""
    found = study.static.arbitrary
    middle: list[Any] = [(found.t, found.angle, "0.6 - 2.5", "actual")]
    lower = []
    for name, words, colour in (
        ("power", "predicted, on power", "C0"),
        ("mesh", "predicted, mesh", "C1"),
    ):
        predicted = found.predicted[name]
        middle.append((found.t, predicted, f"{colour} - 0.9", words))
        lower.append((found.t, predicted - found.angle, f"{colour} - 0.8"))
    return draw(
        panel("", "command [V]", (found.t, found.command, "0.3 - 0.8")),
        panel("", "angle [deg]", *middle, legend={"ncols": 3, **WITH_ROOM}),
        panel("time [s]", "predicted less actual [deg]", *lower),
        height=6.5, sharex=True, height_ratios=(1, 3, 2),
    )  # fmt: skip


def draw_inverse(study: Results) -> Any:
    """Draw errors of the two inverses on the model and on the wire."""
    targets, panels = study.static.targets, []
    for title, ways in (
        ("on the identified model", study.static.model),
        ("on the wire", study.static.driven),
    ):
        dots = [
            (targets, ways[name] - targets, f"{colour} o 4", name)
            for name, colour in (("stepping", "C3"), ("exact", "C0"))
        ]
        panels.append(panel("target [deg]", "error [deg]", level(0.0), *dots, title=title))
    return draw(*panels, columns=2, height=3.6, sharey=True)


def draw_ramps(study: Results) -> Any:
    """Draw Fig 8: angle, errors of three cases, and the temperature of the body."""
    named = study.ramps[NAMED]
    errors = [
        (study.ramps[name].t, study.ramps[name].error, f"{colour} - 0.8", words)
        for name, colour, words in (
            (NAMED, "C0", "varying heating, with a body"),
            ("constant", "C7", "latent heat and resistance alone"),
            ("room", "C3", "room warms by 6 K"),
        )
    ]
    legend, body = {"ncols": 3, **WITH_ROOM}, np.append(20.0, named.body)
    return draw(
        panel(
            "", "angle [deg]", (named.t, named.wanted, "0.2 -- 0.8", "reference"),
            (named.t, named.angle, "C0", "actual"), legend=legend,
        ),
        panel("", "error [deg]", *errors, legend=legend),
        panel("time [s]", "body [C]", (np.append(0.0, named.ends[1:]), body, "C1 .-")),
        height=7.0, sharex=True, height_ratios=(3, 3, 1),
    )  # fmt: skip


def draw_steps(runs: Mapping[tuple[str, str], HeadRun]) -> Any:
    """Draw Fig 10: the steps of every controller, angles above, currents below."""
    upper, lower = [], []
    for number, target in enumerate(TARGETS):
        each = [(runs[f"step {target:g}", name], name) for name in _COLOURS]
        angles = [
            (run.t, run.truth.angle[:, 0], _COLOURS[name], *((WORDS[name],) if not number else ()))
            for run, name in each
        ]
        currents = [(run.t, run.current[:, 0], f"{_COLOURS[name]} - 0.8") for run, name in each]
        way = level(target, "0.2 -- 0.8")
        upper.append(
            panel("", "" if number else "angle [deg]", *angles, way, title=f"{target:g} degrees")
        )
        lower.append(panel("time [s]", "" if number else "current [A]", *currents))
    return draw(*upper, *lower, columns=3, height=5.6, sharex=True, sharey="row")


def draw_disturbed(study: Results) -> Any:
    """Draw steps of 40 degrees in other surroundings, and the error while the ambient rises."""
    steps = []
    for number, where in enumerate(DISTURBED):
        run = study.runs[f"{where}, step {TARGETS[-1]:g}", DEFAULT]
        steps.append((run.t, run.truth.angle[:, 0], f"C{number}", where))
    errors = []
    for name in (DEFAULT, "internal_model", "pi"):
        run = study.runs["ambient ramp", name]
        late = run.t > RAMP_AT - 5
        errors.append((run.t[late], run.error[late, 0], _COLOURS[name], WORDS[name]))
    words = {"color": "C3", "alpha": 0.12, "label": "ambient rises 10 K"}
    goal, title = level(TARGETS[-1], "0.2 -- 0.8"), WORDS[DEFAULT]
    return draw(
        panel("time [s]", "angle [deg]", *steps, goal, title=title),
        panel(
            "time [s]", "error [deg]", *errors,
            lambda axes: axes.axvspan(RAMP_AT, RAMP_AT + 10, **words),
        ),
        columns=2,
    )  # fmt: skip


def draw_camera_steps(camera: Results) -> Any:
    """Draw Fig 10 by the camera alone: the angle against time, one curve for each target."""
    steps = sorted(target for name, target in camera.steps if name == DEFAULT)
    lines: list[Any] = []
    for number, target in enumerate(steps):
        run, colour = camera.steps[DEFAULT, target], f"C{number}"
        lines.append((run.t, run.truth.angle[:, 0], f"{colour} - 1.5", f"{target:g} degrees"))
        lines.append(level(target, f"{colour} : 0.6"))
    return draw(panel("time [s]", "angle [deg]", *lines), height=3.6)


def draw_wall_circles(camera: Results) -> Any:
    """Draw Fig 11: the circle on the unrolled wall, in millimetres."""
    lines: list[Any] = [([0.0], [0.0], "k + 6", "hole")]
    for number, (name, run) in enumerate(camera.circles.items()):
        across, period = 2e3 * CIRCLES[name].radius, CIRCLES[name].period
        words = f"{across:.0f} mm across, in {period:g} s: {run.rms:.2f} mm rms"
        lines += [(*run.wanted.T, "k : 0.8"), (*run.reached.T, f"C{number} - 1.5", words)]
    beside = {"loc": "center left", "bbox_to_anchor": (1.02, 0.5)}
    axes = "X, around the pipe [mm]", "Y, along the pipe [mm]"
    return draw(panel(*axes, *lines, aspect="equal", legend=beside), height=3.6)


def draw_hopeless(study: Results) -> Any:
    """Draw runs with impossible targets, and when and why they were given up."""
    upper, lower = [], []
    for what in IMPOSSIBLE:
        run = study.runs[what, DEFAULT]
        said = f"no alarm: in the end it comes to {study.reach[what]:.0f} degrees"
        for alarm in run.alarms[:1]:
            said = f"{alarm.verdict.reason}, after {alarm.t:.1f} s"
        given_up = [partial(_mark, at=alarm.t) for alarm in run.alarms]
        angle = (run.t, run.truth.angle[:, 0], "C0", "angle")
        target = (run.t, run.wanted[:, 0], "0.2 -- 0.8", "target")
        title = f"{what}\n{said}"
        upper.append(panel("", "angle [deg]", angle, target, *given_up, title=title))
        current = (run.t, run.current[:, 0], "C1")
        lower.append(panel("time [s]", "current [A]", current, *given_up))
    return draw(*upper, *lower, columns=2, height=5.0, sharex=True, sharey="row")


def _mark(axes: Any, at: float) -> None:
    axes.axvline(at, color="C3", lw=1.0)


def draw_plan(study: Results) -> Any:
    """Draw angles and currents of a planned sequence and of the inverse."""
    upper, lower, targets = [], [], study.plan[0].targets
    t = study.plan[0].interval * np.arange(1, targets.size + 1)
    for plan, angle, words, colour in zip(
        study.plan, study.planned, ("planned", "inverse"), ("C0", "C3"), strict=True
    ):
        upper.append((t, angle, f"{colour} - 1.2", words))
        # A current is held until the end of its interval.
        held = np.repeat(np.minimum(plan.current, CURRENT), 2)
        lower.append((np.repeat(np.append(0.0, t), 2)[1:-1], held, colour))
    return draw(
        panel("", "angle [deg]", *upper, (t, targets, "0.2 . 3", "targets")),
        panel("time [s]", "current [A]", *lower),
        height=5.0,
        sharex=True,
    )


def to_rounding(error: float) -> str:
    """Return in words by how much of the range in percent an exact inverse errs."""
    return "is exact to rounding" if error < _ROUNDING else f"errs by {error:.2g} %"


def mean_lag(wire: HeatedWire) -> float:
    """Return the heating lag of a wire that moves, in seconds, on average over its levels."""
    low, high = wire.operator.range
    return wire.lag + wire.latent * float((high - low) / np.ptp(wire.operator.levels))


def after_start(ramps: Ramps) -> float:
    """Return the rms error of the tenth ramp over that of the second, which begins warm."""
    whole = np.sqrt(np.mean(ramps.rms**2, axis=1))
    return float(whole[-1] / whole[1])


def circle_speeds(figures: Mapping[str, Any]) -> str:
    """Return in words the errors of the circles, the slowest first."""
    periods = sorted((key[7:-1] for key in figures if key.startswith("circle")), key=float)
    said = (f"{figures[f'circle_{one}s']['rms_deg']:.2f} in {one} s" for one in reversed(periods))
    return ", ".join(said)


def limits_table(study: Results) -> Table:
    """Return the highest current, temperature and stress of each controller."""
    rows = []
    for name, words in WORDS.items():
        own = [run for (_, who), run in study.runs.items() if who == name]
        current = max(run.current.max() for run in own)
        hottest = max(run.truth.hottest.max() for run in own)
        stress = max(run.truth.stress.max() for run in own) / 1e6
        cells = (f"{current:.3f}", f"{hottest:.0f}", f"{stress:.0f}")
        rows.append((words, str(len(own)), *cells))
    columns = ("controller", "runs", "highest current, A", "hottest, C", "highest stress, MPa")
    return Table(columns, rows)


STUDY = Study(
    "head",
    "A catheter head on shape-memory wires",
    run_study,
    gather,
    {
        "integral": "papers.catheter.inspection_servo",
        "rivals": "papers.catheter.head_camera",
        "unreachable": "papers.catheter.unreachable",  # with more cases
    },
    page=__name__,
)
