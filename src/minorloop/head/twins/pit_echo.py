"""Echo of a round pit: waves between rigid walls, down to a floor of any shape and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import jn_zeros, jnp_zeros, jv

from minorloop.arrays import FloatArray
from minorloop.head.twins.pipe import Bore

_RADII, _ANGLES = 22, 64
_STEEPEST = 0.75  # of the wavenumber, across the pit


@dataclass(frozen=True, eq=False)
class PitBasis:
    """Modes of a pit on the points of its cross-section.

    Parameters
    ----------
    places : (Q, 2) array
        Around and along the pipe from the centre, in metres.
    weights : (Q,) array
        Areas, in square metres.
    modes : (Q, M) array of float32
        Orthonormal over the cross-section, with no slope at the wall of the pit.
    across : (M,) array
        Their wavenumbers across the pit, in rad/m.
    floor : (Q,) array
        Depth of the floor beyond that of the pit, in metres.
    depth : float
        Depth of the pit, in metres.
    """

    places: FloatArray
    weights: FloatArray
    modes: npt.NDArray[np.float32]
    across: FloatArray
    floor: FloatArray
    depth: float

    def echo(
        self, pressure: npt.NDArray[np.complex128], wavenumbers: FloatArray
    ) -> npt.NDArray[np.complex128]:
        """Return the sum of 2 p dp/dn over the floor (F,), for pressure (F, Q) on the mouth."""
        k = wavenumbers[:, None]
        down = np.sqrt(k * k - self.across**2 + 0j)
        amplitudes = _times(pressure * self.weights, self.modes) * np.exp(1j * down * self.depth)
        both = _times(np.concatenate([amplitudes, 1j * down * amplitudes]), self.modes.T)
        below, slope = both[: len(k)], both[len(k) :]
        # In single precision, as the modes: the error is 1e-6 of an echo.
        way = (2 * k * self.floor).astype(np.float32)
        shaped = 2 * below * slope * (np.cos(way) + 1j * np.sin(way))
        echo: npt.NDArray[np.complex128] = shaped @ self.weights
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
    area = np.repeat(0.5 * share * r, _ANGLES) * (2 * np.pi / _ANGLES) * mouth**2
    places = mouth * np.stack([rr * np.cos(aa), rr * np.sin(aa)], axis=1)
    modes, across = [], []
    limit = _STEEPEST * wavenumber * mouth
    for m in range(int(limit) + 1):
        for chi in _zeros(m, limit):
            shape = np.repeat(jv(m, chi * r), _ANGLES)
            for wave in (np.cos(m * aa),) if m == 0 else (np.cos(m * aa), np.sin(m * aa)):
                mode = shape * wave
                modes.append(mode / np.sqrt(area @ mode**2))
                across.append(chi / mouth)
    x, y = places.T
    floor = bore.floor_tilt[0] * x + bore.floor_tilt[1] * y - bore.dish * rr**2
    # Depth counts from the wall, which curves towards the axis.
    floor = floor - x**2 / (2 * radius)
    stacked = np.stack(modes, axis=1).astype(np.float32)
    return PitBasis(places, area, stacked, np.array(across), floor, bore.depth)


def _zeros(order: int, limit: float) -> FloatArray:
    """Return the zeros of J' of an order up to a limit, with the uniform mode for order 0."""
    count = int(limit / np.pi) + 2
    found = np.concatenate([[0.0], jn_zeros(1, count)]) if order == 0 else jnp_zeros(order, count)
    return np.asarray(found[found <= limit], dtype=np.float64)


def _times(
    left: npt.NDArray[np.complex128], right: npt.NDArray[np.float32]
) -> npt.NDArray[np.complex128]:
    """Multiply a complex by a real matrix in single precision, each row of ``left`` scaled to 1."""
    scale = np.maximum(np.abs(left).max(axis=1, keepdims=True), 1e-300)
    flat = np.concatenate([left.real / scale, left.imag / scale]).astype(np.float32) @ right
    product = np.empty((len(left), right.shape[1]), dtype=np.complex128)
    product.real, product.imag = scale * flat[: len(left)], scale * flat[len(left) :]
    return product
