"""The calibrated probe and its sound field on the wall."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.geometry import Mount, Probe, meet_wall
from minorloop_head.ultrasound import _field_kernels as kernels

LOWEST, HIGHEST = 5e6, 15e6  # Hz, the band of a pulse of 10 MHz and 60 %, with its flanks
RESOLUTION = 0.3125e6
"""Frequency step of compared spectra, in Hz: one over the window of 3.2 us."""
_FACET = 0.06e-3
"""Step of the integral over the wall, in metres: less than half a wavelength at 10 MHz."""

ComplexArray = npt.NDArray[np.complex128]

_SUNK = 1e-3
"""Largest distance in metres of a wall behind the nominal one at which the field is known: that of
the deepest dent whose flanks return echoes, 0.7 mm, and the slant of a beam."""


@dataclass(frozen=True)
class CalibratedProbe:
    """A calibrated probe in a pipe of known radius.

    Raises a `ParameterError` if a size is not positive, the face of the probe is not inside the
    pipe, or the temperature is out of range.
    """

    transducer: Probe
    """Its calibrated geometry."""
    mount: Mount
    """Estimated place of the head in the pipe."""
    radius: float = 10e-3
    thickness: float = 2e-3
    """Radius of the pipe and thickness of its wall, in metres."""
    temperature: float = 20.0
    """Measured temperature of the water, in degrees Celsius."""
    steel: float = 5900.0
    """Speed of longitudinal waves in the wall, in m/s."""

    def __post_init__(self) -> None:
        for name in ("radius", "thickness", "steel"):
            if not as_finite(name, getattr(self, name)) > 0:
                raise ParameterError(f"{name} is {getattr(self, name)}; give a positive number")
        if not self.transducer.face < self.radius:
            raise ParameterError(
                f"a face {self.transducer.face:.4g} m from the pivot is not inside a pipe of "
                f"radius {self.radius:.4g} m"
            )
        sound_speed(self.temperature)

    @property
    def speed(self) -> float:
        """Speed of sound in the water, in m/s."""
        return sound_speed(self.temperature)

    def beams(self, angles: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return (K, 3) centres of the face and (K, 3) beam directions at (K, 2) pan and tilt."""
        pairs = [
            self.transducer.beam(self.mount, float(pan), float(tilt))
            for pan, tilt in np.reshape(np.asarray(angles, dtype=np.float64), (-1, 2))
        ]
        return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])

    def spots(self, angles: npt.ArrayLike) -> FloatArray:
        """Return (K, 3) phi, z and distance of the wall along the beam at (K, 2) pan and tilt."""
        origins, axes = self.beams(angles)
        return np.array(
            [
                meet_wall(origin, axis, self.radius)
                for origin, axis in zip(origins, axes, strict=True)
            ]
        )


@dataclass(frozen=True, eq=False)
class SoundField:
    """Pressure of a probe, over distance off its axis, along it, and frequency."""

    table: FloatArray
    """Shape (N, M, 2, F). Real and imaginary parts, without the carrier exp(i k along)."""
    steps: FloatArray
    """Shape (3,). Step off the axis, first distance along it, and step along it, in metres."""
    wavenumbers: FloatArray
    """Shape (F,). In rad/m."""
    reach: float
    """Distance from its axis within which the wall contributes to an echo, in metres."""

    @property
    def first(self) -> float:
        """First wavenumber."""
        return float(self.wavenumbers[0])

    @property
    def step(self) -> float:
        """Step of the wavenumbers."""
        return float(self.wavenumbers[1] - self.wavenumbers[0])

    def at(
        self, origins: FloatArray, axes: FloatArray, starts: FloatArray, points: FloatArray
    ) -> FloatArray:
        """Return the pressure (K, N, 2, F) of K beams at points (N, 3); phases from starts (K,).

        Its real parts come before its imaginary ones.
        """
        out = np.empty((len(origins), len(points), 2, len(self.wavenumbers)))
        kernels.field_at(
            self.table, self.steps, origins, axes, starts, points, self.first, self.step, out
        )
        return out

    def wall(
        self,
        origins: FloatArray,
        axes: FloatArray,
        starts: FloatArray,
        spots: FloatArray,
        radius: float,
        sunk: Callable[[FloatArray], FloatArray] | None = None,
    ) -> ComplexArray:
        """Return the echo (K, F) of a wall, 2 i k times the integral of p^2 over it.

        ``sunk`` returns the distance of the wall from the axis less ``radius``, in metres, at
        places (..., 2), phi and z; zero without it.
        """
        side = _FACET * np.arange(-np.ceil(self.reach / _FACET), np.ceil(self.reach / _FACET) + 1)
        radii = np.full((len(origins), side.size, side.size), radius)
        if sunk is not None:
            around, along = np.meshgrid(side / radius, side, indexing="ij")
            radii += sunk(spots[:, None, None, :] + np.stack([around, along], axis=-1))
        out = np.zeros((len(origins), 2, len(self.wavenumbers)))
        kernels.wall_sum(
            self.table, self.steps, origins, axes, starts, spots, radii, radius, self.reach, _FACET,
            self.first, self.step, out,
        )  # fmt: skip
        return 2j * self.wavenumbers * as_complex(out)


def as_complex(parts: FloatArray) -> ComplexArray:
    """Return complex numbers (..., F) from their real and imaginary parts (..., 2, F)."""
    joined: ComplexArray = parts[..., 0, :] + 1j * parts[..., 1, :]
    return joined


def as_parts(values: ComplexArray) -> FloatArray:
    """Return the real and imaginary parts (..., 2, F) of complex numbers (..., F)."""
    return np.stack([values.real, values.imag], axis=-2)


def sound_field(probe: CalibratedProbe) -> SoundField:
    """Compute the field of a probe near the wall, by the Rayleigh integral over the disc.

    Notes
    -----
    The integral of exp(i k r) / (2 pi r) over rings and angles (O'Neil, Theory of focusing
    radiators, J. Acoust. Soc. Am. 21, 516, 1949), the lens as a delay of each ring.
    """
    return _sound_field(
        probe.transducer.aperture,
        probe.transducer.focus,
        round(probe.speed, 2),
        probe.radius - probe.transducer.face,
    )


@lru_cache(maxsize=8)
def _sound_field(aperture: float, focus: float, speed: float, standoff: float) -> SoundField:
    frequencies = np.arange(LOWEST, HIGHEST + 1.0, RESOLUTION)
    k = 2 * np.pi * frequencies / speed
    lens = np.isfinite(focus)
    reach = 1.4e-3 if lens else 0.5 * aperture + 1.2e-3
    off = np.arange(0.0, reach + 0.9e-3, 0.016e-3 if lens else 0.03e-3)
    along = np.arange(standoff - 0.8e-3, standoff + _SUNK, 0.06e-3)
    nodes, weights = np.polynomial.legendre.leggauss(36 if lens else 48)
    rings = 0.25 * aperture * (nodes + 1)
    areas = 2 * np.pi * rings * 0.25 * aperture * weights
    lags = np.hypot(focus, rings) - focus if lens else np.zeros_like(rings)
    count = 24 + int(k[-1] * off[-1] * aperture / 2 / standoff / 2)
    cosines = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    table = kernels.rayleigh(
        off, along, rings, areas, lags, cosines, float(k[0]), float(k[1] - k[0]), len(k)
    )
    steps = np.array([off[1], along[0], along[1] - along[0]])
    return SoundField(table, steps, k, reach)


def sound_speed(temperature: float) -> float:
    """Return the speed of sound in pure water, in m/s.

    ``temperature``: in degrees Celsius, from 0 to 95. Raises a `ParameterError` if the temperature
    is out of that range.

    References
    ----------
    Marczak, Water as a standard in the measurements of speed of sound in liquids,
    J. Acoust. Soc. Am. 102, 2776, 1997, equation 1.
    """
    if not 0 <= as_finite("temperature of the water", temperature) <= 95:
        raise ParameterError(
            f"water at {temperature} degrees; give a temperature from 0 to 95 degrees Celsius"
        )
    terms = (2.787860e-9, -1.398845e-6, 3.287156e-4, -5.799136e-2, 5.038813, 1402.385)
    return float(np.polyval(terms, temperature))
