"""The report of the polyaniline fibre study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.drawing.operators import draw_density
from minorloop.dynamics.linear import Linear
from minorloop.operators.relays import RelayModel
from minorloop.report import Table
from papers.drawing import COLOURS, MINUTE, Paint, bars, draw, panel
from papers.fibre import HIGH, LOW, MARKER_LEVELS, VALIDATION, marker_diagrams, run_study, unit_step
from papers.harness import Results, Study, rms

_NAMES = {
    "curves": ("reversal curves", "C0"),
    "staircase": ("decaying staircase", "C4"),
    "plays": ("play operators", COLOURS["plays"]),
    "polynomial": ("cubic", COLOURS["polynomial"]),
}
_AROUND = {"xlim": (LOW - 0.02, HIGH + 0.02), "ylim": (LOW - 0.02, HIGH + 0.02)}


def voltages_table(steady: Results) -> Table:
    """Return measured and predicted lengths at the seven voltages."""
    lengths = np.array([VALIDATION, steady.validation, *map(steady.predictions.get, _NAMES)]).T
    rows = [(f"{voltage:.2f}", *(f"{each:.1f}" for each in row)) for voltage, *row in lengths]
    words = (words for words, _ in _NAMES.values())
    return Table(("voltage, V", "measured, um", *words), rows)


def times_of(model: Linear) -> str:
    """Return the time constants of a model as a list."""
    return ", ".join(f"{value:.1f}" for value in model.time_constants)


def draw_marker() -> Any:
    """Draw Fig 2: four diagrams of relays, beta to the right, alpha upwards."""
    levels, diagrams = np.arange(1.0, MARKER_LEVELS + 1), marker_diagrams()
    names, around = [f"u{k:.0f}" for k in levels], (0.4, MARKER_LEVELS + 0.6)
    panels = [
        _relays(levels, states > 0, np.full(states.shape, 64.0), float(name[1:]), 14)
        for name, states in diagrams
    ]
    labels = {"xticks": levels, "yticks": levels, "xticklabels": names, "yticklabels": names}
    options = {"xlim": around, "ylim": around, **labels}
    return _diagrams(panels, [name for name, _ in diagrams], "", **options)


def draw_dots(study: Results) -> Any:
    """Draw the relays of the model as dots, filled where on, after the first four voltages."""
    model = study.steady.curves.model
    centres = (model.levels[1:] + model.levels[:-1]) / 2
    areas = 4 + 160 * model.weights / model.weights.max()
    relays, first = RelayModel(centres, model.weights), VALIDATION[:4]
    panels = [
        _relays(centres, relays.states(first[: count + 1]) > 0, areas, now, 9)
        for count, now in enumerate(first)
    ]
    return _diagrams(panels, [f"{now:g} V" for now in first], " [V]", **_AROUND)


def _relays(levels: FloatArray, on: Any, areas: FloatArray, now: float, size: float) -> Paint:
    """Return a panel of relays (N, N) as dots, filled where on, and the marker."""
    alpha, beta = np.meshgrid(levels, levels, indexing="ij")
    there = np.tril(np.ones(on.shape, dtype=bool))

    def paint(axes: Any) -> None:
        axes.grid(False)
        for state, face in ((there & on, "C0"), (there & ~on, "white")):
            dots = {"s": areas[state], "c": face, "edgecolors": "C0", "linewidths": 0.8}
            axes.scatter(beta[state], alpha[state], **dots)
        axes.plot(now, now, "s", ms=size, mec="C1", mfc="none", mew=1.6)

    return paint


def _diagrams(panels: list[Paint], names: list[str], unit: str, **options: Any) -> Any:
    """Draw diagrams (a) to (d) beside each other."""
    framed = [
        panel(
            f"beta{unit}", "" if k else f"alpha{unit}", paint,
            title=f"({'abcd'[k]}) {name}", aspect="equal", **options,
        )
        for k, (paint, name) in enumerate(zip(panels, names, strict=True))
    ]  # fmt: skip
    return draw(*framed, columns=4, height=2.9, sharey=True)


def draw_loops(study: Results) -> Any:
    """Draw the measured major loop, the model along the seven voltages, and its density."""
    model, way = study.steady.curves.model, _between([LOW, *VALIDATION], 40)
    left = panel(
        "voltage [V]", "change of length [um]",
        (study.major.u, study.major.y, "0.6 - 1.4", "major loop, measured"),
        (way, model.simulate(way), "C0", "model"),
        (VALIDATION, study.steady.validation, "C1 o 5", "measured"),
    )  # fmt: skip
    return draw(left, partial(draw_density, model=model, input_label="V"), columns=2, height=4.0)


def _between(corners: Any, points: int) -> FloatArray:
    return np.concatenate([np.linspace(a, b, points) for a, b in pairwise(corners)])


def draw_predictions(study: Results) -> Any:
    """Draw measured and predicted lengths at the seven voltages, and the errors of four models."""
    steady, place = study.steady, np.arange(len(VALIDATION)) + 1
    errors = {name: steady.predictions[name] - steady.validation for name in _NAMES}
    groups = {
        f"{words}: {rms(errors[name]):.1f} um rms": (errors[name], colour)
        for name, (words, colour) in _NAMES.items()
    }
    order, volts = "voltage [V], in this order", [f"{voltage:g}" for voltage in VALIDATION]
    options: dict[str, Any] = {"xticks": place, "xticklabels": volts, "legend": {"fontsize": 8}}
    left = panel(
        order, "settled change of length [um]",
        (place, steady.validation, "0.6 s 8", "measured"),
        (place, steady.predictions["curves"], "C0 o 4", "predicted"), **options,
    )  # fmt: skip
    return draw(left, bars(order, "predicted minus measured [um]", groups, **options), columns=2)


def draw_inverse(study: Results) -> Any:
    """Draw the inverse as a map from length to voltage, and the errors of driving with it."""
    steady, model = study.steady, study.steady.curves.model
    low, high = model.range
    corners = [low, high, low, 0.7 * high + 0.3 * low, 0.4 * high + 0.6 * low, high]
    wanted = _between(corners, 60)
    names = {"curves": "Preisach", "polynomial": "cubic"}
    groups = {
        f"{words} inverse": (steady.achieved[name] - steady.targets, _NAMES[name][1])
        for name, words in names.items()
    }
    left = panel(
        "length wanted [um]", "voltage [V]", (wanted, model.invert(wanted).u, "C0"),
        title="Inverse hysteresis", ylim=_AROUND["ylim"],
    )  # fmt: skip
    return draw(left, bars("target", "achieved minus target [um]", groups), columns=2)


def draw_step(study: Results) -> Any:
    """Draw the step as the paper does: measured length, input, and unit step of the model."""
    rest, up = study.steps[:2]
    near = rest.t > rest.t[-1] - 60.0
    t, y, u = (
        np.concatenate([getattr(rest, name)[near], getattr(up, name)]) for name in ("t", "y", "u")
    )
    after, words = up.t - rest.t[-1], "time since the step [s]"
    step = (after, study.fit.model.step_response(after), "C0 - 1.2")
    return draw(
        panel(words, "change of length [um]", (t - rest.t[-1], y, "C1"), title="(a)"),
        panel(words, "voltage [V]", (t - rest.t[-1], u, "0.3"), title="(b)"),
        panel(words, "unit step of the ARX model", step, title="(c)"),
        columns=3, height=3.0,
    )  # fmt: skip


def draw_steps(study: Results) -> Any:
    """Draw the measured unit steps with the model, and the two responses."""
    rest, up, second, down = study.steps
    t, words = up.t - rest.t[-1], "time since the step [s]"
    rising, falling = study.responses.rising.model, study.responses.falling.model
    first, back = unit_step(rest, up), unit_step(second, down)
    return draw(
        panel(
            words, "share of the settled change", (t, first, "C1 - 2", "0.40 to 0.45 V"),
            (t, study.fit.model.step_response(t), "C0", "ARX of it"),
            (t, unit_step(up, second), "0.4 --", "0.45 to 0.50 V"),
        ),
        panel(
            words, "", (t, first, "C1 - 2", "up, measured"), (t, back, "C3 - 2", "down, measured"),
            (t, rising.step_response(t), "0.3", "models"), (t, falling.step_response(t), "0.3"),
        ),
        columns=2, sharey=True,
    )  # fmt: skip


def draw_trajectory(study: Results) -> Any:
    """Draw the measured length, the joined models, and the errors."""
    t, y = (study.validation.t - study.validation.t[0]) / MINUTE, study.validation.y
    joined = ((study.single, "C3", "one response"), (study.updown, "C0", "one each way"))
    lines = [(t, y, "0.6 - 2.2", "measured"), *((t, *each) for each in joined)]
    errors = [(t, values - y, colour) for values, colour, _ in joined]
    return draw(
        panel("", "change of length [um]", *lines),
        panel("time [min]", "model less measured [um]", *errors),
        height=5.2,
        sharex=True,
    )


STUDY = Study(
    "fibre", "Hysteresis and step response of a polyaniline fibre", run_study, page=__name__
)
