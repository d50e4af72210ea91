"""A bank of hypotheses about the surroundings of a wire that is being heated.

Each says how much colder or warmer the ambient is than when the wire was identified, and how
many times stronger the convection. The wire is simulated under all of them at once, on the
rising branch of its operator; how well each explains the readings is its weight, and where full
current would take the wire is what it foretells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.head.control.heating import HeatedWire
from minorloop.head.control.observer import Estimate

_AMBIENTS = np.arange(-65.0, 30.1, 2.5)
_COOLINGS = np.exp(np.concatenate([np.linspace(-0.3, 0.6, 13), np.linspace(0.75, 3.5, 9)]))
_TABLE = 257
_MODEL_ERROR = 1.0
_MOST_MISS = 5.0
_DECORRELATION = 0.5
_MEMORY = 6.0
_LIKELY = (15.0, 0.7)
_SELDOM_BOTH = (5.0, 0.07)
_ITERATIONS = 4


@dataclass(frozen=True, eq=False)
class Bank:
    """What the hypotheses say now.

    Parameters
    ----------
    power : (M,) array
        Effective power of the wire under each, in A^2.
    cost : (M,) array
        Squared errors of each within the last seconds, counted as often as they are
        independent.
    branch : (257,) array
        Angle on the rising branch at equal steps of the effective power, in degrees.
    """

    power: FloatArray
    cost: FloatArray
    branch: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypotheses:
    """Ambients from -65 to +30 K of that at identification, convections from 0.74 to 33 times.

    Parameters
    ----------
    wire : HeatedWire
        As it was identified.
    rise : float
        Steady rise of the temperature of a hot wire for a heating power, in K per A^2.
    cold_resistance : float
        Resistance of a cold wire over that of a hot one: a degree of the ambient is worth more
        power where the resistance is less.
    """

    wire: HeatedWire
    rise: float
    cold_resistance: float

    def begin(self, angle: float, estimate: Estimate, *, moving: bool) -> Bank:
        """The bank before a heating.

        Parameters
        ----------
        angle : float
            Now, in degrees.
        estimate : Estimate
            Of the wire now.
        moving : bool
            Whether the angle tells the effective power. If it does not, the wire has been in
            its surroundings for long.
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
        """The bank after a current was on for an interval; NaN where there is no reading."""
        place, share = self._place(bank.power)
        angle = _between(bank.branch, place, share)
        slope = (bank.branch[place + 1] - bank.branch[place]) * self._per_unit
        gap = current**2 - self.cooling * (bank.power - self._worth(angle))
        stiff = self.wire.lag + self.cooling * interval + self.wire.latent * slope
        cost = bank.cost
        if np.isfinite(measurement):
            miss = np.minimum(np.abs(measurement - angle) / _MODEL_ERROR, _MOST_MISS)
            news = miss**2 * (interval / _DECORRELATION)
            cost = cost * np.exp(-interval / _MEMORY) + news
        return Bank(bank.power + interval * gap / stiff, cost, bank.branch)

    def weights(self, bank: Bank) -> FloatArray:
        """Weight (M,) of each hypothesis; they sum to 1."""
        weight = self._prior * np.exp(-0.5 * (bank.cost - bank.cost.min()))
        return np.asarray(weight / weight.sum())

    def final(self, bank: Bank, angle: float, current: float) -> FloatArray:
        """Where a current ends under each (M,), in degrees.

        What a hypothesis misses of the present angle, it is taken to miss then.
        """
        at = _between(bank.branch, *self._place(bank.power))
        missed = angle - at
        for _ in range(_ITERATIONS):
            power = self._worth(at) + current**2 / self.cooling
            at = _between(bank.branch, *self._place(power))
        return np.asarray(np.minimum(at + missed, self.wire.operator.range[1]))

    @staticmethod
    def independent(seconds: float) -> float:
        """How many independent readings a cost after so many seconds counts."""
        return min(seconds, _MEMORY) / _DECORRELATION

    @cached_property
    def ambient(self) -> FloatArray:
        """Worth of the ambient of each (M,) for a hot wire, in A^2."""
        return np.repeat(_AMBIENTS, _COOLINGS.size) / self.rise

    @cached_property
    def cooling(self) -> FloatArray:
        """Convection of each (M,) over that at identification."""
        return np.tile(_COOLINGS, _AMBIENTS.size)

    @cached_property
    def _prior(self) -> FloatArray:
        """Mild weights: either ambient or convection is off by much, seldom both."""
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
        """Where powers lie in the table: index to the left, and share of the step."""
        place = np.clip((power - self._low) * self._per_unit, 0.0, _TABLE - 1.000001)
        left = place.astype(np.int64)
        return left, place - left

    def _worth(self, angle: FloatArray) -> FloatArray:
        """Power that each ambient is worth for a wire at an angle, in A^2."""
        low, high = self.wire.operator.range
        hot = np.clip((angle - low) / (high - low), 0.0, 1.0)
        return self.ambient / (self.cold_resistance + (1.0 - self.cold_resistance) * hot)


def _between(table: FloatArray, left: IntArray, share: FloatArray) -> FloatArray:
    return np.asarray(table[left] + share * (table[left + 1] - table[left]))
