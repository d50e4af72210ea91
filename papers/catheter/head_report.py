"""The report of the catheter head study: the paper's figures drawn for the twin, and more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from minorloop.drawing.operators import draw_density
from minorloop.report import Table
from minorloop_head.control.by_camera import AGE
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.twins.surroundings import Cooling
from papers.catheter.head import (
    DEFAULT,
    IMPOSSIBLE,
    OLD,
    PERIODS,
    RAMP_AT,
    TARGETS,
    HeadStudy,
    gather,
    run_study,
)
from papers.catheter.head_camera_report import end_of, highest_steps
from papers.catheter.head_loop import DISTURBED, HIGHEST, HOTTEST, STEADY, TICK, HeadRun
from papers.catheter.head_ramps import NAMED, Ramps
from papers.catheter.head_rivals_report import STEP, WORDS, ControllerFigure, where_better
from papers.catheter.head_static import CURRENT
from papers.catheter.picture_sensor import DROPPED
from papers.drawing import new_figure
from papers.harness import Study

_COLOURS = {
    "observer": "C0",
    "feedforward": "C7",
    "pi": "C3",
    "internal_model": "C1",
    "adaptive": "C2",
    "feedforward_pi": "C4",
    "model_reference": "C9",
}
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


def names(study: HeadStudy, *_: Any) -> dict[str, Any]:
    """Return what the template names beside figures."""
    highest, laws = highest_steps(study.camera)
    return {
        "drawn": _drawn(study),
        "interval_ms": 1e3 * TICK,
        "body_share": Cooling().share,
        "HIGHEST": HIGHEST,
        "HOTTEST": HOTTEST,
        "AGE": AGE,
        "DROPPED": DROPPED,
        "STEADY": STEADY,
        "STEP": STEP,
        "camera_end": end_of(study.camera),
        "camera_step": highest,
        "camera_laws": laws,
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


def _drawn(study: HeadStudy) -> dict[str, dict[str, float]]:
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


def draw_loops(study: HeadStudy) -> Any:
    """Draw reversal curves of the mesh, and the density of the operator on power."""
    figure, (left, right) = new_figure(1, 2, height=4.2)
    paper = study.static.paper
    left.plot(paper.u, paper.y, ".", ms=4, color="C1", label="measured, settled")
    for top in paper.model.levels[4:]:
        way = np.concatenate([np.linspace(0.0, top, 120), np.linspace(top, 0.0, 120)])
        label = "mesh, interpolated" if top == paper.model.levels[-1] else None
        left.plot(way, paper.model.simulate(way), color="C0", lw=0.5, alpha=0.7, label=label)
    left.set(xlabel="command [V]", ylabel="angle [deg]", title="mesh of 0.1 V")
    left.legend(frameon=False)
    right.grid(False)
    draw_density(
        right,
        study.static.wires[0].model.operator,
        input_label="effective power [A²]",
        output_label="angle [deg]",
    )
    right.set_title("operator on heating power")
    return figure


def draw_predictions(study: HeadStudy) -> Any:
    """Draw measured and predicted angles after random commands."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    static = study.static
    place = np.arange(static.inputs.size) + 1
    upper.plot(place, static.settled, "o", ms=6, color="0.6", label="measured")
    names = {
        "power": ("on power", "C0"),
        "mesh": ("mesh", "C1"),
        "dots": ("mesh, one relay a point", "C3"),
    }
    for name, (words, colour) in names.items():
        predicted = static.predictions[name]
        upper.plot(place, predicted, "_", ms=9, mew=1.6, color=colour, label=words)
        lower.plot(place, predicted - static.settled, "o-", ms=3, lw=0.7, color=colour)
    upper.set(ylabel="angle [deg]")
    upper.legend(frameon=False, ncols=4, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    lower.set(xlabel="random command, in this order", ylabel="predicted less measured [deg]")
    return figure


def draw_arbitrary(study: HeadStudy) -> Any:
    """Draw command, actual and predicted angle, and errors under the arbitrary input."""
    figure, (upper, middle, lower) = new_figure(
        3, 1, height=6.5, sharex=True, height_ratios=(1, 3, 2)
    )
    found = study.static.arbitrary
    upper.plot(found.t, found.command, color="0.3", lw=0.8)
    middle.plot(found.t, found.angle, color="0.6", lw=2.5, label="actual")
    names = {"power": ("predicted, on power", "C0"), "mesh": ("predicted, mesh", "C1")}
    for name, (words, colour) in names.items():
        predicted = found.predicted[name]
        middle.plot(found.t, predicted, color=colour, lw=0.9, label=words)
        lower.plot(found.t, predicted - found.angle, color=colour, lw=0.8)
    upper.set(ylabel="command [V]")
    middle.set(ylabel="angle [deg]")
    middle.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    lower.set(xlabel="time [s]", ylabel="predicted less actual [deg]")
    return figure


def draw_inverse(study: HeadStudy) -> Any:
    """Draw errors of the two inverses on the model and on the wire."""
    figure, axes = new_figure(1, 2, height=3.6, sharey=True)
    static = study.static
    for one, title, ways in (
        (axes[0], "on the identified model", {"stepping": static.stepping, "exact": static.exact}),
        (axes[1], "on the wire", static.driven),
    ):
        for name, colour in (("stepping", "C3"), ("exact", "C0")):
            one.plot(
                static.targets, ways[name] - static.targets, "o", ms=4, color=colour, label=name
            )
        one.axhline(0.0, color="0.3", lw=0.8)
        one.set(xlabel="target [deg]", title=title)
    axes[0].set_ylabel("error [deg]")
    axes[0].legend(frameon=False)
    return figure


def draw_ramps(study: HeadStudy) -> Any:
    """Draw ramps in open loop: angle, errors of three cases, and the temperature of the body."""
    figure, (upper, middle, lower) = new_figure(
        3, 1, height=7.0, sharex=True, height_ratios=(3, 3, 1)
    )
    named = study.ramps[NAMED]
    upper.plot(named.t, named.wanted, color="0.2", lw=0.8, ls="--", label="reference")
    upper.plot(named.t, named.angle, color="C0", lw=1.0, label="actual")
    words = {
        NAMED: "varying heating, with a body",
        "constant": "latent heat and resistance alone",
        "room": "room warms by 6 K",
    }
    for (name, label), colour in zip(words.items(), ("C0", "C7", "C3"), strict=True):
        run = study.ramps[name]
        middle.plot(run.t, run.error, color=colour, lw=0.8, label=label)
    lower.plot(np.append(0.0, named.ends[1:]), np.append(20.0, named.body), ".-", color="C1")
    upper.set(ylabel="angle [deg]")
    middle.set(ylabel="error [deg]")
    lower.set(xlabel="time [s]", ylabel="body [C]")
    for one in (upper, middle):
        one.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.2))
    return figure


def draw_steps(runs: Mapping[tuple[str, str], HeadRun]) -> Any:
    """Draw the steps of `run_steps` with every controller: angles above, currents below."""
    figure, axes = new_figure(2, 3, height=5.6, sharex=True, sharey="row")
    for column, target in enumerate(TARGETS):
        for name, words in reversed(WORDS.items()):  # the default is drawn last, on top
            run = runs[f"step {target:g}", name]
            colour = _COLOURS[name]
            axes[0, column].plot(run.t, run.truth.angle[:, 0], color=colour, lw=1.1, label=words)
            axes[1, column].plot(run.t, run.current[:, 0], color=colour, lw=0.8)
        axes[0, column].axhline(target, color="0.2", lw=0.8, ls="--")
        axes[0, column].set_title(f"{target:g} degrees")
        axes[1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylabel("angle [deg]")
    axes[1, 0].set_ylabel("current [A]")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), ncols=4, loc="outside upper center", frameon=False
    )
    return figure


def draw_disturbed(study: HeadStudy) -> Any:
    """Draw steps of 40 degrees in other surroundings, and the error while the ambient rises."""
    figure, (left, right) = new_figure(1, 2, height=3.8)
    for place, where in enumerate(DISTURBED):
        run = study.runs[f"{where}, step {TARGETS[-1]:g}", DEFAULT]
        left.plot(run.t, run.truth.angle[:, 0], color=f"C{place}", lw=1.1, label=where)
    left.axhline(TARGETS[-1], color="0.2", lw=0.8, ls="--")
    left.set(xlabel="time [s]", ylabel="angle [deg]", title=WORDS[DEFAULT])
    left.legend(frameon=False)
    for name in (DEFAULT, "internal_model", "pi"):
        run = study.runs["ambient ramp", name]
        late = run.t > RAMP_AT - 5
        right.plot(run.t[late], run.error[late, 0], color=_COLOURS[name], label=WORDS[name])
    right.axvspan(RAMP_AT, RAMP_AT + 10, color="C3", alpha=0.12, label="ambient rises 10 K")
    right.set(xlabel="time [s]", ylabel="error [deg]")
    right.legend(frameon=False)
    return figure


def draw_aged(study: HeadStudy) -> Any:
    """Draw errors on aged wires."""
    figure, axes = new_figure(height=3.0)
    for name in OLD:
        run = study.runs["aged", name]
        axes.plot(run.t, run.error[:, 0], color=_COLOURS[name], lw=0.9, label=WORDS[name])
    axes.set(xlabel="time [s]", ylabel="error [deg]", ylim=(-3, 3))
    axes.legend(frameon=False)
    return figure


def draw_circles(study: HeadStudy) -> Any:
    """Draw circles, wanted and driven."""
    periods = [key for key in study.figures() if key.startswith("circle")]
    chosen = [f"{PERIODS[0]:g}", f"{PERIODS[1]:g}", periods[-1][7:-1]]
    figure, axes = new_figure(1, 3, height=3.6, sharex=True, sharey=True)
    for one, period in zip(axes, chosen, strict=True):
        run = study.runs[f"circle {period} s", DEFAULT]
        late = run.t > run.t[-1] - 2 * float(period)
        one.plot(*run.wanted[late].T, color="0.2", lw=0.8, ls="--", label="wanted")
        one.plot(*run.truth.angle[late].T, color="C0", lw=1.1, label="driven")
        one.set(xlabel="pan [deg]", title=f"{period} s a turn", aspect="equal")
    axes[0].set_ylabel("tilt [deg]")
    axes[0].legend(frameon=False)
    return figure


def draw_hopeless(study: HeadStudy) -> Any:
    """Draw runs with impossible targets."""
    figure, axes = new_figure(2, len(IMPOSSIBLE), height=5.0, sharex=True, sharey="row")
    for column, what in enumerate(IMPOSSIBLE):
        run = study.runs[what, DEFAULT]
        axes[0, column].plot(run.t, run.truth.angle[:, 0], color="C0", label="angle")
        axes[0, column].plot(run.t, run.wanted[:, 0], color="0.2", lw=0.8, ls="--", label="target")
        axes[1, column].plot(run.t, run.current[:, 0], color="C1")
        axes[0, column].set_title(what)
        axes[1, column].set_xlabel("time [s]")
        for alarm in run.alarms:
            for row in range(2):
                axes[row, column].axvline(alarm.t, color="C3", lw=1.0)
            words = f"{alarm.verdict.reason},\nafter {alarm.t:.1f} s"
            axes[0, column].text(
                alarm.t + 0.3, 4, words, color="C3", bbox={"fc": "white", "ec": "none", "pad": 1}
            )
        if not run.alarms:
            axes[0, column].text(
                0.5, 45, f"no alarm: in the end it comes\nto {study.reach[what]:.0f} degrees"
            )
    axes[0, 0].set_ylabel("angle [deg]")
    axes[1, 0].set_ylabel("current [A]")
    axes[0, 0].legend(frameon=False, loc="center right")
    return figure


def draw_plan(study: HeadStudy) -> Any:
    """Draw angles and currents of a planned sequence and of the inverse."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    for plan, angle, words, colour in zip(
        study.plan, study.planned, ("planned", "inverse"), ("C0", "C3"), strict=True
    ):
        t = plan.interval * np.arange(1, angle.size + 1)
        upper.plot(t, angle, color=colour, lw=1.2, label=words)
        lower.step(t, np.minimum(plan.current, CURRENT), where="pre", color=colour, lw=1.0)
    upper.plot(t, plan.targets, ".", ms=3, color="0.2", label="targets")
    upper.set(ylabel="angle [deg]")
    upper.legend(frameon=False)
    lower.set(xlabel="time [s]", ylabel="current [A]")
    return figure


def to_rounding(rms: float) -> str:
    """Return in words by how much of the range in percent an exact inverse errs."""
    return "is exact to rounding" if rms < _ROUNDING else f"errs by {rms:.2g} %"


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


def limits_table(study: HeadStudy) -> Table:
    """Return the highest current, temperature and stress of each controller."""
    rows = []
    for name, words in WORDS.items():
        own = [run for (_, who), run in study.runs.items() if who == name]
        current, hottest, stress = (
            max(float(values.max()) for values in each)
            for each in zip(
                *((run.current, run.truth.hottest, run.truth.stress) for run in own), strict=True
            )
        )
        rows.append(
            (words, str(len(own)), f"{current:.3f}", f"{hottest:.0f}", f"{stress / 1e6:.0f}")
        )
    columns = ("controller", "runs", "highest current, A", "hottest, C", "highest stress, MPa")
    return Table(columns, rows)


STUDY = Study(
    "head",
    "A catheter head on shape-memory wires",
    run_study,
    gather,
    {
        "integral": "papers.catheter.servo_integral",
        "rivals": "papers.catheter.camera_rivals",
        "unreachable": "papers.catheter.unreachable",  # with more cases
    },
    page=__name__,
)
