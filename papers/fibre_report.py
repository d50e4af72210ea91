"""The report of the polyaniline fibre study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.drawing.operators import draw_density
from minorloop.dynamics.linear import Linear
from minorloop.report import Table
from papers.drawing import ABOVE, COLOURS, MINUTE, bars, draw, panel
from papers.fibre import (
    HIGH,
    HOLD,
    LEVELS,
    LOW,
    MARKER_LEVELS,
    VALIDATION,
    marker_diagrams,
    run_study,
    unit_step,
)
from papers.harness import Results, Study, rms

_NAMES = {
    "square": ("dots, square system", "C4"),
    "dots": ("dots, constrained", "C9"),
    "uniform": ("uniform cells", "C7"),
    "curves": ("ours: reversible diagonal", "C0"),
    "plays": ("play operators", COLOURS["plays"]),
    "polynomial": ("cubic", COLOURS["polynomial"]),
}
_LENGTH = "change of length [um]"


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
    """Draw Fig 2: four diagrams of relays, filled where on, and the marker."""
    levels = np.arange(1.0, MARKER_LEVELS + 1)
    alpha, beta = np.meshgrid(levels, levels, indexing="ij")
    ticks, around = [f"u{k:.0f}" for k in levels], (0.4, MARKER_LEVELS + 0.6)
    frame = {"xticks": levels, "xticklabels": ticks, "yticks": levels, "yticklabels": ticks}
    panels = []
    for letter, (name, on) in zip("abcd", marker_diagrams(), strict=True):
        now = float(name[1:])
        panels.append(
            panel(
                "beta", "alpha" if letter == "a" else "",
                (beta[on > 0], alpha[on > 0], "C0 o 8"), (beta[on < 0], alpha[on < 0], "0.75 o 4"),
                (now, now, "C1 s 5"), title=f"({letter}) {name}", aspect="equal",
                xlim=around, ylim=around, **frame,
            )
        )  # fmt: skip
    return draw(*panels, columns=4, height=2.9, sharey=True)


def draw_prediction(study: Results) -> Any:
    """Draw Fig 3: the loop of the dots and the path of the seven, and lengths in time."""
    steady, model = study.steady, study.steady.models["square"]
    loop, way = np.concatenate([LEVELS, LEVELS[::-1]]), (LOW, *VALIDATION)
    t, ends = _minutes(steady), HOLD / MINUTE * np.arange(1, len(VALIDATION) + 1)
    dots, outlined = (steady.predictions["square"], "C0 o 6", "predicted"), {"loc": "lower right"}
    return draw(
        panel(
            "voltage [V]", _LENGTH, (loop, model.simulate(loop), "0.6 - 2.5", "major loop"),
            (way, model.simulate(way), "C0 - 1.0", "path"), (VALIDATION, *dots),
            (VALIDATION, steady.validation, "C1 x 6", "measured"), title="(a)", legend=outlined,
        ),
        panel(
            "time [min]", _LENGTH, (t, steady.record.y, "C1 - 1.2", "measured"), (ends, *dots),
            title="(b)", legend=outlined,
        ),
        columns=2, height=4.0,
    )  # fmt: skip


def _minutes(steady: Results) -> Any:
    return (steady.record.t - steady.record.t[0]) / MINUTE


def draw_ours(study: Results) -> Any:
    """Draw loop and density of cells with a reversible diagonal."""
    model = study.steady.models["curves"]
    loop, way = (_between(ends, 40) for ends in ([LOW, HIGH, LOW], [LOW, *VALIDATION]))
    left = panel(
        "voltage [V]", _LENGTH, (loop, model.simulate(loop), "0.6 - 2.5", "major loop"),
        (way, model.simulate(way), "C0 - 1.0", "path"),
        (VALIDATION, study.steady.validation, "C1 x 6", "measured"), legend={"loc": "lower right"},
    )  # fmt: skip
    density = partial(
        draw_density, model=model, input_label="voltage [V]", output_label="length [um]"
    )
    return draw(left, density, columns=2, height=4.0)


def _between(corners: Any, points: int) -> FloatArray:
    return np.concatenate([np.linspace(a, b, points) for a, b in pairwise(corners)])


def draw_errors(study: Results) -> Any:
    """Draw the errors of four models at the seven voltages."""
    steady, place = study.steady, np.arange(len(VALIDATION)) + 1
    shown = ("square", "uniform", "curves", "polynomial")
    errors = {name: steady.predictions[name] - steady.validation for name in shown}
    groups = {
        f"{_NAMES[name][0]}: {rms(error):.1f} um rms": (error, _NAMES[name][1])
        for name, error in errors.items()
    }
    volts = [f"{voltage:g}" for voltage in VALIDATION]
    labels = "voltage [V], in this order", "predicted minus measured [um]"
    return draw(bars(*labels, groups, xticks=place, xticklabels=volts))


def draw_inverse(study: Results) -> Any:
    """Draw the inverse as a map from length to voltage, and the errors of driving with it."""
    steady, model = study.steady, study.steady.models["curves"]
    low, high = model.range
    corners = [low, high, low, 0.7 * high + 0.3 * low, 0.4 * high + 0.6 * low, high]
    wanted = _between(corners, 60)
    names = {"curves": "Preisach", "plays": "plays", "polynomial": "cubic"}
    groups = {
        f"{words} inverse": (steady.achieved[name] - steady.targets, _NAMES[name][1])
        for name, words in names.items()
    }
    left = panel(
        "length wanted [um]", "voltage [V]", (wanted, model.invert(wanted).u, "C0"),
        title="Inverse hysteresis", ylim=(LOW - 0.02, HIGH + 0.02),
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
        panel(words, _LENGTH, (t - rest.t[-1], y, "C1"), title="(a)"),
        panel(words, "voltage [V]", (t - rest.t[-1], u, "0.3"), title="(b)"),
        panel(words, "unit step of the ARX model", step, title="(c)"),
        columns=3, height=3.0,
    )  # fmt: skip


def draw_steps(study: Results) -> Any:
    """Draw the measured unit steps with the models: two up, and one down."""
    rest, up, second, down = study.steps
    t, responses = up.t - rest.t[-1], study.responses
    rising, falling = responses.rising.model, responses.falling.model
    lines = (
        (t, unit_step(second, down), "C3 - 0.6", "0.50 to 0.45 V, fitted"),
        (t, unit_step(rest, up), "C1 - 0.8", "0.40 to 0.45 V, fitted"),
        (t, unit_step(up, second), "0.6 - 0.8", "0.45 to 0.50 V, not fitted"),
        (t, rising.step_response(t), "0.1 - 1.5", "models, up and down"),
        (t, falling.step_response(t), "0.1 - 1.5"),
    )
    frame: dict[str, Any] = {"legend": {"loc": "lower right"}}
    return draw(panel("time since the step [s]", "share of the settled change", *lines, **frame))


def draw_trajectory(study: Results) -> Any:
    """Draw Fig 5: the measured length, predicted settled values, the joined models, and errors."""
    steady, t = study.steady, _minutes(study.steady)
    ends = HOLD / MINUTE * np.arange(1, len(VALIDATION) + 1)
    joined = ((study.single, "C3", "one response"), (study.updown, "C0", "one each way"))
    return draw(
        panel(
            "", _LENGTH, (t, steady.record.y, "0.7 - 2.5", "measured"),
            *((t, *each) for each in joined),
            (ends, steady.predictions["square"], "0.1 o 6", "settled, predicted"),
            legend={**ABOVE, "ncols": 4},
        ),
        panel(
            "time [min]", "model less measured [um]",
            *((t, values - steady.record.y, colour) for values, colour, _ in joined),
        ),
        height=5.2, sharex=True,
    )  # fmt: skip


STUDY = Study(
    "fibre", "Hysteresis and step response of a polyaniline fibre", run_study, page=__name__
)
