"""Figures and report of the positioning experiment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.drawing.operators import draw_density
from minorloop.report import Picture, Report, Table

if TYPE_CHECKING:
    from minorloop.positioning import AppliedSequence, Positioning

COLOURS = {"Preisach": "C0", "quadratic": "C3", "plays": "C2", "polynomial": "C3"}
MINUTE, HOUR = 60.0, 3600.0
"""In seconds."""


def positioning_report(result: Positioning) -> Report:
    """Return the experiment as a page: method, figures, and the errors of both inverses."""
    setup, figures = result.protocol, result.summary
    c0, c1, c2 = result.polynomial.coefficients
    scores = [
        (name, f"{drive.rms:.3f}", f"{drive.worst:.3f}") for name, drive in _drives(result).items()
    ]
    report = Report(
        "Positioning an ionic polymer strip without a sensor",
        f"{setup.targets} target curvatures, reached open loop: {figures['rms_preisach']:.2f} 1/m "
        f"rms from target with the inverse of a Preisach model, {figures['rms_quadratic']:.2f} 1/m "
        f"with the inverse of a quadratic fitted to the same {figures['measurements']} points, "
        f"{figures['rms_ratio']:.1f} times as much.",
    )
    report.add(
        "What this is",
        text=(
            "The experiment of Chen, Tan and Shahinpoor (Quasi-static positioning of ionic "
            "polymer-metal composite actuators, 2005), carried out on a twin: a simulation of the "
            "strip from its physics, with ion pinning, water relaxation and creep, and without a "
            "Preisach operator. The figures are those of the twin, not of the paper's strip.",
            f"Specimen and targets are drawn with seed {result.seed}; the curvature sensor has a "
            f"noise of {result.noise:g} 1/m. Identification and inversion use only voltages and "
            "measured curvatures.",
        ),
        table=Table(("inverse", "rms error, 1/m", "largest error, 1/m"), scores),
    )
    report.add(
        "Measuring: a decaying staircase",
        text=f"{result.voltages.size} holds of {setup.hold:g} s, one level shorter each turn and "
        "measured at every level: as many points as the model has unknowns. For comparison, least "
        f"squares on the same points gives a single-valued y = {c2:.2f} u^2 + {c1:.2f} u + "
        f"{c0:.2f} in 1/m; the paper's strip gave -0.35 u^2 + 8.2 u + 0.34.",
        pictures=[
            Picture(draw_staircase(result), "Voltage and curvature in time (compare Figs 7, 8)."),
            Picture(
                draw_model(result),
                "Settled curvature at each level with the loops of the model and the quadratic, "
                "and the density on the Preisach plane (compare Figs 8, 9 and Fig 11).",
            ),
        ],
    )
    report.add(
        "Driving: both inverses on the strip",
        text=f"Each sequence begins after {setup.saturation_hold:g} s at -{setup.voltage:g} V, and "
        f"holds each voltage for {setup.hold:g} s; the last sample counts.",
        table=_target_table(result),
        pictures=[
            Picture(
                draw_drives(result),
                "The voltages of each inverse (Fig 12), and the curvature of the strip (Fig 13).",
            ),
            Picture(
                draw_errors(result),
                "Settled curvature (a) and error (b) at each target (Fig 14). Whiskers: 90 % band "
                "of the error of the Preisach inverse, as wide as its model was off in the run of "
                f"the other inverse; {result.coverage:.0%} of the targets lie inside.",
            ),
        ],
    )
    return report


def _target_table(result: Positioning) -> Table:
    columns = ("target, 1/m", "Preisach, V", "achieved, 1/m", "quadratic, V", "achieved, 1/m")
    return Table(columns, result.rows)


def draw_staircase(result: Positioning) -> Any:
    """Voltage and curvature of the identification against time."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    hours = result.staircase.t / HOUR
    upper.step(hours, result.staircase.u, where="post", color="0.25", lw=1.0)
    upper.set_ylabel("voltage [V]")
    lower.plot(hours, result.staircase.y, color="C0", lw=0.9, rasterized=True, label="curvature")
    ends = (np.arange(result.settled.size) + 1) * result.protocol.hold / HOUR
    lower.plot(ends, result.settled, "o", ms=3, color="C1", label="taken as settled")
    lower.set(xlabel="time [h]", ylabel="curvature [1/m]")
    lower.legend(frameon=False)
    return figure


def draw_model(result: Positioning) -> Any:
    """Measured points with the model's loops and the quadratic, and the density."""
    figure, (left, right) = new_figure(1, 2, height=4.2)
    model, voltages = result.identification.model, result.voltages
    # Points from one voltage of the staircase to the next, to draw a line
    places = np.linspace(0, voltages.size - 1, (voltages.size - 1) * 12 + 1)
    fine = np.interp(places, np.arange(voltages.size), voltages)
    left.plot(fine, model.simulate(fine), color=COLOURS["Preisach"], lw=0.9, label="model")
    left.plot(voltages, result.settled, "o", ms=3, color="C1", label="measured")
    u = np.sort(fine)
    left.plot(u, result.polynomial.simulate(u), color=COLOURS["quadratic"], label="quadratic")
    left.set(xlabel="voltage [V]", ylabel="curvature [1/m]", title="Settled curvature")
    left.legend(frameon=False)
    right.grid(False)
    draw_density(right, model, input_label="voltage [V]", output_label="curvature [1/m]")
    return figure


def draw_drives(result: Positioning) -> Any:
    """Voltages of both inverses, and the curvature that they cause with the targets."""
    figure, (upper, lower) = new_figure(2, 1, height=6.0, sharex=True)
    steps = np.append(result.targets, result.targets[-1])
    minutes = np.arange(steps.size) * result.protocol.hold / MINUTE
    lower.step(minutes, steps, where="post", color="0.2", lw=1.6, ls="--", label="wanted")
    for name, drive in _drives(result).items():
        line: dict[str, Any] = {"color": COLOURS[name], "label": f"{name} inverse"}
        held = np.append(drive.voltages, drive.voltages[-1])
        upper.step(minutes, held, where="post", **line)
        t = (drive.record.t - drive.record.t[0]) / MINUTE
        lower.plot(t, drive.record.y, lw=0.9, rasterized=True, **line)
    upper.set_ylabel("voltage [V]")
    lower.set(xlabel="time [min]", ylabel="curvature [1/m]")
    _legend_above(lower)
    return figure


def draw_errors(result: Positioning) -> Any:
    """Fig 14: settled curvatures (a), and errors with the bands of the Preisach inverse (b)."""
    figure, (left, right) = new_figure(1, 2, height=4.2)
    place = np.arange(result.targets.size) + 1
    left.plot(place, result.targets, "_", ms=14, mew=2, color="0.2", label="wanted")
    for shift, mark, (name, drive) in zip((-0.2, 0.2), "o^", _drives(result).items(), strict=True):
        look: dict[str, Any] = {"color": COLOURS[name], "label": f"{name}: {drive.rms:.2f} 1/m rms"}
        left.plot(place + shift / 2, drive.achieved, mark, ms=4, color=COLOURS[name], label=name)
        right.bar(place + shift, drive.errors, width=0.38, **look)
    off, reach = result.bands.y - result.targets, result.bands.half_width
    whiskers: dict[str, Any] = {"fmt": "none", "color": "0.1", "lw": 0.9, "capsize": 2}
    right.errorbar(place - 0.2, off, reach, label="90 % band", **whiskers)
    right.axhline(0.0, color="0.3", lw=0.8)
    for axes, words in ((left, "(a) settled curvature"), (right, "(b) achieved minus target")):
        axes.set(xlabel="target", ylabel=f"{words} [1/m]", xticks=place)
        _legend_above(axes)
    return figure


def _legend_above(axes: Any) -> None:
    """Draw the legend above the axes, where it hides no data."""
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, fontsize=8)


def _drives(result: Positioning) -> dict[str, AppliedSequence]:
    return {"Preisach": result.preisach, "quadratic": result.quadratic}
