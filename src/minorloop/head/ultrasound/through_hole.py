"""Whether a mouth is open: nothing comes back out of it, at whatever time and in whatever shape."""

from __future__ import annotations

import numpy as np
from scipy.signal.windows import tukey

from minorloop.arrays import FloatArray
from minorloop.head.ultrasound.field import HIGHEST, LOWEST, ComplexArray
from minorloop.head.ultrasound.joint_fit import JointFit, JointSolution
from minorloop.head.ultrasound.spectra import LEAD, TAPER, WINDOW

_TIMES: FloatArray = np.arange(-0.5e-6, 2.3e-6, 0.05e-6)
"""When what is left is looked at, in seconds after the echo of the wall."""
_WIDE = 8
"""How many of these times are one window, whose power is told from that of noise."""
_LATE = 0.19e-6
"""From when on a window is late, in seconds."""
_LATE_SURE, _EARLY_SURE, _EARLY_SHARE = 4.0, 5.0, 1e-3
"""Deviations of noise that a hole does not leave late (50 scans of holes left at most 3.7), nor
early; and the share of what the mouth takes that broken edges may leave early."""


def is_open(fit: JointFit, hole: JointSolution) -> bool:
    """Whether noise is all that a mouth without a floor leaves of the traces.

    Parameters
    ----------
    fit : JointFit
        Of the traces.
    hole : JointSolution
        Its solution with no floor.

    Notes
    -----
    The power of what is left in windows of 0.4 us, each trace weighted by what the mouth takes
    of it. A floor that scatters, or one too uneven to be fitted, sends its sound back late and
    out of shape; a bead or a smooth dimple has the sound of the wall changed, not missing.
    """
    model, (x, y, size) = fit.model, hole.unknowns[:3]
    echoes = model.echo(hole.unknowns)
    fit.cost_of(echoes)
    left = _power(fit, fit.left(echoes))
    taken = np.zeros_like(fit.spectra.heard)
    taken[model.near] = model.missing(model.mouth(x, y, size), size)
    gone = _power(fit, fit.pulse * taken).sum(axis=1)
    share = gone / max(float(gone.max()), 1e-12)
    usual = np.interp(_TIMES, WINDOW * np.linspace(0, 1, 512) - LEAD, tukey(512, TAPER) ** 2)
    # The median of what noise leaves tells its mean, whatever comes out of a few traces at times.
    usual *= np.median(left / usual) / np.log(2)
    excess = _windows(share @ (left - usual))
    samples = (_TIMES[1] - _TIMES[0]) * (HIGHEST - LOWEST)
    sure = excess / np.sqrt(_windows(usual**2) * (share**2).sum() / samples)
    late = _TIMES[: excess.size] > _LATE
    early = (sure > _EARLY_SURE) & (excess > _EARLY_SHARE * float(share @ gone))
    return not (early[~late].any() or (sure[late] > _LATE_SURE).any())


def _windows(values: FloatArray) -> FloatArray:
    return np.convolve(values, np.ones(_WIDE), mode="valid")


def _power(fit: JointFit, spectra: ComplexArray) -> FloatArray:
    """Power (K, times) of spectra over the mean of that of their noise."""
    frequencies = fit.model.sound.wavenumbers * fit.model.ear.speed / (2 * np.pi)
    traces = spectra @ np.exp(-2j * np.pi * frequencies[:, None] * _TIMES)
    power: FloatArray = np.abs(traces) ** 2 / (
        2 * len(frequencies) * fit.spectra.noise[:, None] ** 2
    )
    return power
