"""Echo of a crack: waves between its rigid flanks, down to its floor and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_point, wrapped
from minorloop_head.twins import _echo_kernels as kernels
from minorloop_head.twins.pipe import Crack

_STEP = 0.04e-3
"""Step along a crack in metres: less than half a wavelength in water at 18 MHz, the highest
frequency of the probe."""
_NODES = 14
"""Gauss-Legendre nodes across a crack: the first eight modes are orthonormal on them to 1 %."""
_MODES = 9
"""Modes across a crack: up to 18 MHz, eight of them propagate in a crack of 0.3 mm."""


@dataclass(frozen=True, eq=False)
class CrackBasis:
    """A straightened crack, with modes across it."""

    phi: FloatArray
    z: FloatArray
    """Shape (N,). Its course in even steps, in radians and metres."""
    widths: FloatArray
    """Shape (N,). In metres."""
    points: FloatArray
    """Shape (N, Q, 3). On its mouth, in the pipe, in metres."""
    weights: FloatArray
    """Shape (Q,). Shares of the width."""
    modes: FloatArray
    """Shape (Q, M). Cosines across it, orthonormal over a width of 1."""

    def near(self, phi: float, z: float, radius: float, reach: float) -> npt.NDArray[np.intp]:
        """Return the steps of the course within a distance of a place."""
        off = np.hypot(radius * wrapped(self.phi - phi), self.z - z)
        return np.flatnonzero(off < reach)

    def echo(
        self,
        pressure: npt.NDArray[np.complex128],
        part: npt.NDArray[np.intp],
        wavenumbers: FloatArray,
        *depths: float,
    ) -> npt.NDArray[np.complex128]:
        """Return sums of 2 p dp/dn (D, F) at depths, for pressure (F, P, Q) on part of the mouth.

        Notes
        -----
        Modes cos(m pi x / w) between rigid planes, each a sum of waves along the crack (Morse and
        Ingard, Theoretical Acoustics, 1968, section 9.2). Depth 0 is a wall without the crack.
        """
        local = self.widths[part]
        amplitudes = (pressure * self.weights) @ self.modes * np.sqrt(local)[:, None]
        count = 1 << int(np.ceil(np.log2(4 * len(part) + 64)))
        along = 2 * np.pi * np.fft.fftfreq(count, _STEP)
        across = np.pi * np.arange(self.modes.shape[1]) / float(local.mean())
        waves = np.fft.fft(amplitudes, count, axis=1)
        back = np.roll(waves[:, ::-1], 1, axis=1)
        squares = along**2, across**2, wavenumbers
        echoes = [kernels.crack_echo(waves, back, *squares, depth) for depth in depths]
        return np.asarray(echoes, dtype=np.complex128) * (_STEP / count)


def basis_of_crack(crack: Crack, radius: float) -> CrackBasis:
    """Return points and modes of a crack in a pipe of a radius."""
    corners = np.array(crack.points, dtype=np.float64)
    around = np.unwrap(corners[:, 0])
    steps = np.hypot(radius * np.diff(around), np.diff(corners[:, 1]))
    way = np.concatenate([[0.0], np.cumsum(steps)])
    s = np.arange(0.5 * _STEP, max(way[-1], _STEP), _STEP)
    phi, z, widths = (
        np.interp(s, way, one)
        for one in (around, corners[:, 1], np.array(crack.widths, dtype=np.float64))
    )
    part = np.clip(np.searchsorted(way, s, side="right") - 1, 0, len(steps) - 1)
    heading = np.arctan2(np.diff(corners[:, 1]), radius * np.diff(around))[part]
    nodes, share = np.polynomial.legendre.leggauss(_NODES)
    off = 0.5 * widths[:, None] * nodes
    points = wall_point(
        phi[:, None] - off * np.sin(heading)[:, None] / radius,
        z[:, None] + off * np.cos(heading)[:, None],
        radius,
    )
    order = np.arange(_MODES)
    modes = np.cos(np.pi * order * 0.5 * (nodes[:, None] + 1)) * np.where(order > 0, np.sqrt(2), 1)
    return CrackBasis(phi, z, widths, points, 0.5 * share, modes)
