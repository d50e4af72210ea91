"""The shape of a bent wall about a pit, and the speed of sound, by distances measured beside it.

The cause of the bend is unknown. Smoothness and deviation from a plane have the maximum likelihood
for the distances; they give the uncertainty of the wall under the mouth. The pipe and the
calibrated probe give the distance of a plain wall; its echo gives a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray

_PIVOT = 0.05e-3
"""Standard deviation of the known place of the pivot, in metres."""
_THERMOMETER, _OTHER = 0.6e-3, 20e-3
"""Relative standard deviations of the speed: of pure water by a thermometer with an error of 0.3
degrees; and of any other water, such as brackish water or water 8 degrees warmer."""
_OTHERS = 0.3
"""Prior share of waters that differ from the assumption."""
FARTHEST = 0.35e-3
"""Largest distance in metres of a wall that is not bent from its nominal place: that for an error
of 4 % of the speed, and more than that for an error of the pivot."""
_RAMPS = (0, 3, 6, 12, 24, 48)
"""Numbers of bursts during which the water changes."""
_CHANGES = (0.03e-3, 0.1e-3, 0.3e-3)
"""Standard deviations of the change of the distance, in metres: of 2 to 20 degrees."""
_SURE = 10.0
"""Least difference of log-likelihoods that shows a change of the water instead of a bent wall."""
_LENGTHS = (0.5e-3, 0.8e-3, 1.2e-3, 2e-3, 3e-3)
"""Distances in metres over which a wall may bend: from half a mouth to twice a raster."""
_HEIGHTS = (0.01e-3, 0.03e-3, 0.1e-3, 0.3e-3, 1e-3)
"""Standard deviations of the wall from a plane in metres: from a slight bend to a pit."""
_ERRORS = (2e-6, 4e-6, 8e-6, 16e-6)
"""Standard deviations of a distance in metres: texture of the wall, and places of the beam."""
_OFFSET, _SLOPE = 1e-3, 0.3
"""Standard deviations of the distance of the plane in metres, and of its slopes: the pivot is known
to 0.05 mm, and a steeper wall sends no echo back to the lens."""
_RIM = 24
"""Number of places on a rim for its plane."""


@dataclass(frozen=True, eq=False)
class WallShape:
    """A smooth surface: distances of the wall beyond the nominal one, with a covariance."""

    places: FloatArray
    """Shape (N, 2). Around and along the pipe from a centre, in metres."""
    inverse: FloatArray
    """Shape (N, N). Inverse covariance of the distances, in 1/m^2."""
    weights: FloatArray
    """Shape (N,). The inverse times the distances, in 1/m."""
    length: float
    height: float
    """Length over which the wall bends, and standard deviation from a plane, in metres."""
    error: float
    """Standard deviation of a distance, in metres."""
    likelihood: float
    """Logarithm of the likelihood of the distances, without a constant."""

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

    ``places`` (N, 2): around and along the pipe from a centre, in metres; ``depths`` (N,): beyond
    the nominal wall, in metres.

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


def _plane_covariance(places: FloatArray, others: FloatArray) -> FloatArray:
    """Return the covariance (..., M) of a plane wall at places (..., 2) and (M, 2)."""
    return np.asarray(_OFFSET**2 + _SLOPE**2 * (places @ others.T))


def _covariance(one: FloatArray, other: FloatArray, length: float, height: float) -> FloatArray:
    """Return the covariance (..., M) of the wall at places (..., 2) and (M, 2)."""
    off = np.sqrt(((one[..., None, :] - other) ** 2).sum(axis=-1)) * (np.sqrt(5.0) / length)
    bent = height**2 * (1 + off + off * off / 3) * np.exp(-off)
    covariance: FloatArray = bent + _plane_covariance(one, other)
    return covariance


def speed_error(beyond: float, standoff: float, bent: float = 0.0) -> tuple[float, float]:
    """Return the relative error of the assumed speed of sound, and its standard deviation.

    ``beyond``: distance of the wall behind the nominal one by the assumed speed, in metres;
    ``standoff``: nominal distance from the face of the probe to the wall, in metres; ``bent``:
    standard deviation of the wall from the nominal one where it is bent, in metres.

    Notes
    -----
    A distance errs by the pivot, or by the speed, whose error is small in pure water and large in
    other water: a mixture of two normal distributions. Near the nominal distance the water is most
    likely pure, and the correction small.
    """
    place = np.hypot(_PIVOT, bent) / standoff
    seen, prior = -beyond / standoff, np.array([_THERMOMETER, _OTHER])
    total = prior**2 + place**2
    logs = np.log([1 - _OTHERS, _OTHERS]) - 0.5 * (seen**2 / total + np.log(total))
    share = np.exp(logs - logs.max())
    share /= share.sum()
    means, variances = seen * prior**2 / total, prior**2 * place**2 / total
    mean = float(share @ means)
    return mean, float(np.sqrt(share @ (variances + (means - mean) ** 2)))


def changes_in_time(order: npt.NDArray[np.intp], places: FloatArray, depths: FloatArray) -> bool:
    """Return whether a change of the water before a plane wall explains distances.

    ``order`` (N,): numbers of the bursts, in the order of their times; ``places`` (N, 2): around
    and along the pipe, in metres; ``depths`` (N,): beyond the nominal wall, in metres.

    Notes
    -----
    Rows are fired one after the other, so that a change of the speed of sound looks like a bent
    wall. A plane and one ramp in time explain it with fewer numbers: their marginal likelihood is
    compared with that of the smooth surface (Rasmussen and Williams, Gaussian Processes for Machine
    Learning, 2006, section 5.2).
    """
    plane = _plane_covariance(places, places)
    ramps = [
        np.clip((order - first + 1) / (length + 1), 0.0, 1.0)
        for length in _RAMPS
        for first in range(1, int(order.max()) + 1)
    ]
    changed = max(
        likelihood(depths, plane + np.outer(change * ramp, change * ramp))[0]
        for ramp in ramps
        for change in _CHANGES
    )
    others = smooth_shape(places, depths).likelihood, likelihood(depths, plane)[0]
    return bool(changed - max(others) > _SURE)
