"""Hypotheses about the surroundings of a wire that is being heated.

A hypothesis is a change of the ambient and of the convection since identification. The wire is
simulated under all hypotheses at once, on the rising branch of its operator. The weight of a
hypothesis follows from its errors; each predicts the angle that full current would reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.head.control.observer import Estimate

_AMBIENTS = np.arange(-65.0, 30.1, 2.5)
_COOLINGS = np.exp(np.concatenate([np.linspace(-0.3, 0.6, 13), np.linspace(0.75, 3.5, 9)]))
"""Ambients in K and convections as ratios, both relative to identification: from a cold room to a
flooded pipe."""
_TABLE = 257
"""Points of the table of the rising branch."""
_MODEL_ERROR, _MOST_MISS = 1.0, 5.0
"""Standard deviation of the model's error in degrees; errors beyond 5 of them count as 5."""
_DECORRELATION, _MEMORY = 0.5, 6.0
"""Seconds between independent errors, and after which errors are forgotten."""
_LIKELY, _SELDOM_BOTH = (15.0, 0.7), (5.0, 0.07)
"""Scales of the prior weights in K and as logarithm of the convection: of each alone, and of both
together."""
_ITERATIONS = 4
"""Of the fixed point for the final angle; the resistance varies little with the angle."""


@dataclass(frozen=True, eq=False)
class Bank:
    """State of the hypotheses.

    Parameters
    ----------
    power : (M,) array
        Effective power of the wire under each, in A^2.
    cost : (M,) array
        Sum of squared independent errors of each within the last seconds.
    branch : (257,) array
        Angle on the rising branch at equal steps of the effective power, in degrees.
    """

    power: FloatArray
    cost: FloatArray
    branch: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypotheses:
    """Ambients from -65 to +30 K, convections from 0.74 to 33 times those at identification.

    Parameters
    ----------
    wire : HeatedWire
        As it was identified.
    rise : float
        Steady rise of the temperature of a hot wire for a heating power, in K per A^2.
    cold_resistance : float
        Resistance of a cold wire over that of a hot one: a degree of the ambient equals more
        power where the resistance is lower.
    """

    wire: HeatedWire
    rise: float
    cold_resistance: float

    def begin(self, angle: float, estimate: Estimate, *, moving: bool) -> Bank:
        """Return the bank before a heating.

        Parameters
        ----------
        angle : float
            Now, in degrees.
        estimate : Estimate
            Of the wire now.
        moving : bool
            Whether the angle determines the effective power. If not, the wire has settled in
            its surroundings.
        """
        grid = np.linspace(self._low, self._high, _TABLE)
        state = estimate.wire
        if moving:
            power = np.full(self.ambient.size, state.power)
            rising = np.maximum(grid, state.power)
            branch = self.wire.operator.simulate(rising, state.tracker.memory)
        else:
            left = max(state.power - estimate.ambient, 0.0)
            power = self.ambient / self.cold_resistance + left
            branch = self.wire.operator.simulate(grid)
        return Bank(power, np.zeros(power.size), np.maximum.accumulate(branch))

    def step(self, bank: Bank, current: float, measurement: float, interval: float) -> Bank:
        """Return the bank after an interval with a current; the measurement may be NaN."""
        place, share = self._place(bank.power)
        angle = _between(bank.branch, place, share)
        slope = (bank.branch[place + 1] - bank.branch[place]) * self._per_unit
        gap = current**2 - self.cooling * (bank.power - self._equivalent(angle))
        stiff = self.wire.lag + self.cooling * interval + self.wire.latent * slope
        cost = bank.cost
        if np.isfinite(measurement):
            miss = np.minimum(np.abs(measurement - angle) / _MODEL_ERROR, _MOST_MISS)
            news = miss**2 * (interval / _DECORRELATION)
            cost = cost * np.exp(-interval / _MEMORY) + news
        return Bank(bank.power + interval * gap / stiff, cost, bank.branch)

    def weights(self, bank: Bank) -> FloatArray:
        """Return the weight (M,) of each hypothesis; they sum to 1."""
        weight = self._prior * np.exp(-0.5 * (bank.cost - bank.cost.min()))
        return np.asarray(weight / weight.sum())

    def final(self, bank: Bank, angle: float, current: float) -> FloatArray:
        """Return the final angle (M,) under a current for each hypothesis, in degrees.

        Its error at the present angle is assumed to remain.
        """
        at = _between(bank.branch, *self._place(bank.power))
        error = angle - at
        for _ in range(_ITERATIONS):
            power = self._equivalent(at) + current**2 / self.cooling
            at = _between(bank.branch, *self._place(power))
        return np.asarray(np.minimum(at + error, self.wire.operator.range[1]))

    @staticmethod
    def independent(seconds: float) -> float:
        """Return the number of independent readings in a cost after some seconds."""
        return min(seconds, _MEMORY) / _DECORRELATION

    @cached_property
    def ambient(self) -> FloatArray:
        """Power (M,) in A^2 to which the ambient of each hypothesis is equivalent, hot wire."""
        return np.repeat(_AMBIENTS, _COOLINGS.size) / self.rise

    @cached_property
    def cooling(self) -> FloatArray:
        """Convection (M,) of each hypothesis over that at identification."""
        return np.tile(_COOLINGS, _AMBIENTS.size)

    @cached_property
    def _prior(self) -> FloatArray:
        """Prior weights: ambient or convection may differ much, seldom both."""
        cold, windy = np.abs(self.ambient) * self.rise, np.abs(np.log(self.cooling))
        both = np.minimum(cold / _SELDOM_BOTH[0], windy / _SELDOM_BOTH[1])
        return np.asarray(np.exp(-cold / _LIKELY[0] - windy / _LIKELY[1] - both))

    @cached_property
    def _low(self) -> float:
        return float(self.wire.operator.levels[0])

    @cached_property
    def _high(self) -> float:
        return float(self.wire.operator.levels[-1])

    @cached_property
    def _per_unit(self) -> float:
        return (_TABLE - 1) / (self._high - self._low)

    def _place(self, power: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the position of powers in the table: index to the left, and share of the step."""
        place = np.clip((power - self._low) * self._per_unit, 0.0, _TABLE - 1.000001)
        left = place.astype(np.int64)
        return left, place - left

    def _equivalent(self, angle: FloatArray) -> FloatArray:
        """Return the power to which each ambient is equivalent for a wire at an angle, in A^2."""
        low, high = self.wire.operator.range
        hot = np.clip((angle - low) / (high - low), 0.0, 1.0)
        return self.ambient / (self.cold_resistance + (1.0 - self.cold_resistance) * hot)


def _between(table: FloatArray, left: IntArray, share: FloatArray) -> FloatArray:
    return np.asarray(table[left] + share * (table[left + 1] - table[left]))
