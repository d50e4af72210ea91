"""Figures of oscillators with hysteresis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.drawing.layout import new_figure

if TYPE_CHECKING:
    from minorloop.identification.oscillator_result import OscillatorIdentification


def draw_oscillator_identification(found: OscillatorIdentification, **labels: str) -> Any:
    """Draw displacement and residual against time, and the loops of the hysteretic force.

    Its axes are force and displacement, whatever the ``labels`` of input and output are.
    """
    figure, (left, right) = new_figure(1, 2, height=3.8, width_ratios=[2, 1])
    record = found.motion
    t = np.arange(record.y.size) * record.interval
    miss = 1e3 * found.minimum.residuals
    left.plot(t, 1e3 * record.y, color="0.6", lw=0.8, label="displacement")
    left.plot(t[record.scored], miss, color="C3", lw=0.8, label="model - record")
    left.set(xlabel="time [s]", ylabel="displacement [mm]")
    left.legend(frameon=False, fontsize=9)
    y = record.filled
    right.plot(1e3 * y, found.model.operator.simulate(y, "relaxed"), color="C0", lw=0.5)
    right.set(xlabel="displacement [mm]", ylabel="hysteretic force [N]")
    return figure
