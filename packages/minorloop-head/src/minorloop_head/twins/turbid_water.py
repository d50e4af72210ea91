"""Light in water that fills a pipe: refraction at the port, extinction and backscatter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.geometry import WATER_INDEX, Pinhole


@dataclass(frozen=True)
class TurbidWater:
    """Optical properties of water with particles.

    Raises a `ParameterError` if a number is negative.

    References
    ----------
    Mobley, Light and water, 1994, table 3.11: of turbid harbour water 0.37 and 1.8 1/m, and 0.003
    per steradian at 180 degrees (Petzold, 1972). Process water is up to ten times as turbid.
    """

    absorption: float = 0.37
    scattering: float = 1.8
    """Coefficients in 1/m. Both weaken the light on its way: light that is scattered forwards
    counts as lost."""
    backward: float = 0.003
    """Share of the scattered light in the backward direction, per steradian."""
    gloss: float = 0.82
    """Specular reflection of the metal over that in air: by Fresnel, 0.82 for steel."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not as_finite(name, value) >= 0:
                raise ParameterError(f"{name} of water is {value}; give a number >= 0")

    @classmethod
    def draw(cls, rng: np.random.Generator) -> TurbidWater:
        """Draw water from clear to ten times as turbid as in a harbour."""
        harbour = float(np.exp(rng.uniform(np.log(0.1), np.log(10.0))))
        return cls(
            absorption=0.37 * harbour,
            scattering=1.8 * harbour,
            backward=float(rng.uniform(0.002, 0.01)),
        )

    @property
    def extinction(self) -> float:
        """Coefficient by which direct light becomes weaker, in 1/m."""
        return self.absorption + self.scattering


class FlatPort(Pinhole):
    """A lens behind a thin flat port in water, by the law of Snell.

    The port touches the lens, so that all rays still pass through one point. Normalised
    coordinates are those of rays in the water; there are no rays beyond the angle that grazes the
    port.
    """

    @classmethod
    def of(cls, lens: Pinhole) -> FlatPort:
        """Return a lens put into water."""
        return cls(**vars(lens))

    def pixels(self, points: npt.ArrayLike) -> FloatArray:
        """Return pixels (..., 2) of rays in the water (..., 2)."""
        wet = np.asarray(points, dtype=np.float64)
        square = (wet**2).sum(axis=-1, keepdims=True)
        inside = 1 - (WATER_INDEX**2 - 1) * square
        return super().pixels(wet * WATER_INDEX / np.sqrt(np.where(inside > 0, inside, np.nan)))

    def normalised(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return rays in the water (..., 2) of pixels (..., 2)."""
        dry = super().normalised(pixels)
        square = (dry**2).sum(axis=-1, keepdims=True)
        return np.asarray(dry / np.sqrt(WATER_INDEX**2 + (WATER_INDEX**2 - 1) * square))
