"""The shape of a bent wall about a pit: a smooth surface through distances measured beside it.

Nothing is known of what bent the wall. How smooth it is, and how far it is from a plane, is as
likely as possible for the distances; what is unknown under the mouth follows from both.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from minorloop.arrays import FloatArray

_LENGTHS = (0.5e-3, 0.8e-3, 1.2e-3, 2e-3, 3e-3)
"""Distances in metres over which a wall may bend: from half a mouth to twice a raster."""
_HEIGHTS = (0.01e-3, 0.03e-3, 0.1e-3, 0.3e-3, 1e-3)
"""Standard deviations of the wall from a plane in metres: from what counts as bent to a pit."""
_ERRORS = (2e-6, 4e-6, 8e-6, 16e-6)
"""Standard deviations of a distance in metres: texture of the wall, and places of the beam."""
_OFFSET, _SLOPE = 1e-3, 0.3
"""Standard deviations of the distance of the plane in metres, and of its slopes: the pivot is known
to 0.05 mm, and a steeper wall sends no echo back to the lens."""
_RIM = 24
"""Places on a rim that give its plane."""


@dataclass(frozen=True, eq=False)
class WallShape:
    """A smooth surface: distances of the wall beyond the nominal one, with a covariance."""

    places: FloatArray
    """Shape (N, 2). Around and along the pipe from a centre, in metres."""
    inverse: FloatArray
    """Shape (N, N). Of the covariance of the distances, in 1/m^2."""
    weights: FloatArray
    """Shape (N,). The inverse times the distances, in 1/m."""
    length: float
    height: float
    """Over which the wall bends, and standard deviation from a plane, in metres."""
    error: float
    """Standard deviation of a distance, in metres."""
    likelihood: float
    """Logarithm of that of the distances, without a constant."""

    def depth(self, places: FloatArray) -> FloatArray:
        """Return distances (...) beyond the nominal wall at places (..., 2), in metres."""
        depths: FloatArray = self._with(places) @ self.weights
        return depths

    def rim(self, around: float, along: float, radius: float) -> tuple[FloatArray, float]:
        """Return the plane (3,) through a rim, and the standard deviation of its distance.

        The plane is a distance in the middle, in metres, and slopes around and along the pipe.
        """
        turn = 2 * np.pi * np.arange(_RIM) / _RIM
        off = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        places = off + np.array([around, along])
        depths = self.depth(places)
        slopes = 2 * (depths @ off) / (_RIM * radius**2)
        mean = self._with(places).mean(axis=0)
        own = float(_covariance(places, places, self.length, self.height).mean())
        left = own - float(mean @ self.inverse @ mean)
        return np.array([depths.mean(), *slopes]), float(np.sqrt(max(left, 0.0)))

    def _with(self, places: FloatArray) -> FloatArray:
        return _covariance(places, self.places, self.length, self.height)


def smooth_shape(places: FloatArray, depths: FloatArray) -> WallShape:
    """Return the most likely smooth surface through distances of the wall.

    Parameters
    ----------
    places : (N, 2) array
        Around and along the pipe from a centre, in metres.
    depths : (N,) array
        Beyond the nominal wall, in metres.

    Notes
    -----
    A Gaussian process with the covariance of Matern of order 5/2 about a plane, whose three numbers
    have the largest marginal likelihood (Rasmussen and Williams, Gaussian Processes for Machine
    Learning, 2006, equations 4.17 and 5.8).
    """
    covariances = {
        (length, height): _covariance(places, places, length, height)
        for length, height in product(_LENGTHS, _HEIGHTS)
    }
    shape, likely, error = max(
        ((key, *likelihood(depths, value)) for key, value in covariances.items()),
        key=lambda one: one[1],
    )
    root = np.linalg.cholesky(covariances[shape] + error**2 * np.eye(len(depths)))
    halved = np.linalg.inv(root)
    inverse = halved.T @ halved
    return WallShape(places, inverse, inverse @ depths, *shape, error, likely)


def likelihood(depths: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Return the largest log-likelihood of distances (N,), and the error of a distance for it.

    ``covariance`` (N, N) is that of the wall, without this error. The constant is left out.
    """
    values, vectors = np.linalg.eigh(covariance)
    square = (vectors.T @ depths) ** 2
    total = np.maximum(values, 0.0)[:, None] + np.square(_ERRORS)
    likely = -0.5 * (square[:, None] / total + np.log(total)).sum(axis=0)
    best = int(np.argmax(likely))
    return float(likely[best]), _ERRORS[best]


def plane_covariance(places: FloatArray, others: FloatArray) -> FloatArray:
    """Return the covariance (..., M) of a plane wall at places (..., 2) and (M, 2)."""
    return np.asarray(_OFFSET**2 + _SLOPE**2 * (places @ others.T))


def _covariance(one: FloatArray, other: FloatArray, length: float, height: float) -> FloatArray:
    """Return the covariance (..., M) of the wall at places (..., 2) and (M, 2)."""
    off = np.sqrt(((one[..., None, :] - other) ** 2).sum(axis=-1)) * (np.sqrt(5.0) / length)
    bent = height**2 * (1 + off + off * off / 3) * np.exp(-off)
    covariance: FloatArray = bent + plane_covariance(one, other)
    return covariance
