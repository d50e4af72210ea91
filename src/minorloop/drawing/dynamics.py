"""Figures of dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure

if TYPE_CHECKING:
    from minorloop.dynamics.cascade import CascadeInversion
    from minorloop.dynamics.creep import CreepFit
    from minorloop.dynamics.linear import Linear

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


def draw_creep_fit(result: CreepFit) -> Any:
    """Draw the record with the fit, and the strengths."""
    figure, (left, right) = new_figure(1, 2)
    left.plot(result.t, result.y, ".", ms=2.5, color="0.6", label="measured", rasterized=True)
    left.plot(result.t, result.prediction, lw=0.9, color="C0", label="model", rasterized=True)
    left.set(xlabel="time [s]", ylabel="output", title="Record")
    left.legend(frameon=False)
    right.stem(result.model.times, result.model.strengths, basefmt="0.6")
    right.set(xlabel="time constant [s]", ylabel="strength", xscale="log", title="Creep")
    return figure
