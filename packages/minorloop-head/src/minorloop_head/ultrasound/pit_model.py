"""Echoes of a wall with a round pit, for the fit of its depth.

Spectra do not contain the pulse; their phases count from where each beam meets the wall.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wrapped
from minorloop_head.ultrasound import _field_kernels as kernels
from minorloop_head.ultrasound.field import (
    CalibratedProbe,
    ComplexArray,
    SoundField,
    as_complex,
    sound_field,
)
from minorloop_head.ultrasound.wall_shape import WallShape

NAMES = ("around", "along", "size", "depth", "gain", "tilt around", "tilt along", "dish")
"""Names of the unknowns; units: metres from the guess, ln(radius / guess), m, 1, slopes, m."""
_RADII, _ANGLES = 9, 28  # quadrature points
_STEEPEST = 0.44  # of the wavenumber, across the pit
_BACK = 0.12 * 0.7
"""Echo of the outer face of the wall over that of the wall: transmission both ways, and loss."""


@dataclass(frozen=True, eq=False)
class _UnitDisc:
    """Modes of a rigid cylinder on quadrature points of the unit disc."""

    places: FloatArray
    """Shape (Q, 2). Points, ring by ring."""
    weights: FloatArray
    """Shape (Q,). Areas."""
    waves: npt.NDArray[np.float32]
    """Shape (angles, W). Cosines and sines around a ring."""
    odd: npt.NDArray[np.int64]
    """Shape (W,). 1 for a sine, 0 for a cosine."""
    radial: FloatArray
    """Shape (M, rings). The modes along a radius times the areas, orthonormal."""
    wave: npt.NDArray[np.int64]
    """Shape (M,). Index of the wave of each mode."""
    across: FloatArray
    """Shape (M,). Zeros of the derivative of the Bessel functions."""


@lru_cache(maxsize=4)
def unit_disc(limit: float) -> _UnitDisc:
    """Return the modes up to a limit of chi."""
    from scipy.special import jn_zeros, jnp_zeros, jv  # steering a probe does not need it

    nodes, share = np.polynomial.legendre.leggauss(_RADII)
    radii = 0.5 * (nodes + 1)
    turn = 2 * np.pi * np.arange(_ANGLES) / _ANGLES
    areas = 0.5 * share * radii * 2 * np.pi / _ANGLES
    waves: list[FloatArray] = []
    radial, wave, across = [], [], []
    for order in range(min(int(limit), _ANGLES // 2 - 1) + 1):
        count = int(limit / np.pi) + 2
        zeros = [0.0, *jn_zeros(1, count)] if order == 0 else jnp_zeros(order, count)
        for shape in (np.cos, np.sin)[: 1 if order == 0 else 2]:
            waves.append(shape(order * turn))
            for chi in [chi for chi in zeros if chi <= limit]:
                mode = jv(order, chi * radii)
                power = (areas @ mode**2) * (waves[-1] @ waves[-1])
                radial.append(areas * mode / np.sqrt(power))
                wave.append(len(waves) - 1)
                across.append(chi)
    r, a = (g.ravel() for g in np.meshgrid(radii, turn, indexing="ij"))
    return _UnitDisc(
        np.stack([r * np.cos(a), r * np.sin(a)], axis=1),
        np.repeat(areas, _ANGLES),
        np.stack(waves, axis=1).astype(np.float32),
        np.array([0, *(n % 2 for n in range(len(waves) - 1))]),
        np.array(radial),
        np.array(wave),
        np.array(across),
    )


@dataclass(eq=False)
class PitModel:
    """Echoes of K beams from a wall with a pit."""

    probe: CalibratedProbe
    """The calibrated probe."""
    angles: FloatArray
    """Shape (K, 2). Pan and tilt of the beams, in radians."""
    centre: tuple[float, float]
    """First guess of the centre of the pit, phi and z."""
    radius: float
    """First guess of the radius of its mouth, in metres."""
    beyond: FloatArray | None = None
    """Shape (K,). Distances behind the nominal wall, along the beams, from which phases count;
    zeros without it."""
    shape: WallShape | None = None
    """Shape of a bent wall about the centre. The pit begins at the plane through its rim."""
    sound: SoundField = field(init=False)
    plain: ComplexArray = field(init=False)
    facing: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.sound = sound_field(self.probe)
        self._origins, self._axes = self.probe.beams(self.angles)
        self.spots = self.probe.spots(self.angles)
        normals = np.stack([np.cos(self.spots[:, 0]), np.sin(self.spots[:, 0])], axis=1)
        self.facing = (self._axes[:, :2] * normals).sum(axis=1)
        self._starts = self.spots[:, 2] + (0.0 if self.beyond is None else self.beyond)
        self.plain = self.sound.wall(
            self._origins,
            self._axes,
            self._starts,
            self.spots[:, :2].copy(),
            self.probe.radius,
            None if self.shape is None else self._sunk,
        )
        k = self.sound.wavenumbers
        # Farther traces receive nothing from the pit.
        near = self.radius * 1.15 + self.sound.reach / 2
        self.near = np.flatnonzero(np.linalg.norm(self.off(), axis=1) < near)
        self._disc = unit_disc(round(_STEEPEST * float(k[-1]) * self.radius * 1.15, 0))
        self._lid = np.zeros(len(self._disc.places))
        if self.shape is not None:
            places = self.radius * self._disc.places
            middle, *slopes = self.shape.rim(0.0, 0.0, self.radius)[0]
            self._lid = middle + places @ np.array(slopes) - self.shape.depth(places)

    def _sunk(self, places: FloatArray) -> FloatArray:
        """Return the distance of the wall behind the nominal one at places (..., 2), phi and z."""
        assert self.shape is not None
        around = self.probe.radius * wrapped(places[..., 0] - self.centre[0])
        return self.shape.depth(np.stack([around, places[..., 1] - self.centre[1]], axis=-1))

    def off(self) -> FloatArray:
        """Return (K, 2) offsets of the spots from the first guess of the centre, in metres."""
        around = wrapped(self.spots[:, 0] - self.centre[0])
        return np.stack([self.probe.radius * around, self.spots[:, 1] - self.centre[1]], axis=1)

    def mouth(self, around: float, along: float, size: float) -> FloatArray:
        """Return the pressure (N, Q, 2, F) on the mouth, of the N beams near it."""
        a = self.radius * np.exp(size)
        x = around + a * self._disc.places[:, 0]
        z = self.centre[1] + along + a * self._disc.places[:, 1]
        phi = self.centre[0] + x / self.probe.radius
        sunk = 0.0 if self.shape is None else self._sunk(np.stack([phi, z], axis=1))
        r = self.probe.radius + sunk
        points = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1)
        near = self.near
        return self.sound.at(self._origins[near], self._axes[near], self._starts[near], points)

    def missing(self, pressure: FloatArray, size: float) -> ComplexArray:
        """Return the part (N, F) of the echo of the wall that the mouth removes."""
        area = (self.radius * np.exp(size)) ** 2 * self._disc.weights
        lost = np.zeros((len(pressure), *pressure.shape[2:]))
        kernels.square_sum(pressure, area, lost)
        return 2j * self.sound.wavenumbers * as_complex(lost)

    def squares(
        self, pressure: FloatArray, size: float, tilt: tuple[float, float], dish: float
    ) -> FloatArray:
        """Return squares (N, M, 2, F) of the amplitudes of the modes, with the floor's shape."""
        a = self.radius * np.exp(size)
        x, y = a * self._disc.places.T
        shape = tilt[0] * x + tilt[1] * y + dish * (1 - 2 * (x * x + y * y) / a**2) + self._lid
        disc, sound = self._disc, self.sound
        out = np.empty((len(pressure), disc.across.size, *pressure.shape[2:]))
        kernels.mode_squares(
            pressure, shape, a, disc.waves[: _ANGLES // 2 + 1], disc.odd, disc.radial,
            disc.wave, sound.first, sound.step, out,
        )  # fmt: skip
        return out

    def floors(self, squares: FloatArray, size: float, depths: FloatArray) -> ComplexArray:
        """Return echoes (D, N, F) of a floor at evenly spaced depths, with ringing steel."""
        step = float(depths[1] - depths[0]) if len(depths) > 1 else 0.0
        across = self._disc.across / (self.radius * np.exp(size))
        out = np.zeros((len(depths), len(squares), *squares.shape[2:]))
        kernels.floors(
            squares, across, float(depths[0]), step, self.sound.first, self.sound.step, out
        )
        ringing = np.array([self._ringing(float(depth)) for depth in depths])
        echoes: ComplexArray = as_complex(out) * ringing[:, None, :]
        return echoes

    def with_pit(self, missing: ComplexArray, floor: ComplexArray) -> ComplexArray:
        """Return echoes (K, F) of the wall without its part over the mouth, plus a floor."""
        whole = self.plain.copy()
        whole[self.near] += floor - missing
        return whole

    def echo(self, unknowns: FloatArray) -> ComplexArray:
        """Return echoes (K, F) for the unknowns in the order of ``NAMES``."""
        return self.with_pit(*self._parts(unknowns))

    def _parts(self, unknowns: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        x, y, size, depth, gain, u, v, dish = unknowns
        pressure = self.mouth(x, y, size)
        floor = self._floor(self.squares(pressure, size, (u, v), dish), size, depth)
        return self.missing(pressure, size), gain * floor

    def slopes(self, unknowns: FloatArray, steps: FloatArray) -> ComplexArray:
        """Return derivatives (8, N, F) of the near echoes by finite differences."""
        x, y, size, depth, gain, u, v, dish = unknowns
        pressure = self.mouth(x, y, size)
        squares = self.squares(pressure, size, (u, v), dish)
        floor = self._floor(squares, size, depth)
        missing = self.missing(pressure, size)
        moves = np.diag(steps)
        columns = []
        for n in range(3):
            less, more = self._parts(unknowns + moves[n])
            columns.append((more - less - gain * floor + missing) / steps[n])
        deeper = self._floor(squares, size, depth + steps[3])
        columns += [gain * (deeper - floor) / steps[3], floor]
        for n in range(5, 8):
            a, b, c = unknowns[5:] + moves[n, 5:]
            shaped = self._floor(self.squares(pressure, size, (a, b), c), size, depth)
            columns.append(gain * (shaped - floor) / steps[n])
        return np.stack(columns)

    def _floor(self, squares: FloatArray, size: float, depth: float) -> ComplexArray:
        floor: ComplexArray = self.floors(squares, size, np.array([depth], dtype=np.float64))[0]
        return floor

    def _ringing(self, depth: float) -> ComplexArray:
        """Return the ringing of the steel under a floor over that of the wall in the pulse."""
        f = self.sound.wavenumbers * self.probe.speed
        t = self.probe.thickness
        turn = np.exp(2j * f * np.array([max(t - depth, 0.1e-3), t])[:, None] / self.probe.steel)
        ratio: ComplexArray = (1 - _BACK * turn[0]) / (1 - _BACK * turn[1])
        return ratio
