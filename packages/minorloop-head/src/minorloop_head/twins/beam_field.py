"""The pressure in front of a disc with or without a lens, by Hankel transforms.

In homogeneous water the beam is symmetric about its axis, so that a table over the distances off
and along the axis, for each frequency, contains it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.special import j0

from minorloop.arrays import FloatArray
from minorloop.threads import one_thread

_Complex32 = npt.NDArray[np.complex64]

_OFF_STEP = 0.012e-3  # m
_ALONG_STEP = 0.05e-3  # m, without the carrier
_RINGS = 100
"""Quadrature points on the disc: the phase varies by 100 rad across it, and 80 give the table to
rounding."""


@dataclass(frozen=True, eq=False)
class Beam:
    """Pressure p = table * exp(i k z) of a disc with unit pressure."""

    table: _Complex32
    """Shape (N, M, F). Over distance off the axis, along it, and frequency."""
    grid: FloatArray
    """Shape (3,). Step off the axis, first distance along it, and step along it, in metres."""
    wavenumbers: FloatArray
    """Shape (F,). Even, in rad/m."""


def beam_of(
    aperture: float, focus: float, wavenumbers: FloatArray, *, near: float, far: float, off: float
) -> Beam:
    """Compute the beam of a disc by its angular spectrum.

    ``aperture``: diameter, in metres. ``focus``: focal length of the lens, in metres; infinite
    without. ``wavenumbers`` (F,): even, in rad/m. ``near``, ``far``, ``off``: distances along and
    off the axis that the table covers, in metres.

    Notes
    -----
    The Hankel transform of the pressure on the aperture, propagated by
    exp(i z sqrt(k^2 - kappa^2)) and transformed back (Goodman, Introduction to Fourier Optics,
    2005, section 3.10). Waves steeper than the edge of the lens plus a margin are left out.
    """
    return _beam_of(aperture, focus, tuple(wavenumbers.tolist()), near, far, off)


@lru_cache(maxsize=3)
@one_thread()
def _beam_of(
    aperture: float,
    focus: float,
    wavenumbers: tuple[float, ...],
    near: float,
    far: float,
    off: float,
) -> Beam:
    rho = np.arange(0.0, off + 2 * _OFF_STEP, _OFF_STEP)
    along = np.arange(near, far + 2 * _ALONG_STEP, _ALONG_STEP)
    nodes, weights = np.polynomial.legendre.leggauss(_RINGS)
    ring = 0.25 * aperture * (nodes + 1)
    ring_weights = 0.25 * aperture * weights * ring
    lag = np.zeros_like(ring) if np.isinf(focus) else np.hypot(focus, ring) - focus
    steep = min(0.5 * aperture / min(focus, near) + 0.3, 0.85)
    # Enough nodes for the edge of the disc, that of the table, and the slant of the steepest wave.
    span = 0.5 * aperture + rho[-1] + along[-1] * steep / np.sqrt(1 - steep**2)
    slants, slant_weights = np.polynomial.legendre.leggauss(
        int(np.ceil(wavenumbers[-1] * steep * span / np.pi)) + 40
    )
    table = np.empty((len(rho), len(along), len(wavenumbers)), dtype=np.complex64)
    for n, k in enumerate(wavenumbers):
        kappa = 0.5 * k * steep * (slants + 1)
        spectrum = (j0(kappa[:, None] * ring) * ring_weights) @ np.exp(-1j * k * lag)
        spectrum *= 0.5 * k * steep * slant_weights * kappa
        slow = np.sqrt(k * k - kappa**2) - k
        carried = (spectrum[:, None] * np.exp(1j * slow[:, None] * along)).astype(np.complex64)
        back = j0(rho[:, None] * kappa).astype(np.float32)
        table[..., n] = back @ carried.real + 1j * (back @ carried.imag)
    grid = np.array([_OFF_STEP, near, _ALONG_STEP])
    return Beam(table, grid, np.asarray(wavenumbers, dtype=np.float64))
