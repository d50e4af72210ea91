"""Parametric densities on the Preisach plane.

A density is a vectorised callable ``density(alpha, beta)``, in the unit of the output over that of
the input squared; it is zero for alpha < beta. ``mass`` is its integral over the half-plane
alpha >= beta, in the unit of the output. All densities but the uniform one have tails. A model does
not contain the part beyond its levels, which is small for a Gaussian and large for a Lorentzian. A
number that is not finite, a spread that is not positive and a negative coercive field raise a
`ParameterError`.

A relay is described by its thresholds alpha (up) and beta (down), or by their mean
``m = (alpha + beta) / 2``, in magnetism minus the interaction field, and their half-width
``h = (alpha - beta) / 2``, the coercive field; d alpha d beta = 2 dm dh. With a ``centre`` of zero,
loops are symmetric about the origin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError


class _Shape(NamedTuple):
    """A function of integral 1 and spread 1: its values, and its integral up to a place.

    ``difference``: twice its spread over the spread of the difference of two numbers of this
    distribution.
    """

    density: Callable[[FloatArray], FloatArray]
    distribution: Callable[[float], float]
    difference: float


_GAUSSIAN = _Shape(
    lambda x: np.asarray(np.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)),
    lambda x: 0.5 * math.erfc(-x / math.sqrt(2)),
    math.sqrt(2),
)
_LORENTZIAN = _Shape(
    lambda x: np.asarray(1 / (math.pi * (1 + x * x))), lambda x: 0.5 + math.atan(x) / math.pi, 1.0
)


class _Density:
    """Checks of all densities: finite numbers, positive spreads, no negative coercive field."""

    def __post_init__(self) -> None:
        for field in fields(self):  # type: ignore[arg-type]
            value = as_finite(field.name, getattr(self, field.name))
            if field.name.startswith("spread") and value <= 0:
                raise ParameterError(f"{field.name} is {value:g}; give a positive number")
            if field.name == "coercive" and value < 0:
                raise ParameterError(f"coercive is {value:g}; give zero or more")
            object.__setattr__(self, field.name, value)


@dataclass(frozen=True)
class _Factored(_Density):
    """A product of a function of each threshold: up above the centre, and down below it."""

    _shape: ClassVar[_Shape]

    coercive: float
    """Most frequent threshold up above the centre, and threshold down below it."""
    spread: float
    """Standard deviation, or half-width at half-maximum, of each threshold; positive."""
    mass: float = 1.0
    """Integral over the half-plane alpha >= beta, in the unit of the output."""
    centre: float = 0.0
    """Mean threshold of the typical relay. All but the mass in the unit of the input."""

    def __call__(self, alpha: npt.ArrayLike, beta: npt.ArrayLike) -> FloatArray:
        """Return the density at thresholds of equal or broadcastable shapes."""
        up, down = np.asarray(alpha) - self.centre, self.centre - np.asarray(beta)
        share = self._shape.distribution(self._shape.difference * self.coercive / self.spread)
        values = self._shape.density((up - self.coercive) / self.spread) * self._shape.density(
            (down - self.coercive) / self.spread
        )
        return _half_plane(alpha, beta, values) * (self.mass / (share * self.spread**2))


@dataclass(frozen=True)
class _InMeanAndWidth(_Density):
    """A product of a function of the mean and of the half-width of the thresholds."""

    _shape: ClassVar[_Shape]

    coercive: float
    """Half-width of the typical relay."""
    spread_mean: float
    """Standard deviation, or half-width at half-maximum, of the mean of the thresholds; positive.
    """
    spread_width: float
    """Standard deviation, or half-width at half-maximum, of their half-width; positive."""
    mass: float = 1.0
    """Integral over the half-plane alpha >= beta, in the unit of the output."""
    centre: float = 0.0
    """Mean threshold of the typical relay. All but the mass in the unit of the input."""

    def __call__(self, alpha: npt.ArrayLike, beta: npt.ArrayLike) -> FloatArray:
        """Return the density at thresholds of equal or broadcastable shapes."""
        up, down = np.asarray(alpha) - self.centre, np.asarray(beta) - self.centre
        values = self._shape.density((up + down) / 2 / self.spread_mean) * self._shape.density(
            ((up - down) / 2 - self.coercive) / self.spread_width
        )
        share = 2 * self._shape.distribution(self.coercive / self.spread_width)
        scale = self.mass / (share * self.spread_mean * self.spread_width)
        return _half_plane(alpha, beta, values) * scale


@dataclass(frozen=True)
class FactoredGaussianDensity(_Factored):
    """A product of Gaussians in both thresholds, ``A f(alpha - centre) f(centre - beta)``.

    ``f(x) = exp(-(x - coercive)^2 / (2 spread^2))`` and
    ``A = mass / (2 pi spread^2 Phi(sqrt(2) coercive / spread))`` with the normal
    distribution function Phi.

    References
    ----------
    Della Torre, Magnetic Hysteresis, 1999, chapter 2: Gaussian Preisach functions.
    Kadar, Journal of Applied Physics 61 (1987) 4013: product form.
    """

    _shape: ClassVar[_Shape] = _GAUSSIAN


@dataclass(frozen=True)
class GaussianDensity(_InMeanAndWidth):
    """A product of Gaussians in the mean and in the half-width of the thresholds.

    ``A exp(-(m - centre)^2 / (2 spread_mean^2)) exp(-(h - coercive)^2 / (2 spread_width^2))``
    with ``A = mass / (4 pi spread_mean spread_width Phi(coercive / spread_width))`` and the
    normal distribution function Phi.

    References
    ----------
    Della Torre, Magnetic Hysteresis, 1999, chapter 2: interaction and critical fields.
    Bertotti, Hysteresis in Magnetism, 1998, chapter 13.
    """

    _shape: ClassVar[_Shape] = _GAUSSIAN


@dataclass(frozen=True)
class LorentzianDensity(_InMeanAndWidth):
    """A product of Lorentzians in the mean and in the half-width of the thresholds.

    ``A / [(1 + ((m - centre) / spread_mean)^2) (1 + ((h - coercive) / spread_width)^2)]`` with
    ``A = mass / [2 pi spread_mean spread_width (pi/2 + arctan(coercive / spread_width))]``.

    References
    ----------
    Bertotti, Hysteresis in Magnetism, 1998, chapter 13: coercive and interaction fields.
    """

    _shape: ClassVar[_Shape] = _LORENTZIAN


@dataclass(frozen=True)
class FactoredLorentzianDensity(_Factored):
    """A product of Lorentzians in both thresholds, ``A f(alpha - centre) f(centre - beta)``.

    ``f(x) = 1 / (1 + ((x - coercive) / spread)^2)`` and
    ``A = mass / [pi^2 spread^2 (1/2 + arctan(coercive / spread) / pi)]``.

    References
    ----------
    Azzerboni, Cardelli, Finocchio and La Foresta, IEEE Trans. Magn. 39 (2003) 3028: Lorentzian
    Preisach functions for non-oriented steels.
    """

    _shape: ClassVar[_Shape] = _LORENTZIAN


def _half_plane(alpha: npt.ArrayLike, beta: npt.ArrayLike, values: FloatArray) -> FloatArray:
    return np.where(np.asarray(alpha) >= np.asarray(beta), values, 0.0)
