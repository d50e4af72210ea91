"""Figures of reduced logs. Matplotlib is imported only when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from minorloop.lab.records import Record
    from minorloop.lab.reduction import Reduction

_COLORS = {"settled": "C0", "extrapolated": "C1", "unsettled": "C3"}
_MOST_DRAWN = 20_000
"""Samples of the log that are drawn: more cannot be seen."""


def draw_record(record: Record) -> Any:
    """Return a figure: outputs and inputs in time, and the first of each against the other."""
    figure, axes = new_figure(1, 3, 3.5, 13.0)
    every = slice(None, None, max(len(record) // _MOST_DRAWN, 1))
    u, y = np.atleast_2d(record.u)[:, every], np.atleast_2d(record.y)[:, every]
    for place, values, names in ((axes[0], y, record.outputs), (axes[1], u, record.inputs)):
        place.plot(record.t[every], values.T, ".-", ms=2, lw=0.6, rasterized=True)
        label = ", ".join(map(_label, names))
        place.set(xlabel=_label(record.time), ylabel=label)
    axes[2].plot(u[0], y[0], ".-", ms=2, lw=0.4, rasterized=True)
    axes[2].set(xlabel=_label(record.input), ylabel=_label(record.output))
    return figure


def draw_reduction(result: Reduction) -> Any:
    """Return a figure: the log in time, its points against the input, and their uncertainty."""
    figure, axes = new_figure(2, 2, 7.5, 10.5)
    _draw_log(axes[0, 0], result)
    _draw_input(axes[1, 0], result)
    _draw_loop(axes[0, 1], result)
    _draw_uncertainty(axes[1, 1], result)
    return figure


def _draw_log(axes: Axes, result: Reduction) -> None:
    log, every = result.log, slice(None, None, max(len(result.log) // _MOST_DRAWN, 1))
    axes.plot(log.t[every], log.y[every], ".", ms=1, color="0.7", rasterized=True)
    for verdict, color in _COLORS.items():
        points = [point for point in result.points if point.verdict == verdict]
        t, y = [point.t for point in points], [point.value for point in points]
        axes.plot(t, y, "o", ms=4, color=color, label=verdict)
    values = np.array([p.value for p in result.points])
    values = values[np.isfinite(values)]
    if values.size and np.ptp(values) > 0:
        margin = 0.25 * np.ptp(values)
        axes.set_ylim(values.min() - margin, values.max() + margin)
    axes.legend(frameon=False, loc="upper right")
    axes.set(xlabel=_label(log.time), ylabel=_label(log.output), title="Log and settled points")


def _draw_input(axes: Axes, result: Reduction) -> None:
    log, every = result.log, slice(None, None, max(len(result.log) // _MOST_DRAWN, 1))
    axes.plot(log.t[every], log.u[every], lw=0.6, color="0.6", rasterized=True)
    holds = [point for point in result.points if point.verdict != "passed"]
    passed = [point for point in result.points if point.verdict == "passed"]
    axes.hlines(
        [point.input for point in holds],
        [log.t[point.begin] for point in holds],
        [log.t[point.stop - 1] for point in holds],
        colors="C0",
        label="hold",
    )
    axes.plot([p.t for p in passed], [p.input for p in passed], "x", color="C3", label="passed")
    axes.legend(frameon=False, loc="upper right")
    axes.set(xlabel=_label(log.time), ylabel=_label(log.input), title="Holds of the input")


def _draw_loop(axes: Axes, result: Reduction) -> None:
    for verdict, color in _COLORS.items():
        points = [point for point in result.points if point.verdict == verdict]
        u, y = [point.input for point in points], [point.value for point in points]
        error = [2 * point.sd if np.isfinite(point.sd) else 0.0 for point in points]
        if points:
            axes.errorbar(u, y, error, fmt="o", ms=3, color=color, label=verdict)
    axes.set(
        xlabel=_label(result.log.input),
        ylabel=_label(result.log.output),
        title="Points, with two standard deviations",
    )


def _draw_uncertainty(axes: Axes, result: Reduction) -> None:
    holds = [point for point in result.points if point.verdict != "passed"]
    number = np.arange(1, len(holds) + 1)
    axes.plot(number, [point.sd for point in holds], "o", ms=3, label="standard deviation")
    axes.plot(
        number,
        [abs(point.value - point.end) for point in holds],
        "x",
        ms=4,
        color="C1",
        label="change by extrapolation",
    )
    axes.set(xlabel="hold", ylabel=_label(result.log.output), title="Uncertainty")
    axes.legend(frameon=False)


def _label(quantity: object) -> str:
    """Return a label in which a dollar sign does not begin a formula."""
    return str(quantity).replace("$", r"\$")
