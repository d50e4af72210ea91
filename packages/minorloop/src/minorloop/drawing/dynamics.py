"""Figures of dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure

if TYPE_CHECKING:
    from minorloop.dynamics.cascade import CascadeInversion
    from minorloop.dynamics.linear import Linear
    from minorloop.identification.after_effect_result import AfterEffectIdentification
    from minorloop.identification.dynamic_result import DynamicIdentification

_POINTS = 400
"""Points of a curve: about one for each pixel of an axis."""


def draw_linear(system: Linear) -> Any:
    """Draw step response, gain and phase."""
    figure, (left, middle, right) = new_figure(1, 3, 3.4, 10.5)
    times = system.time_constants[np.isfinite(system.time_constants)]
    slowest, fastest = (times.max(), times.min()) if times.size else (1.0, 1.0)
    end = 6 * slowest + system.delay
    t = np.linspace(0, end, _POINTS)
    left.plot(t, system.step_response(t), color="C0")
    left.set(xlabel="time [s]", ylabel="output", title="Unit step")
    highest = 10 / fastest if system.interval is None else np.pi / system.interval
    frequency = np.geomspace(0.02 / slowest, max(highest, 0.2 / slowest), _POINTS) / (2 * np.pi)
    gain = system.response(frequency)
    middle.semilogx(frequency, 20 * np.log10(np.abs(gain)), color="C0")
    middle.set(xlabel="frequency [Hz]", ylabel="gain [dB]", title="Gain")
    right.semilogx(frequency, np.degrees(np.unwrap(np.angle(gain))), color="C0")
    right.set(xlabel="frequency [Hz]", ylabel="phase [degrees]", title="Phase")
    return figure


def draw_record(
    result: DynamicIdentification | AfterEffectIdentification,
    record: Any,
    loop: Any,
    residual: Any,
    output_label: str,
) -> None:
    """Draw a record in time with its model, the measured loop and the residual."""
    t, y = result.t, result.y
    record.plot(t, y, ".", ms=2.0, color="0.6", label="measured", rasterized=True)
    record.plot(t, result.prediction, lw=0.8, color="C0", label="model", rasterized=True)
    record.set(xlabel="time [s]", ylabel=output_label, title="Record")
    record.legend(frameon=False)
    loop.plot(result.u, y, ".", ms=2.0, color="0.6", label="measured", rasterized=True)
    residual.plot(t, result.prediction - y, lw=0.6, color="C3", rasterized=True)
    residual.set(xlabel="time [s]", ylabel=f"model less measured, {output_label}", title="Residual")


def draw_dynamic_identification(
    result: DynamicIdentification, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the record with the model, the residual, and the step response of the dynamics."""
    figure, axes = new_figure(2, 2, 6.0)
    (record, loop), (residual, step) = axes
    t = result.t
    draw_record(result, record, loop, residual, output_label)
    w = result.model.operator.simulate(result.u, result.static.start)
    loop.plot(result.u, w, lw=0.8, color="C1", label="operator alone", rasterized=True)
    loop.set(xlabel=input_label, ylabel=output_label, title="Without the dynamics")
    loop.legend(frameon=False)
    for axis in (record, residual):
        if result.held_out.any():
            axis.axvspan(*t[np.flatnonzero(result.held_out)[[0, -1]]], color="0.92", zorder=0)
    linear, creep = result.model.linear, result.model.creep
    slowest = float(linear.time_constants.max(initial=linear.delay)) or float(t[1] - t[0])
    end = 8 * slowest + linear.delay if creep is None else 3 * float(creep.times.max())
    grid = (
        np.linspace(0, end, _POINTS) if creep is None else np.geomspace(slowest / 50, end, _POINTS)
    )
    rise = linear.step_response(grid)
    if creep is not None:
        rise = creep.simulate(grid, rise, before=0.0)
        step.set_xscale("log")
    step.plot(grid, rise, color="C0")
    step.set(xlabel="time [s]", ylabel="output", title="Step response of the dynamics")
    return figure


def draw_cascade_inversion(result: CascadeInversion) -> Any:
    """Draw targets with outputs, and the input below."""
    figure, (upper, lower) = new_figure(2, 1, 5.0, sharex=True)
    upper.plot(result.t, result.targets, color="0.3", ls="--", lw=1.2, label="target")
    upper.plot(result.t, result.y, color="C0", lw=1.0, label="output of the model")
    upper.set_ylabel("output")
    upper.legend(frameon=False)
    lower.plot(result.t, result.u, color="C1", lw=1.0)
    lower.set(xlabel="time [s]", ylabel="input")
    return figure
