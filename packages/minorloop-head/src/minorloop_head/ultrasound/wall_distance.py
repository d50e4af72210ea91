"""Error of the speed of sound by the distance of the wall, and water that changes during a raster.

The pipe and the calibrated probe give the distance of the wall; its echo gives a time.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.wall_shape import likelihood, plane_covariance, smooth_shape

_PIVOT = 0.05e-3
"""Standard deviation of the known place of the pivot, in metres."""
_THERMOMETER, _OTHER = 0.6e-3, 20e-3
"""Standard deviations of the speed, as a share of it: of pure water by a thermometer that is off by
0.3 degrees; and of any other water, such as brackish water or one that is 8 degrees warmer."""
_OTHERS = 0.3
"""Share of waters that are not as assumed, before any echo."""
FARTHEST = 0.35e-3
"""Largest distance of a wall that is not bent from where it should be, in metres: that of water
with a speed of 4 %, and more than that of a pivot in error."""
_RAMPS = (0, 3, 6, 12, 24, 48)
"""Bursts during which the water changes."""
_CHANGES = (0.03e-3, 0.1e-3, 0.3e-3)
"""Standard deviations of the change of the distance, in metres: of 2 to 20 degrees."""
_SURE = 10.0
"""Difference of log-likelihoods from which on the water has changed and the wall is not bent."""


def speed_error(beyond: float, standoff: float, bent: float = 0.0) -> tuple[float, float]:
    """Return by which share the true speed of sound is above the assumed one, and its deviation.

    Parameters
    ----------
    beyond : float
        Distance of the wall behind the nominal one by the assumed speed, in metres.
    standoff : float
        Nominal distance from the face of the probe to the wall, in metres.
    bent : float
        Standard deviation of the wall from the nominal one where it is bent, in metres.

    Notes
    -----
    A distance is off by an error of the pivot, or by one of the speed, which is small in pure water
    and large in others: a mixture of two normal distributions. Near the nominal distance the water
    is most likely pure, and the correction small.
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
    """Return whether distances are those of water that changes before a plane wall.

    Parameters
    ----------
    order : (N,) array of int
        Numbers of the bursts, in the order of their times.
    places : (N, 2) array
        Around and along the pipe, in metres.
    depths : (N,) array
        Beyond the nominal wall, in metres.

    Notes
    -----
    Rows are fired one after the other, so that a bent wall could explain a change of the speed of
    sound too. A plane and one ramp in time explain it with fewer numbers: their marginal likelihood
    is compared with that of the smooth surface (Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2006, section 5.2).
    """
    plane = plane_covariance(places, places)
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
