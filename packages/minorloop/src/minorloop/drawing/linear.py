"""Figures of identified linear dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.identification.output_error import Coefficients

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from minorloop.identification.frequency import FrequencyResponse
    from minorloop.identification.linear_fit import LinearFit, StepResponse
    from minorloop.identification.rational import RationalFit

_POINTS = 300
"""Points of a curve: about one for each pixel of an axis."""


def draw_linear_fit(result: LinearFit) -> Any:
    """Draw the record with the simulation, and the unit step response with its band."""
    figure, (left, right) = new_figure(1, 2, 3.8, 10.5)
    interval = result.model.interval or 1.0
    found: Coefficients = result.candidate.coefficients
    for k, one in enumerate(result.stretches):
        t = interval * np.arange(one.y.size)
        labels = ("measured", "simulated") if k == 0 else (None, None)
        left.plot(t, one.y, ".", ms=2.5, color="0.6", label=labels[0], rasterized=True)
        left.plot(t, found.simulate(one.u), lw=0.9, color="C0", label=labels[1])
    left.set(xlabel="time [s]", ylabel="output less rest", title="Record")
    left.legend(frameon=False)
    _draw_unit_step(right, result, "C0", "unit step response")
    right.set(xlabel="time [s]", ylabel="output", title="Unit step, band of 2 deviations")
    return figure


def draw_step_response(result: StepResponse) -> Any:
    """Draw both responses with their bands."""
    figure, axes = new_figure(height=4.0, width=6.4)
    for name, fit, colour in (("rising", result.rising, "C0"), ("falling", result.falling, "C3")):
        if fit is not None:
            _draw_unit_step(axes, fit, colour, name)
    axes.set(xlabel="time [s]", ylabel="share of the settled change", title="Unit step")
    axes.legend(frameon=False)
    return figure


def _draw_unit_step(axes: Axes, fit: LinearFit, colour: str, label: str) -> None:
    interval = fit.model.interval or 1.0
    end = interval * max(np.count_nonzero(one.u) for one in fit.stretches)
    t = np.linspace(0.0, end, _POINTS)
    # Half width of a band in standard deviations, as its title says
    y, spread = fit.model.step_response(t), 2.0 * fit.step_deviation(t)
    axes.plot(t, y, color=colour, label=label)
    axes.fill_between(t, y - spread, y + spread, color=colour, alpha=0.2, lw=0)


def draw_frequency_response(result: FrequencyResponse) -> Any:
    """Draw gain and phase from input to output, and from the operator's output."""
    kinds = [("from input to output", result.plant)]
    if result.after is not None:
        kinds.append(("from operator to output", result.after))
    width = 4.6 * len(kinds) + 0.6
    figure, grid = new_figure(2, len(kinds), 5.6, width, squeeze=False, sharex=True)
    for (upper, lower), (title, gains) in zip(grid.T, kinds, strict=True):
        for amplitude, row in zip(result.amplitudes, gains, strict=True):
            phase = np.degrees(np.unwrap(np.angle(row)))
            label = f"amplitude {amplitude:g}"
            upper.semilogx(result.frequencies, 20 * np.log10(np.abs(row)), "o-", ms=3, label=label)
            lower.semilogx(result.frequencies, phase, "o-", ms=3, label=label)
        upper.set(ylabel="gain [dB]", title=title)
        lower.set(xlabel="frequency [Hz]", ylabel="phase [degrees]")
        upper.legend(frameon=False)
    return figure


def draw_rational_fit(result: RationalFit) -> Any:
    """Draw gain and phase of the measured points and the fitted curve."""
    figure, (left, right) = new_figure(1, 2)
    fine = np.geomspace(result.frequencies.min(), result.frequencies.max(), _POINTS)
    curve = result.model.response(fine)
    for x, gains, style in (
        (result.frequencies, result.measured, {"marker": "o", "ms": 4, "ls": "", "color": "0.5"}),
        (fine, curve, {"color": "C0"}),
    ):
        left.semilogx(x, 20 * np.log10(np.abs(gains)), **style)
        right.semilogx(x, np.degrees(np.unwrap(np.angle(gains))), **style)
    left.set(xlabel="frequency [Hz]", ylabel="gain [dB]")
    right.set(xlabel="frequency [Hz]", ylabel="phase [degrees]")
    return figure
