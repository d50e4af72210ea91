"""Draw the figures of the docs that take seconds: ``make figures``."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import minorloop as ml
from minorloop.drawing.operators import draw_density

EXAMPLES = Path(__file__).parent
FOLDER = EXAMPLES.parent / "docs" / "figures"
HISTORY = (0.0, 0.9, 0.15, 0.7, 0.3, 0.55)
"""Extrema of an input, after negative saturation at 0."""


def staircase(extrema: tuple[float, ...]) -> np.ndarray:
    """Corners (beta, alpha) of the line below which relays are on, from left to right."""
    corners = [(0.0, extrema[1])]
    for maximum, minimum, following in zip(
        extrema[1::2], extrema[2::2], (*extrema[3::2], None), strict=False
    ):
        corners.append((minimum, maximum))
        corners.append((minimum, minimum if following is None else following))
    corners.append((extrema[-1], extrema[-1]))
    return np.array(corners)


def draw_plane(axes: Axes, extrema: tuple[float, ...], title: str) -> None:
    line = staircase(extrema)
    on = np.vstack([line, [0.0, 0.0]])
    axes.fill([0, 0, 1], [0, 1, 1], color="0.93")
    axes.fill(on[:, 0], on[:, 1], color="C0", alpha=0.35, lw=0)
    axes.plot([0, 1], [0, 1], color="0.4", lw=0.8)
    axes.plot(line[:, 0], line[:, 1], color="C0", lw=2)
    axes.plot(extrema[-1], extrema[-1], "o", color="C3", ms=6)
    axes.text(0.06, 0.06 + 0.14, "on", color="C0", weight="bold")
    axes.text(0.06, 0.93, "off", color="0.45", weight="bold")
    axes.set(xlabel=r"$\beta$", ylabel=r"$\alpha$", title=title, aspect="equal")
    axes.set(xlim=(0, 1), ylim=(0, 1), xticks=[0, 1], yticks=[0, 1])


def draw_memory() -> Figure:
    figure = Figure(figsize=(11.5, 3.7), layout="constrained")
    time, before, after = figure.subplots(1, 3, width_ratios=(1.35, 1, 1))
    wiped = (0.0, 0.9, 0.15, 0.8)
    path = (*HISTORY, 0.8)
    time.plot(range(len(HISTORY)), HISTORY, color="C0", lw=2)
    time.plot([len(HISTORY) - 1, len(HISTORY)], path[-2:], color="C0", lw=2, ls=":")
    time.plot(len(HISTORY) - 1, HISTORY[-1], "o", color="C3")
    for place, name in enumerate(["", "$M_1$", "$m_1$", "$M_2$", "$m_2$", "$u$"]):
        shift = (0, 6) if place % 2 else (0, -14)
        time.annotate(name, (place, path[place]), shift, textcoords="offset points", ha="center")
    time.set(xlabel="time", ylabel="input", title="Input", ylim=(-0.08, 1.05), xticks=[])
    draw_plane(before, HISTORY, "What it leaves behind")
    draw_plane(after, wiped, "After rising beyond $M_2$")
    return figure


def draw_tutorial() -> Figure:
    """The record of the tutorial, its model and the model's plane."""
    levels = np.linspace(-1.2, 1.2, 11)
    strip = ml.connect("twin:ipmc", specimen=1, noise=0.05)
    voltages = ml.excitation.decaying_staircase(levels)
    curvatures = [strip.apply(float(u), 200.0, 200.0).y[-1] for u in voltages]
    model = ml.identify(voltages, curvatures, ml.Plane(levels, diagonal="reversible")).model
    figure = Figure(figsize=(10, 3.9), layout="constrained")
    loop, plane = figure.subplots(1, 2, width_ratios=(1.15, 1))
    places = np.linspace(0, voltages.size - 1, 12 * voltages.size)
    fine = np.interp(places, np.arange(voltages.size), voltages)
    loop.plot(fine, model.simulate(fine), color="C0", lw=1, label="model")
    loop.plot(voltages, curvatures, "o", ms=3.5, color="C1", label="measured")
    loop.set(xlabel="voltage [V]", ylabel="curvature [1/m]", title="Measured and modelled")
    loop.grid(alpha=0.25)
    loop.legend(frameon=False)
    draw_density(plane, model, input_label="voltage [V]", output_label="curvature [1/m]")
    return figure


def draw_wall() -> Figure:
    """The record of a wall under cyclic load, its model, and the errors where it was not fitted."""
    record = ml.read(EXAMPLES / "wall.csv", input="force", output="displacement")
    fit = ml.identify(record, holdout=0.3)
    out = fit.held_out
    curve = np.polynomial.Polynomial.fit(fit.u[~out], fit.y[~out], 5)
    figure = Figure(figsize=(10, 3.9), layout="constrained")
    figure.suptitle(
        f"A wall under cyclic load, measured: error on rows that were not fitted "
        f"{fit.holdout_nrmse:.2%} of range"
    )
    loop, errors = figure.subplots(1, 2, width_ratios=(1, 1.15))
    loop.plot(fit.u, fit.prediction, color="C0", lw=1, label="model")
    loop.plot(fit.u[~out][::3], fit.y[~out][::3], "o", ms=3, color="C1", label="fitted")
    loop.plot(fit.u[out][::3], fit.y[out][::3], "o", ms=3, color="C3", label="not fitted")
    loop.set(xlabel="force [kN]", ylabel="displacement [mm]", title="Measured and modelled")
    row = np.flatnonzero(out)
    errors.plot(row, (curve(fit.u) - fit.y)[out], color="0.5", label="polynomial of degree 5")
    errors.plot(row, (fit.prediction - fit.y)[out], color="C0", label="minorloop")
    errors.set(xlabel="row", ylabel="error [mm]", title="Error on rows that were not fitted")
    for axes in (loop, errors):
        axes.grid(alpha=0.25)
        axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    draw_memory().savefig(FOLDER / "memory.png", dpi=100)
    draw_tutorial().savefig(FOLDER / "tutorial.png", dpi=100)
    draw_wall().savefig(FOLDER / "wall.png", dpi=100)
