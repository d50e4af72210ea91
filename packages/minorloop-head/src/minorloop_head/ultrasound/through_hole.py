"""Decide whether a mouth is a through-hole: no echo comes out of it, whatever its time or shape."""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.field import HIGHEST, LOWEST, ComplexArray
from minorloop_head.ultrasound.joint_fit import JointFit, JointSolution
from minorloop_head.ultrasound.spectra import LEAD, WINDOW, tapered

_TIMES: FloatArray = np.arange(-0.5e-6, 2.3e-6, 0.05e-6)
"""Times at which the residual is tested, in seconds after the echo of the wall."""
_WIDE = 8
"""Number of these times in one window, whose power is compared with that of noise."""
_LATE = 0.19e-6
"""Time from which on a window counts as late, in seconds."""
_LATE_SURE, _EARLY_SURE, _EARLY_SHARE = 4.0, 5.0, 1e-3
"""Largest residual of a hole late and early, in deviations of the noise (at most 3.7 late in 50
scans of holes); and the share of the missing echo that chamfered edges may return early."""


def is_through_hole(fit: JointFit, hole: JointSolution) -> bool:
    """Return whether the residual of a mouth without a floor is noise alone.

    Parameters
    ----------
    fit : JointFit
        Of the traces.
    hole : JointSolution
        Its solution without a floor.

    Notes
    -----
    The power of the residual in windows of 0.4 us is compared with that of noise; each trace is
    weighted by the echo that the mouth removes. A floor that scatters, or is too uneven for the
    fit, leaves a late residual; a bead or a smooth dimple changes the early echo of the wall.
    """
    model, (x, y, size) = fit.model, hole.unknowns[:3]
    echoes = model.echo(hole.unknowns)
    fit.cost_of(echoes)
    residual = _power(fit, fit.residual(echoes))
    taken = np.zeros_like(fit.spectra.received)
    taken[model.near] = model.missing(model.mouth(x, y, size), size)
    lost = _power(fit, fit.pulse * taken).sum(axis=1)
    share = lost / max(float(lost.max()), 1e-12)
    usual = np.interp(_TIMES, WINDOW * np.linspace(0, 1, 512) - LEAD, tapered(512) ** 2)
    # The median of the power of noise gives its mean, even if a few traces contain echoes.
    usual *= np.median(residual / usual) / np.log(2)
    excess = _windows(share @ (residual - usual))
    samples = (_TIMES[1] - _TIMES[0]) * (HIGHEST - LOWEST)
    sure = excess / np.sqrt(_windows(usual**2) * (share**2).sum() / samples)
    late = _TIMES[: excess.size] > _LATE
    early = (sure > _EARLY_SURE) & (excess > _EARLY_SHARE * float(share @ lost))
    return not (early[~late].any() or (sure[late] > _LATE_SURE).any())


def _windows(values: FloatArray) -> FloatArray:
    return np.convolve(values, np.ones(_WIDE), mode="valid")


def _power(fit: JointFit, spectra: ComplexArray) -> FloatArray:
    """Return the power (K, times) of spectra over the mean power of their noise."""
    frequencies = fit.model.sound.wavenumbers * fit.model.probe.speed / (2 * np.pi)
    traces = spectra @ np.exp(-2j * np.pi * frequencies[:, None] * _TIMES)
    power: FloatArray = np.abs(traces) ** 2 / (
        2 * len(frequencies) * fit.spectra.noise[:, None] ** 2
    )
    return power
