"""Echoes of a round pit by a finite-difference solution of the wave equation.

Nothing here is imported from the twin or from the estimator's model of a pit. The pit is a rigid
cylinder under a rigid wall. Pressure and velocity are on staggered grids of r and z (Virieux,
Geophysics 51, 889, 1986), for each order of the waves around the axis, so that beams from any side
are solved; layers absorb what leaves (Berenger, J. Comput. Phys. 114, 185, 1994).

The wall is removed from the grid: on the mouth, incident and reflected wave together drive the
water. What the disc receives follows by reciprocity from the velocity in the mouth and the pressure
that the disc itself would cause there.

All spectra are of exp(+i omega t), lengths in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import eval_jacobi

from benchmarks.judge import _wave_kernels as kernels

CELL = 7.5e-6
"""Side of a cell: 13 to a wavelength at 15 MHz, 20 at 10 MHz."""
SHARE = 0.55
"""c dt / dx; stable below 0.577 with the waves around the axis cut off near to it."""
LAYER, MARGIN = 40, 40
"""Cells of the absorbing layer, and between it and the mouth."""
LOWEST, HIGHEST, RESOLUTION = 3e6, 17e6, 0.25e6
"""Of spectra, in Hz: echoes of one pulse last up to 4 us."""
ComplexArray = np.ndarray


def frequencies() -> np.ndarray:
    """Return the frequencies of all spectra."""
    return np.arange(LOWEST, HIGHEST + 1.0, RESOLUTION)


def polynomials(order: int, degree: int, r: np.ndarray) -> np.ndarray:
    """Return radial polynomials (N, len(r)) of an order on the unit disc, of norm 1 (Zernike)."""
    found = []
    for n in range((degree - order) // 2 + 1):
        norm = math.sqrt((2 if order else 1) * (order + 2 * n + 1) / math.pi)
        found.append(norm * r**order * eval_jacobi(n, 0, order, 2 * r * r - 1))
    return np.array(found)


def admittance(
    order: int, radius: float, depth: float, speed: float, degree: int, *, cell: float = CELL
) -> ComplexArray:
    """Return velocities (N, N, F) in a mouth for unit pressures on it, times rho c.

    Parameters
    ----------
    order : int
        Of the waves around the axis.
    radius, depth : float
        Of the pit; a depth of infinity is a pit without a floor.
    speed : float
        Of sound.
    degree : int
        Highest degree of the polynomials on the mouth.
    cell : float
        Side of a cell.
    """
    mouth = round(radius / cell)
    deep = 3 * LAYER if math.isinf(depth) else round(depth / cell)
    wall = LAYER + MARGIN
    rows, columns = wall + deep, mouth + MARGIN + LAYER
    damp_r, damp_z = (
        _damping(columns, 0, LAYER),
        _damping(rows, LAYER, LAYER if math.isinf(depth) else 0),
    )
    r = (np.arange(mouth) + 0.5) / mouth
    shapes = polynomials(order, degree, r) / radius
    # Integrals over the mouth, of a cosine around it.
    weighed = shapes * r * (radius / mouth * radius) * (math.pi if order else 2 * math.pi)
    interval = step_time(cell, speed)
    count = round(1 / (RESOLUTION * interval))
    pulse = _pulse(count, interval)
    f = frequencies()
    t = interval * np.arange(count)
    wave = np.exp(-2j * np.pi * f[:, None] * t)
    out = np.empty((len(shapes), len(shapes), len(f)), dtype=complex)
    velocity = np.empty((count, len(shapes)))
    for n, shape in enumerate(shapes):
        kernels.march(
            order, SHARE, pulse, shape, weighed, wall, mouth, rows, damp_r, damp_z, velocity
        )
        # A velocity is half a step later than the pressure that drives it.
        late = np.exp(-1j * np.pi * f * interval)
        out[:, n] = (wave @ velocity).T * late / (wave @ pulse)
    return out


def step_time(cell: float, speed: float) -> float:
    """Return the time step at which a wave of 10 MHz along the axis has its true speed.

    Waves are slower on a grid: without this, by 0.3 % at 20 cells to a wavelength.
    """
    plain = SHARE * cell / speed
    turn = math.pi * 10e6 * plain
    slower = turn / (SHARE * math.asin(math.sin(turn) / SHARE))
    return plain * slower


def _pulse(count: int, interval: float) -> np.ndarray:
    """Return a short pulse (count,) with all frequencies that are used."""
    t = interval * np.arange(count) - 0.25e-6
    x = (np.pi * 9e6 * t) ** 2
    return (1 - 2 * x) * np.exp(-x)


def _damping(count: int, before: int, after: int) -> np.ndarray:
    """Return factors (2 count,) of a step, at the edges (even) and middles (odd) of cells."""
    place = 0.5 * np.arange(2 * count)
    into = np.zeros(2 * count)
    if before:
        into = np.maximum(into, (before - place) / before)
    if after:
        into = np.maximum(into, (place - (count - after)) / after)
    # A layer of n cells leaves exp(-2/3 n s) of a wave that crosses it twice.
    return np.exp(-SHARE * 0.35 * np.maximum(into, 0.0) ** 2)


@dataclass(frozen=True, eq=False)
class Disc:
    """A disc with a lens: diameter, focal length, and share by which it is weaker at its rim."""

    aperture: float = 5e-3
    focus: float = 8e-3
    soft: float = 0.0


@dataclass(frozen=True, eq=False)
class Field:
    """Pressure and velocity of a disc near the wall, off its axis and along it."""

    table: ComplexArray
    grid: np.ndarray
    k: np.ndarray

    def at(
        self, origin: np.ndarray, axis: np.ndarray, points: np.ndarray, normals: np.ndarray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return pressure and normal velocity (N, F) at points; phases count from ``grid[1]``."""
        pressure, velocity = np.empty((2, len(points), len(self.k)), dtype=complex)
        step = float(self.k[1] - self.k[0])
        kernels.field_at(
            self.table, self.grid, float(self.k[0]), step, origin, axis, points, normals,
            pressure, velocity,
        )  # fmt: skip
        return pressure, velocity


@lru_cache(maxsize=4)
def field_of(
    disc: Disc,
    speed: float,
    near: float,
    far: float,
    reach: float,
    steps: tuple[float, float] = (0.016e-3, 0.06e-3),
) -> Field:
    """Return the field of a disc by the Rayleigh integral, from ``near`` to ``far``."""
    k = 2 * np.pi * frequencies() / speed
    nodes, weights = np.polynomial.legendre.leggauss(40)
    rings = 0.25 * disc.aperture * (nodes + 1)
    strength = 1 - disc.soft * (2 * rings / disc.aperture) ** 4
    areas = 2 * np.pi * rings * 0.25 * disc.aperture * weights * strength
    lags = np.zeros_like(rings)
    if math.isfinite(disc.focus):
        lags = disc.focus - np.hypot(disc.focus, rings)
    off, along = np.arange(0.0, reach, steps[0]), np.arange(near, far, steps[1])
    count = 24 + int(k[-1] * reach * disc.aperture / 2 / near / 2)
    cosines = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    table = np.zeros((len(off), len(along), 3, len(k)), dtype=complex)
    kernels.disc_field(
        off, along, rings, areas, lags, cosines, float(k[0]), float(k[1] - k[0]), len(k), table
    )
    return Field(table, np.array([off[1], along[0], along[1] - along[0]]), k)
