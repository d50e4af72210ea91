"""The report of the polyaniline fibre study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from minorloop.drawing.operators import draw_density
from minorloop.dynamics.linear import Linear
from minorloop.operators.relays import RelayModel
from minorloop.report import Table
from papers.drawing import COLOURS, MINUTE, new_figure
from papers.fibre import MARKER_LEVELS, FibreStudy, marker_diagrams, run_study, unit_step
from papers.fibre_steady import HIGH, LOW, VALIDATION, Steady
from papers.harness import Study, rms

_NAMES = {
    "curves": "reversal curves",
    "staircase": "decaying staircase",
    "plays": "play operators",
    "polynomial": "cubic",
}


def voltages_table(steady: Steady) -> Table:
    """Return measured and predicted lengths at the seven voltages."""
    rows = [
        (f"{voltage:.2f}", *(f"{length:.1f}" for length in lengths))
        for voltage, *lengths in zip(
            VALIDATION, steady.validation, *map(steady.predictions.get, _NAMES), strict=True
        )
    ]
    return Table(("voltage, V", "measured, um", *_NAMES.values()), rows)


def times_of(model: Linear) -> str:
    """Return the time constants of a model as a list."""
    return ", ".join(f"{value:.1f}" for value in model.time_constants)


def draw_marker() -> Any:
    """Draw four diagrams of relays, beta to the right, alpha upwards."""
    figure, axes = new_figure(1, 4, height=2.9, sharey=True)
    levels = np.arange(1, MARKER_LEVELS + 1)
    for place, (one, (name, states)) in enumerate(zip(axes, marker_diagrams(), strict=True)):
        one.grid(False)
        for a, alpha in enumerate(levels):
            for b, beta in enumerate(levels[: a + 1]):
                face = "C0" if states[a, b] > 0 else "white"
                one.plot(beta, alpha, "o", ms=8, mec="C0", mfc=face)
        marker = int(name[1:])
        one.plot(marker, marker, "s", ms=14, mec="C1", mfc="none", mew=1.6)
        one.set(title=f"({'abcd'[place]}) {name}", xlabel="beta", aspect="equal")
        one.set_xticks(levels, [f"u{k}" for k in levels])
        one.set_yticks(levels, [f"u{k}" for k in levels])
        one.set(xlim=(0.4, MARKER_LEVELS + 0.6), ylim=(0.4, MARKER_LEVELS + 0.6))
    axes[0].set_ylabel("alpha")
    return figure


def draw_loops(study: FibreStudy) -> Any:
    """Draw the measured major loop, the model along the seven voltages, and its density."""
    figure, (left, right) = new_figure(1, 2, height=4.0)
    model = study.steady.curves.model
    left.plot(study.major.u, study.major.y, color="0.6", lw=1.4, label="major loop, measured")
    corners = np.array([LOW, *VALIDATION])
    fine = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(corners)])
    left.plot(fine, model.simulate(fine), color="C0", lw=1.0, label="model")
    left.plot(VALIDATION, study.steady.validation, "o", ms=5, color="C1", label="measured")
    left.set(xlabel="voltage [V]", ylabel="change of length [um]")
    left.legend(frameon=False)
    right.grid(False)
    draw_density(right, model, input_label="V")
    return figure


def draw_dots(study: FibreStudy) -> Any:
    """Draw the relays of the model as dots, filled where on, after the first four voltages."""
    model = study.steady.curves.model
    centres = (model.levels[1:] + model.levels[:-1]) / 2
    areas = 160 * model.weights / model.weights.max()
    relays = RelayModel(centres, model.weights)
    there = np.tril(np.ones_like(areas, dtype=bool))
    alpha, beta = np.meshgrid(centres, centres, indexing="ij")
    figure, axes = new_figure(1, 4, height=2.9, sharey=True)
    for count, one in enumerate(axes, start=1):
        on = relays.states(VALIDATION[:count]) > 0
        for state, face in ((on, "C0"), (~on, "white")):
            shown = there & state
            size = 4 + areas[shown]
            one.scatter(beta[shown], alpha[shown], s=size, c=face, edgecolors="C0", linewidths=0.8)
        now = VALIDATION[count - 1]
        one.plot(now, now, "s", ms=9, mec="C1", mfc="none", mew=1.6)
        one.set(title=f"({'abcd'[count - 1]}) {now:g} V", xlabel="beta [V]", aspect="equal")
        one.set(xlim=(LOW - 0.02, HIGH + 0.02), ylim=(LOW - 0.02, HIGH + 0.02))
    axes[0].set_ylabel("alpha [V]")
    return figure


def draw_predictions(study: FibreStudy) -> Any:
    """Draw measured and predicted lengths at the seven voltages, and the errors of four models."""
    figure, (left, right) = new_figure(1, 2, height=3.8)
    steady = study.steady
    place = np.arange(len(VALIDATION)) + 1
    left.plot(place, steady.validation, "s", ms=8, mec="0.3", mfc="none", label="measured")
    left.plot(place, steady.predictions["curves"], "o", ms=4, color="C0", label="predicted")
    left.set(ylabel="settled change of length [um]")
    colours = ("C0", "C4", COLOURS["plays"], COLOURS["polynomial"])
    shifts = np.array([-0.3, -0.1, 0.1, 0.3])
    for shift, colour, (name, words) in zip(shifts, colours, _NAMES.items(), strict=True):
        error = steady.predictions[name] - steady.validation
        label = f"{words}: {rms(error):.1f} um rms"
        right.bar(place + shift, error, width=0.2, color=colour, label=label)
    right.axhline(0.0, color="0.3", lw=0.8)
    right.set(ylabel="predicted minus measured [um]")
    for axes in (left, right):
        axes.set_xticks(place, [f"{voltage:g}" for voltage in VALIDATION])
        axes.set_xlabel("voltage [V], in this order")
        axes.legend(frameon=False, fontsize=8)
    return figure


def draw_inverse(study: FibreStudy) -> Any:
    """Draw the inverse as a map from length to voltage, and the errors of driving with it."""
    figure, (left, right) = new_figure(1, 2, height=3.8)
    steady, model = study.steady, study.steady.curves.model
    low, high = model.range
    corners = [low, high, low, 0.7 * high + 0.3 * low, 0.4 * high + 0.6 * low, high]
    wanted = np.concatenate([np.linspace(a, b, 60) for a, b in pairwise(corners)])
    left.plot(wanted, model.invert(wanted).u, color="C0", lw=1.0)
    left.set(xlabel="length wanted [um]", ylabel="voltage [V]", title="Inverse hysteresis")
    left.set_ylim(LOW - 0.02, HIGH + 0.02)
    place = np.arange(steady.targets.size) + 1
    names = {"curves": ("Preisach", "C0"), "polynomial": ("cubic", COLOURS["polynomial"])}
    for shift, (name, (words, colour)) in zip((-0.2, 0.2), names.items(), strict=True):
        error = steady.achieved[name] - steady.targets
        right.bar(place + shift, error, width=0.38, color=colour, label=f"{words} inverse")
    right.axhline(0.0, color="0.3", lw=0.8)
    right.set(xlabel="target", ylabel="achieved minus target [um]")
    right.set_xticks(place)
    right.legend(frameon=False)
    return figure


def draw_step(study: FibreStudy) -> Any:
    """Draw the step as the paper does: measured length, input, and unit step of the model."""
    figure, (first, middle, last) = new_figure(1, 3, height=3.0)
    rest, up = study.steps[:2]
    near = rest.t > rest.t[-1] - 60.0
    t = np.concatenate([rest.t[near], up.t]) - rest.t[-1]
    first.plot(t, np.concatenate([rest.y[near], up.y]), color="C1", lw=1.0)
    first.set(title="(a)", ylabel="change of length [um]")
    middle.step(t, np.concatenate([rest.u[near], up.u]), color="0.3", where="pre")
    middle.set(title="(b)", ylabel="voltage [V]")
    after = up.t - rest.t[-1]
    last.plot(after, study.fit.model.step_response(after), color="C0", lw=1.2)
    last.set(title="(c)", ylabel="unit step of the ARX model")
    for axes in (first, middle, last):
        axes.set_xlabel("time since the step [s]")
    return figure


def draw_steps(study: FibreStudy) -> Any:
    """Draw the measured unit steps with the model, and the two responses."""
    figure, (left, right) = new_figure(1, 2, height=3.8, sharey=True)
    rest, up, second, down = study.steps
    t = up.t - rest.t[-1]
    left.plot(t, unit_step(rest, up), color="C1", lw=2.4, alpha=0.5, label="0.40 to 0.45 V")
    left.plot(t, study.fit.model.step_response(t), color="C0", lw=1.0, label="ARX of it")
    left.plot(t, unit_step(up, second), color="0.4", lw=1.0, ls="--", label="0.45 to 0.50 V")
    right.plot(t, unit_step(rest, up), color="C1", lw=2.4, alpha=0.5, label="up, measured")
    right.plot(t, unit_step(second, down), color="C3", lw=2.4, alpha=0.5, label="down, measured")
    for response, colour in ((study.responses.rising, "C1"), (study.responses.falling, "C3")):
        if response is not None:
            right.plot(t, response.model.step_response(t), color=colour, lw=1.0)
    left.set(xlabel="time since the step [s]", ylabel="share of the settled change")
    right.set(xlabel="time since the step [s]")
    for axes in (left, right):
        axes.legend(frameon=False)
    return figure


def draw_trajectory(study: FibreStudy) -> Any:
    """Draw the measured length, the joined models, and the errors."""
    figure, (upper, lower) = new_figure(2, 1, height=5.2, sharex=True)
    t, y = (study.validation.t - study.validation.t[0]) / MINUTE, study.validation.y
    upper.plot(t, y, color="0.3", lw=2.2, alpha=0.5, label="measured")
    joined = (("one response", study.single, "C3"), ("one each way", study.updown, "C0"))
    for words, values, colour in joined:
        upper.plot(t, values, color=colour, lw=1.0, label=words)
        lower.plot(t, values - y, color=colour, lw=1.0)
    upper.set(ylabel="change of length [um]")
    upper.legend(frameon=False)
    lower.set(xlabel="time [min]", ylabel="model less measured [um]")
    return figure


STUDY = Study(
    "fibre",
    "Hysteresis and step response of a polyaniline fibre",
    run_study,
    page=__name__,
)
