"""The best sequence there is, on a coarse plane: dynamic programming over memory curves.

On L bands a memory curve is a staircase of L unit steps from the corner of the plane to the
diagonal, so there are exactly 2^L of them, and they are the numbers of L binary digits: a one is
a step of beta, a zero a step of alpha, from the oldest in the highest digit to the present input
in the lowest. The level of the input is the number of ones. One level up sets the lowest zero,
one level down clears the lowest one; that alone is the wiping-out property.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, as_samples
from minorloop.errors import ParameterError, SignalError
from minorloop.head.control.controller import HIGHEST_CURRENT, within
from minorloop.head.control.heating import HeatedWire
from minorloop.head.control.planning import PlannedPowers

MOST_BANDS = 10


def memory_curves(bands: int) -> list[tuple[int, ...]]:
    """Remembered extrema of every memory curve, as indices of levels; curve c is entry c.

    Parameters
    ----------
    bands : int
        L, 1 to 10.

    Raises
    ------
    ParameterError
        If there are more bands.
    """
    if int(bands) != bands or not 1 <= bands <= MOST_BANDS:
        raise ParameterError(
            f"{bands} bands; give 1 to {MOST_BANDS}, for there are 2^bands memory curves"
        )
    return [_extrema(curve, int(bands)) for curve in range(2 ** int(bands))]


def optimum_on_levels(
    wire: HeatedWire,
    targets: npt.ArrayLike,
    *,
    interval: float,
    curve: int = 0,
    highest: float = HIGHEST_CURRENT,
) -> PlannedPowers:
    """The sequence of least cost among all whose effective powers lie on the levels.

    The heat balance is taken in one implicit step an interval, so that from one level to another
    exactly one power leads; it must lie within the limits.

    Parameters
    ----------
    wire : HeatedWire
        With an operator of at most 10 bands.
    targets : (N,) array_like
        Angles wanted at the ends of the intervals, in degrees.
    interval : float
        In seconds.
    curve : int
        Memory before; 0 is negative saturation.
    highest : float
        Largest current in A.

    Returns
    -------
    PlannedPowers
        ``feedforward_cost`` is that of always going to the level nearest to the target, among
        those that can be reached in time.

    Raises
    ------
    ParameterError
        If there are more than 10 bands, or a number is out of its range.
    SignalError
        If the targets are not finite numbers in one dimension.
    """
    within("interval", interval, 1e-3, 600.0, "s")
    within("highest", highest, 1e-6, HIGHEST_CURRENT, "A")
    wanted = as_samples(targets, name="targets")
    if wanted.ndim != 1 or wanted.size < 1:
        raise SignalError(f"targets have shape {wanted.shape}; give (N,), N at least 1")
    angle = _angles(wire)
    if not 0 <= curve < angle.size:
        raise ParameterError(f"curve is {curve}; give 0 to {angle.size - 1}")
    after = _moves(wire.operator.bands)
    power = _powers(wire, angle, after, interval)
    allowed = (power >= 0.0) & (power <= highest**2)
    ahead = _values(angle, after, allowed, wanted)
    if not math.isfinite(ahead[0, curve]):
        raise ParameterError(
            f"from curve {curve} no sequence of levels keeps within {highest} A; give a larger "
            "current or a curve that ends at a lower level"
        )
    best, best_power = _followed(angle, after, allowed, power, wanted, ahead, curve)
    greedy, _ = _followed(angle, after, allowed, power, wanted, np.zeros_like(ahead), curve)
    cost, greedy_cost = (float(((path - wanted) ** 2).sum()) for path in (best, greedy))
    return PlannedPowers(best_power, best, wanted, cost, greedy_cost, interval)


def _extrema(curve: int, bands: int) -> tuple[int, ...]:
    """Indices of the levels of a curve's extrema, from the lowest on."""
    alpha, beta = bands, 0
    extrema = [0]
    for digit in range(bands - 1, -1, -1):
        if curve >> digit & 1:
            if len(extrema) % 2 == 1:
                extrema.append(alpha)
            beta += 1
        else:
            if len(extrema) % 2 == 0:
                extrema.append(beta)
            alpha -= 1
    return tuple(extrema)


def _angles(wire: HeatedWire) -> FloatArray:
    """Angle (2^L,) of each memory curve."""
    levels = wire.operator.levels
    curves = memory_curves(wire.operator.bands)
    return np.array([wire.operator.simulate(levels[list(curve)])[-1] for curve in curves])


def _moves(bands: int) -> IntArray:
    """Curve (2^L, L + 1) after the input has gone from each curve straight to each level."""
    count = 2**bands
    after = np.empty((count, bands + 1), dtype=np.int64)
    for curve in range(count):
        level = curve.bit_count()
        after[curve, level] = up = down = curve
        for above in range(level + 1, bands + 1):
            up |= up + 1
            after[curve, above] = up
        for below in range(level - 1, -1, -1):
            down &= down - 1
            after[curve, below] = down
    return after


def _powers(wire: HeatedWire, angle: FloatArray, after: IntArray, interval: float) -> FloatArray:
    """Power (2^L, L + 1) that leads from each curve to each level in one interval."""
    levels = wire.operator.levels
    now = levels[[curve.bit_count() for curve in range(angle.size)]][:, None]
    gained = (wire.lag + interval) * (levels[None] - now)
    gained = gained + wire.latent * (angle[after] - angle[:, None])
    return np.asarray(now + gained / interval)


def _values(
    angle: FloatArray, after: IntArray, allowed: BoolArray, wanted: FloatArray
) -> FloatArray:
    """Least cost (N + 1, 2^L) of all that is to come, from each curve."""
    ahead = np.zeros((wanted.size + 1, angle.size))
    for k in range(wanted.size - 1, -1, -1):
        cost = (angle - wanted[k]) ** 2 + ahead[k + 1]
        ahead[k] = np.where(allowed, cost[after], np.inf).min(axis=1)
    return ahead


def _followed(
    angle: FloatArray,
    after: IntArray,
    allowed: BoolArray,
    power: FloatArray,
    wanted: FloatArray,
    ahead: FloatArray,
    curve: int,
) -> tuple[FloatArray, FloatArray]:
    """Angles and powers (N,) of going where cost now and cost to come are least together."""
    y, applied = np.empty(wanted.size), np.empty(wanted.size)
    for k in range(wanted.size):
        cost = (angle[after[curve]] - wanted[k]) ** 2 + ahead[k + 1][after[curve]]
        level = int(np.where(allowed[curve], cost, math.inf).argmin())
        applied[k] = power[curve, level]
        curve = int(after[curve, level])
        y[k] = angle[curve]
    return y, applied
