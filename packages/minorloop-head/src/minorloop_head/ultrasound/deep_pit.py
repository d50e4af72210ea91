"""Detect a floor deeper than is measured, by an echo after the window of the fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.joint_fit import JointFit
from minorloop_head.ultrasound.spectra import LEAD, WINDOW, spectra_of

DEEPER_DEPTHS: FloatArray = np.arange(1.26e-3, 1.6e-3, 0.01e-3)
"""Depths in metres that are not measured, but whose echoes lie in the window of the fit."""
DETECTED, ABSENT, UNDECIDED = "detected", "absent", "undecided"
_WINDOWS = ((1.6e-6, 1.3e-3, 2.7e-3), (3.2e-6, 2.6e-3, 4.1e-3))
"""Start of each later window, in seconds after the usual one, and its range of depths in metres."""
_STEP = 0.01e-3
_SURE, _GAIN = 25.0, 0.15
"""A floor is detected from this cost over the noise and this gain of a flat floor on. By noise
alone, the best of some 280 depths reaches a cost of about 6."""
_USUAL_GAIN, _COULD = 0.5, 15.0
"""Gain of a poor floor, and the cost that it must return, for its absence to be certain."""


def last_window_end(thickness: float) -> float:
    """Return the end of the last window, in seconds after the echo of the wall."""
    needed = [after for after, low, _ in _WINDOWS if low < thickness]
    return max(needed, default=0.0) + WINDOW - LEAD


def detect_deep_floor(fit: JointFit, unknowns: FloatArray, bursts: Sequence[Burst]) -> str:
    """Look for a floor between the greatest measured depth and the thickness of the wall.

    Parameters
    ----------
    fit : JointFit
        Of the same bursts.
    unknowns : (8,) array
        Of its solution; only the outline is used.
    bursts : sequence of Burst
        Usable ones.

    Returns
    -------
    str
        ``detected``; ``absent``; or ``undecided``, where the traces end too early, or noise would
        hide a floor that returns half of what a flat one does.

    Notes
    -----
    At each depth, the gain of a flat floor by least squares over all traces near the mouth is
    compared with the noise.
    """
    model, probe = fit.model, fit.model.probe
    latest = float(model.spots[:, 2].max()) * 2 / probe.speed + last_window_end(probe.thickness)
    if min(burst.trace.size * burst.sample_interval for burst in bursts) < latest:
        return UNDECIDED
    verdict = ABSENT
    for after, low, high in _WINDOWS:
        depths = np.arange(low, min(high, probe.thickness), _STEP)
        if depths.size == 0:
            continue
        gains, power = _gains(fit, unknowns, bursts, depths, after)
        if bool(((gains > _GAIN) & (0.5 * gains**2 * power > _SURE)).any()):
            return DETECTED
        if 0.5 * _USUAL_GAIN**2 * float(power.min()) < _COULD:
            verdict = UNDECIDED
    return verdict


def _gains(
    fit: JointFit, unknowns: FloatArray, bursts: Sequence[Burst], depths: FloatArray, after: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gain (D,) of a floor at each depth, and the power (D,) of a flat one."""
    model, (x, y, size) = fit.model, unknowns[:3]
    spectra = spectra_of(bursts, model.probe, model.centre, after=after)
    if spectra is None:
        return np.zeros(depths.size), np.zeros(depths.size)
    near = model.near
    squares = model.squares(model.mouth(x, y, size), size, (0.0, 0.0), 0.0)
    pulse = fit.pulse * np.exp(2j * model.sound.wavenumbers * fit.shift[near, None])
    expected = pulse * model.floors(squares, size, depths)
    weight = 1 / spectra.noise[near, None] ** 2
    common = (np.conj(expected) * spectra.received[near] * weight).real.sum(axis=(1, 2))
    power: FloatArray = (np.abs(expected) ** 2 * weight).sum(axis=(1, 2))
    return common / np.maximum(power, 1e-12), power
