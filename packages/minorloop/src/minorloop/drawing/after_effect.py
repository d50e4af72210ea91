"""Figures of operators with after-effect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.dynamics import draw_record
from minorloop.drawing.layout import new_figure

if TYPE_CHECKING:
    from minorloop.identification.after_effect_result import AfterEffectIdentification
    from minorloop.operators.after_effect import AfterEffect

_POINTS = 200
"""Points of a curve, by trial."""


def draw_after_effect(
    model: AfterEffect, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the settled loop, and the output while the input is held on the way down."""
    figure, (loop, holds) = new_figure(1, 2, 3.4)
    low, high = model.plane.levels[0], model.plane.levels[-1]
    u = np.concatenate([np.linspace(low, high, _POINTS), np.linspace(high, low, _POINTS)])
    loop.plot(u, model.settled.simulate(u), color="C0", lw=1.0)
    loop.set(xlabel=input_label, ylabel=output_label, title="Settled")
    slowest = max([model.settling, *model.times]) or 1.0
    t = np.geomspace(1e-3 * slowest, 10 * slowest, _POINTS)
    # Inputs of the holds that are drawn, as shares of the way down from the highest level
    for share in (0.25, 0.5, 0.75):
        value = high - share * (high - low)
        y = model.simulate(t, np.full(t.size, value), "positive")
        holds.semilogx(t, y - y[-1], label=f"held at {value:.3g}")
    holds.set(xlabel="time [s]", ylabel=f"{output_label}, less the last", title="Holds")
    holds.legend(frameon=False)
    return figure


def draw_after_effect_identification(
    result: AfterEffectIdentification, *, input_label: str = "input", output_label: str = "output"
) -> Any:
    """Draw the record with the model, the residual, and the errors of the laws compared."""
    figure, axes = new_figure(2, 2, 6.0)
    (record, loop), (residual, laws) = axes
    draw_record(result, record, loop, residual, output_label)
    loop.plot(result.u, result.prediction, ".", ms=1.0, color="C0", label="model", rasterized=True)
    loop.set(xlabel=input_label, ylabel=output_label, title="Loop")
    names = [one.law for one in result.tried]
    laws.bar(names, [100 * one.error for one in result.tried], color="C0")
    laws.set(ylabel="error on rows left out [% of range]", title="Laws")
    return figure
