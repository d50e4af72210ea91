"""How wrong the model of an internal-model loop may be before the loop is unstable.

From the input v of the inverse operator to the angle, the plant is a gain, a lag and a delay. The
loop of `InternalModel` around it is linear while the current is not at a limit, so that its poles
tell whether it is stable. Where the operator of the plant differs from the model, its slope along a
branch is the gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import MOST_DELAY
from minorloop_head.heated_wire import HeatedWire
from papers.catheter.control.internal_model import InternalModel

_LARGEST = 1e4
"""Largest gain and ratio of lags that is tried; no actuator differs so much from its model."""
_HALVINGS = 50
"""Bisections of an edge: 1e-14 of it."""
_POINTS, _ENDS = 81, 0.1
"""Angles at which slopes are compared, and share of the stroke at each end without them, where both
branches are flat."""


@dataclass(frozen=True)
class Margins:
    """Edges of stability, each with the rest of the plant as in the model."""

    gain: float
    """Greatest slope of the plant over that of the model."""
    delay: float
    """Longest delay of the sensor beyond that of the model, in seconds, in whole intervals."""
    lag: float
    """Shortest lag of the plant over that of the model; 0 if there is none."""


def poles(law: InternalModel, *, gain: float = 1.0, delay: int = 0, lag: float = 1.0) -> FloatArray:
    """Return the magnitudes of the discrete poles of the loop, the greatest first.

    With H = z^-d (1 - a) / (z - a) of the model and P of the plant, the loop has the poles of
    1 + C (P - H) = 0, C = m + (1 - m) (1 - b) / (z - b), where a and b are the decays of the
    lags tau_H and lambda in an interval and m = tau_H / lambda (Morari and Zafiriou, Robust Process
    Control, 1989, chapters 3 and 4).

    Parameters
    ----------
    law : InternalModel
    gain, lag : float
        Slope and lag of the plant over those of the model, above 0.
    delay : int
        Intervals by which the readings are older than the model's.
    """
    ratio = law.model_lag / law.response
    own = math.exp(-law.interval / law.model_lag)
    plant = math.exp(-law.interval / (law.model_lag * lag))
    filtered = math.exp(-law.interval / law.response)
    corrector = [ratio, (1.0 - ratio) * (1.0 - filtered) - ratio * filtered]
    late, sooner = np.zeros(law.delay + delay + 1), np.zeros(delay + 1)
    late[0] = sooner[0] = 1.0
    beside = np.polymul([1.0, -filtered], np.polymul([1.0, -own], [1.0, -plant]))
    missing = np.polysub(
        gain * (1.0 - plant) * np.array([1.0, -own]),
        np.polymul((1.0 - own) * np.array([1.0, -plant]), sooner),
    )
    loop = np.polyadd(np.polymul(beside, late), np.polymul(corrector, missing))
    return np.asarray(np.sort(np.abs(np.roots(loop)))[::-1])


def margins(law: InternalModel, *, gain: float = 1.0, lag: float = 1.0) -> Margins:
    """Return the edges of stability; those that are not sought are of the plant that is given."""
    unstable = (
        k for k in range(1, MOST_DELAY) if poles(law, gain=gain, delay=k, lag=lag)[0] >= 1.0
    )
    longest = next(unstable, MOST_DELAY) - 1
    shortest = 0.0
    if poles(law, gain=gain, lag=1.0 / _LARGEST)[0] >= 1.0:
        shortest = _edge(lambda ratio: poles(law, gain=gain, lag=ratio)[0], 1.0 / _LARGEST)
    greatest = _edge(lambda ratio: poles(law, gain=ratio, lag=lag)[0], _LARGEST)
    return Margins(greatest, longest * law.interval, shortest)


def robust_margins(law: InternalModel) -> Margins:
    """Return the worst edges of stability over the plants that identification leaves possible.

    The inverse may mistake one branch of the loop for the other, which is a gain, or the wire may
    be where nothing transforms, so that its lag lacks the latent heat. Both together do not
    occur: where the slope is great, so is the latent heat.
    """
    cold = law.wire.lag / law.model_lag
    found = [margins(law, gain=slope_ratios(law.wire)[1]), margins(law, lag=cold)]
    return Margins(
        min(each.gain for each in found),
        min(each.delay for each in found),
        max(each.lag for each in found),
    )


def _edge(radius: Callable[[float], float], far: float) -> float:
    """Return the ratio between 1, which is stable, and another, which is not, at the edge."""
    inside, outside = 1.0, far
    for _ in range(_HALVINGS):
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if radius(middle) < 1.0 else (inside, middle)
    return inside


def slope_ratios(wire: HeatedWire) -> tuple[float, float]:
    """Return the least and the greatest ratio of the slopes of the two branches of the major loop.

    An inverse that mistakes one branch for the other meets this gain. Slopes are compared at
    equal angles, over the middle 80 % of the stroke.
    """
    levels = wire.operator.levels
    up = np.linspace(levels[0], levels[-1], 10 * levels.size)
    angles = wire.operator.simulate(np.concatenate([up, up[::-1]]))
    low, high = wire.operator.range
    at = np.linspace(low + _ENDS * (high - low), high - _ENDS * (high - low), _POINTS)
    rising, falling = (
        1.0 / np.gradient(np.interp(at, np.maximum.accumulate(angle), up), at)
        for angle in (angles[: up.size], angles[up.size :][::-1])
    )
    ratios = np.concatenate([rising / falling, falling / rising])
    return float(ratios.min()), float(ratios.max())
