"""Echoes of a round pit and of a crack: waves between rigid walls, down to a floor and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.special import jn_zeros, jnp_zeros, jv

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_point, wrapped
from minorloop_head.twins import _echo_kernels as kernels
from minorloop_head.twins.pipe import Bore, Crack

_STEP = 0.04e-3
"""Step along a crack in metres: less than half a wavelength in water at 18 MHz, the highest
frequency of the probe."""
_NODES = 14
"""Gauss-Legendre nodes across a crack: the first eight modes are orthonormal on them to 1 %."""
_MODES = 9
"""Modes across a crack: up to 18 MHz, eight of them propagate in a crack of 0.3 mm."""
_RADII, _ANGLES = 22, 64
"""Gauss-Legendre nodes along the radius, and angles: up to 18 MHz, the modes of a pit of 1 mm are
orthonormal on them to 1e-7, those of a pit of 1.5 mm to 1e-5 up to 13 MHz."""
_STEEPEST = 0.75  # of the wavenumber, across the pit
_FAINTEST = -40.0  # exponent of a wave that has decayed


@dataclass(frozen=True, eq=False)
class PitBasis:
    """Modes of a pit on the points of its cross-section, ring by ring.

    A mode is one of W waves around the pit times a shape along the radius. There are up to N
    shapes for a wave; shapes that do not exist are zero.
    """

    places: FloatArray
    """Shape (Q, 2). Around and along the pipe from the centre, in metres."""
    weights: FloatArray
    """Shape (Q,). Areas, in square metres."""
    waves: npt.NDArray[np.float32]
    """Shape (angles, W). Cosines and sines."""
    radial: npt.NDArray[np.float32]
    """Shape (W, rings, N). Shapes, which make the modes orthonormal over the cross-section, with no
    slope at the wall of the pit."""
    across: FloatArray
    """Shape (W, 1, N). Wavenumbers across the pit, in rad/m."""
    floor: FloatArray
    """Shape (Q,). Depth of the floor beyond that of the pit, in metres."""
    depth: float
    """Depth of the pit, in metres."""

    @property
    def modes(self) -> FloatArray:
        """(Q, M) array of the modes."""
        shapes = np.einsum("aw,wrn->rawn", self.waves, self.radial)
        modes: FloatArray = shapes.reshape(len(self.places), -1)
        return modes[:, np.any(modes != 0, axis=0)]

    def echo(
        self, pressure: npt.NDArray[np.complex128], wavenumbers: FloatArray
    ) -> npt.NDArray[np.complex128]:
        """Return the sum of 2 p dp/dn over the floor (F,), for pressure (F, Q) on the mouth.

        In single precision, with an error of 1e-6 of an echo.
        """
        k, count = wavenumbers[:, None], len(wavenumbers)
        down, carried = _carried(self, tuple(wavenumbers.tolist()))
        parts = _parts(pressure * self.weights).reshape(-1, len(self.waves)) @ self.waves
        rings = parts.reshape(2 * count, -1, parts.shape[1]).transpose(2, 0, 1)
        found = rings @ self.radial  # (W, 2 F, N)
        amplitudes = (found[:, :count] + 1j * found[:, count:]) * carried
        both = _parts(np.concatenate([amplitudes, down * amplitudes], axis=1), axis=1)
        rings = both @ self.radial.transpose(0, 2, 1)  # (W, 4 F, rings)
        parts = rings.transpose(1, 2, 0).reshape(-1, len(rings)) @ self.waves.T
        (a, b), (c, d) = parts.reshape(2, 2, count, -1)  # a + ic is the pressure, b + id its slope
        way = (2 * k * self.floor).astype(np.float32)
        real, imaginary, cosine, sine = a * b - c * d, a * d + b * c, np.cos(way), np.sin(way)
        echo: npt.NDArray[np.complex128] = 2 * (
            (real * cosine - imaginary * sine) @ self.weights
            + 1j * ((real * sine + imaginary * cosine) @ self.weights)
        )
        return echo


def basis_of(bore: Bore, radius: float, wavenumber: float) -> PitBasis:
    """Return the modes of a pit in a pipe of a radius, up to a wavenumber in rad/m.

    Notes
    -----
    J_m(chi r / a) cos and sin m phi with chi the zeros of J_m' (Morse and Ingard, Theoretical
    Acoustics, 1968, section 9.2).
    """
    mouth = bore.diameter / 2
    nodes, share = np.polynomial.legendre.leggauss(_RADII)
    r = 0.5 * (nodes + 1)
    angle = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    rr, aa = (grid.ravel() for grid in np.meshgrid(r, angle, indexing="ij"))
    ring = 0.5 * share * r * (2 * np.pi / _ANGLES) * mouth**2
    places = mouth * np.stack([rr * np.cos(aa), rr * np.sin(aa)], axis=1)
    limit = _STEEPEST * wavenumber * mouth
    zeros = [_zeros(m, limit) for m in range(int(limit) + 1)]
    orders = [m for m, found in enumerate(zeros) if found.size for _ in range(1 if m == 0 else 2)]
    waves = np.stack(
        [(np.sin if orders[:w].count(m) else np.cos)(m * angle) for w, m in enumerate(orders)],
        axis=1,
    )
    radial = np.zeros((len(orders), _RADII, max(found.size for found in zeros)))
    across = np.zeros((len(orders), 1, radial.shape[2]))
    for w, m in enumerate(orders):
        shapes = jv(m, zeros[m] * r[:, None])
        power = (ring @ shapes**2) * (waves[:, w] @ waves[:, w])
        radial[w, :, : zeros[m].size] = shapes / np.sqrt(power)
        across[w, 0, : zeros[m].size] = zeros[m] / mouth
    x, y = places.T
    floor = bore.floor_tilt[0] * x + bore.floor_tilt[1] * y - bore.dish * rr**2
    # Depth counts from the wall, which curves towards the axis.
    floor = floor - x**2 / (2 * radius)
    return PitBasis(
        places,
        np.repeat(ring, _ANGLES),
        waves.astype(np.float32),
        radial.astype(np.float32),
        across,
        floor,
        bore.depth,
    )


@lru_cache(maxsize=4)
def _carried(
    basis: PitBasis, wavenumbers: tuple[float, ...]
) -> tuple[npt.NDArray[np.complex128], npt.NDArray[np.complex128]]:
    """Return wavenumbers along the pit, times i, and amplitudes at its floor: (W, F, N) each."""
    k = np.array(wavenumbers)[:, None]
    down = 1j * np.sqrt(k * k - basis.across**2 + 0j)
    way = down * basis.depth
    return down, np.where(way.real > _FAINTEST, np.exp(way), 0.0)


def _zeros(order: int, limit: float) -> FloatArray:
    """Return the zeros of J' of an order up to a limit, with the uniform mode for order 0."""
    count = int(limit / np.pi) + 2
    found = np.concatenate([[0.0], jn_zeros(1, count)]) if order == 0 else jnp_zeros(order, count)
    return np.asarray(found[found <= limit], dtype=np.float64)


def _parts(values: npt.NDArray[np.complex128], axis: int = 0) -> npt.NDArray[np.float32]:
    """Return real parts and then imaginary parts along an axis, in single precision."""
    return np.concatenate([values.real, values.imag], axis=axis, dtype=np.float32)


@dataclass(frozen=True, eq=False)
class CrackBasis:
    """A straightened crack, with modes across it."""

    phi: FloatArray
    z: FloatArray
    """Shape (N,). Its course in even steps, in radians and metres."""
    widths: FloatArray
    """Shape (N,). Widths in metres."""
    points: FloatArray
    """Shape (N, Q, 3). Points on its mouth, in the pipe, in metres."""
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
