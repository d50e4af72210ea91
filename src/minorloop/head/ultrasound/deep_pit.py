"""Whether a floor lies deeper than depths are measured: later than the window of the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.ultrasound.echoes import Burst
from minorloop.head.ultrasound.joint_fit import JointFit
from minorloop.head.ultrasound.spectra import LEAD, WINDOW, spectra_of

FURTHER: FloatArray = np.arange(1.26e-3, 1.6e-3, 0.01e-3)
"""Depths beyond those that are measured, in metres, of which the window of the fit still tells."""
HEARD, SILENT, UNTOLD = "heard", "silent", "untold"
_WINDOWS = ((1.6e-6, 1.3e-3, 2.7e-3), (3.2e-6, 2.6e-3, 4.1e-3))
"""When a window is cut, in seconds after the usual one, and the depths told in it, in metres."""
_STEP = 0.01e-3
_SURE, _GAIN = 25.0, 0.15
_USUAL_GAIN, _COULD = 0.5, 15.0


def last_heard(ear_thickness: float) -> float:
    """When the last window ends that a wall of a thickness needs, in seconds after its echo."""
    needed = [after for after, low, _ in _WINDOWS if low < ear_thickness]
    return max(needed, default=0.0) + WINDOW - LEAD


def deep_floor(fit: JointFit, unknowns: FloatArray, bursts: Sequence[Burst]) -> str:
    """Whether a floor between the depths that are measured and the thickness of the wall is heard.

    Parameters
    ----------
    fit : JointFit
        Of the same bursts.
    unknowns : (8,) array
        Of its solution; the outline counts.
    bursts : sequence of Burst
        Usable ones.

    Returns
    -------
    str
        ``heard``; ``silent``; or ``untold``, where the traces end too early, or a floor that
        returns half of what a flat one does would not stand out of the noise.

    Notes
    -----
    The gain of a flat floor at each depth by least squares over all traces near the mouth, and
    what it explains of them over the noise.
    """
    model, ear = fit.model, fit.model.ear
    latest = float(model.spots[:, 2].max()) * 2 / ear.speed + last_heard(ear.thickness)
    if min(burst.trace.size * burst.sample_interval for burst in bursts) < latest:
        return UNTOLD
    told = SILENT
    for after, low, high in _WINDOWS:
        depths = np.arange(low, min(high, ear.thickness), _STEP)
        if depths.size == 0:
            continue
        gains, power = _gains(fit, unknowns, bursts, depths, after)
        if bool(((gains > _GAIN) & (0.5 * gains**2 * power > _SURE)).any()):
            return HEARD
        if 0.5 * _USUAL_GAIN**2 * float(power.min()) < _COULD:
            told = UNTOLD
    return told


def _gains(
    fit: JointFit,
    unknowns: FloatArray,
    bursts: Sequence[Burst],
    depths: FloatArray,
    after: float,
) -> tuple[FloatArray, FloatArray]:
    """Gains (D,) of a floor at each depth, and power (D,) of a flat one over the noise."""
    model, (x, y, size) = fit.model, unknowns[:3]
    spectra = spectra_of(bursts, model.ear, model.centre, after=after)
    if spectra is None:
        return np.zeros(depths.size), np.zeros(depths.size)
    near = model.near
    squares = model.squares(model.mouth(x, y, size), size, (0.0, 0.0), 0.0)
    pulse = fit.pulse * np.exp(2j * model.sound.wavenumbers * fit.shift[near, None])
    expected = pulse * model.floors(squares, size, depths)
    weight = 1 / spectra.noise[near, None] ** 2
    common = (np.conj(expected) * spectra.heard[near] * weight).real.sum(axis=(1, 2))
    power: FloatArray = (np.abs(expected) ** 2 * weight).sum(axis=(1, 2))
    return common / np.maximum(power, 1e-12), power
