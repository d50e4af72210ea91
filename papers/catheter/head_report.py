"""The report of the catheter head study: the paper's figures drawn for the twin, and more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from minorloop.drawing.operators import draw_density
from minorloop.operators.relays import RelayModel
from minorloop.report import Table
from minorloop_head.control.head import AGE
from papers.catheter.control.internal_model import mean_lag
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
from papers.catheter.head_static import COMMAND, MESH
from papers.catheter.picture_sensor import DROPPED
from papers.claims import cell
from papers.drawing import WITH_ROOM, draw, level, on_axes, panel
from papers.harness import Results, Study, rms

_COLOURS = {"pi": "C3", "feedforward_pi": "C4", "internal_model": "C1", "observer": "C0"}
"""Drawn controllers, the default last, on top. In steps, the others are between the internal model
and the observer."""
FIG_7 = ("wanted angle", "inverse of the operator", "power", "inverse of the heating", "command")
FIG_9 = ("wanted, less what the model missed", "C(s), G(s)", "v", "inverse operator, wire", "angle")
FIG_9_MODEL = ("v", "H(s)", "angle of the model", "less the angle", "what the model missed")
WORDS = {
    "observer": "observer",
    "feedforward": "open loop",
    "pi": "PI alone",
    "internal_model": "internal model",
    "adaptive": "adaptive",
    "feedforward_pi": "inverse and PI",
    "model_reference": "model reference",
}
"""Name of each controller in reports, the default first."""


class ControllerFigure(NamedTuple):
    """A figure of a controller; a smaller one is better."""

    key: str
    heading: str
    digits: int = 2
    """Digits after the decimal point."""

    def text(self, figures: Mapping[str, float]) -> str:
        """Return the figure of one controller as a cell of a table."""
        return cell(figures[self.key], f".{self.digits}f")


STEP = (
    ControllerFigure("settle_s", "settling, s", 1),
    ControllerFigure("overshoot_pct", "overshoot, %", 1),
    ControllerFigure("steady_rms_deg", "steady rms, deg"),
)
"""Figures of steps."""
RIVALS = (
    *STEP,
    ControllerFigure("disturbed_settle_s", "settling when disturbed, s", 1),
    ControllerFigure("disturbed_rms_deg", "steady rms when disturbed, deg"),
    ControllerFigure("ambient_ramp_max_deg", "worst with ambient +10 K, deg"),
    ControllerFigure("circle_rms_deg", f"circle in {PERIODS[1]:g} s, rms, deg"),
    ControllerFigure("energy_A2s", "energy, A²s", 1),
)
"""Figures of the controllers in the table of Fig 10."""


def names(study: Results, *_: Any) -> dict[str, Any]:
    """Return the further names of the template."""
    return {
        "drawn": _drawn(study),
        "interval_ms": 1e3 * TICK,
        "tenth_over_second": {
            name.replace(" ", "_"): float(each[9] / each[1])
            for name, one in study.ramps.items()
            for each in (np.hypot(*one.rms.T),)
        },
        "HIGHEST": HIGHEST,
        "HOTTEST": HOTTEST,
        "AGE": AGE,
        "mean_lag": mean_lag,
        "DROPPED": DROPPED,
    }


def rivals_table(
    quantities: Sequence[ControllerFigure], figures: Mapping[str, Mapping[str, float]]
) -> Table:
    """Return the figures of all controllers, one row for each."""
    columns = ("controller", *(each.heading for each in quantities))
    rows = [
        (WORDS[name], *(each.text(own) for each in quantities)) for name, own in figures.items()
    ]
    return Table(columns, rows)


def holds(*values: float | str) -> str:
    """Return whether the first value is no larger than the others; of several groups, each of them.

    Groups are separated by ``/``. If only some hold, a statement holds in part.
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
    """Return figures of the steps of each controller, and the time of a step of the loop in ms."""
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
    """Return the steps by every law, on pictures and on sensors at the joints.

    The last column is over the last seconds of the steps by the camera, which are shorter.
    """
    steps = tuple(sorted({target for _, target in camera.steps}))
    end = float(min(run.t[-1] for run in camera.steps.values()))
    sensors = {
        (law, target): sensed.get((f"step {target:g}", law)) for law in LAWS for target in steps
    }
    rows = []
    for targets, name in product(dict.fromkeys((steps, steps[-1:])), LAWS):
        for how, found in (("camera", camera.steps), ("joint sensors", sensors)):
            runs = [run for each in targets if (run := found.get((name, each))) is not None]
            if len(runs) == len(targets) and (name, targets[0]) in camera.steps:
                of, which = step_figures(runs), ", ".join(f"{target:g}" for target in targets)
                late = max(
                    rms(run.error[(run.t > end - STEADY) & (run.t <= end), 0]) for run in runs
                )
                cells = (*(each.text(of) for each in STEP), f"{late:.2f}")
                rows.append((WORDS[name], how, which, *cells))
    columns = ("controller", "sensor", "steps, deg", *(each.heading for each in STEP))
    return Table((*columns, f"rms from {end - STEADY:.0f} to {end:.0f} s, deg"), rows)


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


def draw_history() -> Any:
    """Draw Fig 3: inputs in time, and below them the state of the triangle after each."""
    u = np.linspace(0.0, COMMAND, 241)
    plane = RelayModel(u, np.zeros((u.size, u.size)), relay="unipolar")
    upper, lower = [], []
    for number, name in enumerate("abc", start=2):
        way = np.array((0.0, 0.9, 0.35, 0.7)[:number])  # extrema of the input
        time = (np.arange(number), way, "C0 o-")
        frame: dict[str, Any] = {"xlim": (0, 3.2), "ylim": (0, COMMAND)}
        upper.append(panel("time", "command [V]", time, title=f"({name})", **frame))
        shown = np.where(np.tri(u.size, dtype=bool), plane.states(way), np.nan)
        look = {"cmap": "Blues", "vmin": -0.4, "vmax": 1.4, "rasterized": True}
        cells = on_axes("pcolormesh", u, u, shown, **look)
        words = "beta [V]", "alpha [V]"
        lower.append(panel(*words, cells, title=f"({chr(ord(name) + 3)})", aspect="equal"))
    return draw(*upper, *lower, columns=3, height=5.4)


def draw_mesh(study: Results) -> Any:
    """Draw Fig 4 (c): the square mesh over the triangle, coloured by the measured angles."""
    paper = study.static.paper
    levels = paper.model.levels
    known = np.full((MESH + 1, MESH + 1), np.nan)
    ends = [int(np.argmin(np.abs(levels - u))) for u in paper.u]
    top = 0
    for before, now, angle in zip(ends[:-1], ends[1:], paper.y[1:], strict=True):
        top = now if now > before else top
        known[top, now] = angle
    lines = [([0.0, u, u], [u, u, COMMAND], "0.6 - 0.5") for u in levels]

    def nodes(axes: Any) -> None:
        i, j = np.nonzero(np.isfinite(known))
        shown = axes.scatter(levels[j], levels[i], c=known[i, j], cmap="viridis", s=26, zorder=3)
        axes.figure.colorbar(shown, ax=axes, label="angle at the node [deg]")

    diagonal = ([0.0, COMMAND], [0.0, COMMAND], "0.3 - 0.8")
    words = "beta: where the fall ends [V]", "alpha: where the rise ends [V]"
    return draw(panel(*words, *lines, diagonal, nodes, aspect="equal"), height=4.4)


def draw_ramps(study: Results) -> Any:
    """Draw Fig 8: reference and angle, and below them the errors with the hypothesis."""
    own, body = study.ramps["as it is"], study.ramps["body"]
    legend: dict[str, Any] = {"ncols": 2, **WITH_ROOM}
    return draw(
        panel(
            "", "angle [deg]", (own.t, own.wanted, "0.2 -- 0.8", "reference"),
            (own.t, own.angle, "C0", "actual"), legend=legend,
        ),
        panel(
            "time [s]", "error [deg]", (own.t, own.error, "C0 - 0.8", "the head as it is"),
            (body.t, body.error, "C3 - 0.8", "hypothesis: a body warms"), legend=legend,
        ),
        height=5.6, sharex=True, height_ratios=(3, 2),
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
            on_axes("axvspan", RAMP_AT, RAMP_AT + 10, **words),
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
    """Draw runs with impossible targets, with time and reason of giving up."""
    upper, lower = [], []
    for what in IMPOSSIBLE:
        run = study.runs[what, DEFAULT]
        said = f"no alarm: in the end it comes to {study.reach[what]:.0f} degrees"
        for alarm in run.alarms[:1]:
            said = f"{alarm.verdict.reason}, after {alarm.t:.1f} s"
        given_up = [on_axes("axvline", each.t, color="C3", lw=1.0) for each in run.alarms]
        angle = (run.t, run.truth.angle[:, 0], "C0", "angle")
        target = (run.t, run.wanted[:, 0], "0.2 -- 0.8", "target")
        title = f"{what}\n{said}"
        upper.append(panel("", "angle [deg]", angle, target, *given_up, title=title))
        current = (run.t, run.current[:, 0], "C1")
        lower.append(panel("time [s]", "current [A]", current, *given_up))
    return draw(*upper, *lower, columns=2, height=5.0, sharex=True, sharey="row")


def to_rounding(error: float) -> str:
    """Return the error of an exact inverse, in percent of the range, in words."""
    return "is exact to rounding" if error < 1e-9 else f"errs by {error:.2g} %"


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
