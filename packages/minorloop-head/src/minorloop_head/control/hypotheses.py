"""Hypotheses about the surroundings of a wire that is being heated.

A hypothesis is a change of the ambient or of the convection since identification, a resistance of
the cold wire, which nothing before has determined, and an error of the identified branch. The wire
is simulated under all hypotheses at once, on the rising branch of its operator. The weight of a
hypothesis follows from its errors; each predicts the angle that full current would reach.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop_head.control import _observer_kernels as _kernels
from minorloop_head.control.controller import HIGHEST_CURRENT
from minorloop_head.control.observer import Estimate
from minorloop_head.heated_wire import HeatedWire

_EACH = 8000
"""Number of hypotheses of a change of the ambient, and of a change of the convection: about thirty
of them lie within the model's error of the truth. They are drawn at random: points of an even
sequence lie on lines, and whole lines of them explain the readings equally."""
_AMBIENTS, _COOLINGS = (-65.0, 30.0), (-0.3, 3.5)
"""Ranges of changes of the ambient in K and of the logarithm of the convection: from a cold room to
a flooded pipe."""
_RESISTANCE_SPREAD = 0.08
"""Standard deviation of the cold over the hot resistance among wires; data sheets of
nickel-titanium give 0.7 to 0.9."""
_STEEPER = 0.06
"""Largest excess of the slope of the branch over the identified one. The holds of an
identification, 40 s, are three time constants of the slowest wires where they turn most: a
twentieth of the motion is missing at their end. Of 13 simulated wires the branch rises faster by up
to 6 % over nine tenths of the stroke; near its end some differ more, where it matters less."""
_TABLE = 257
"""Number of points in the table of the rising branch."""
_MODEL_ERROR, _MOST_MISS = 0.7, 5.0
"""Standard deviation of the model's error in degrees, about twice that of the best hypothesis on
cold wires; and limit of errors in standard deviations."""
_DECORRELATION, _MEMORY = 0.5, 6.0
"""Seconds between independent errors, and time constant of their decay."""
_LIKELY, _BESIDE = (15.0, 0.7), (5.0, 0.07)
"""Scales of the changes in K and of the logarithm of the convection: of a main change, and of the
other change beside it."""
_NEAR, _ITERATIONS = 0.01, 200
"""Change in degrees, and number of iterations, that end the fixed point for the final angle: in
deep cold the resistance feeds back up to nine tenths of a change of the angle."""


@dataclass(frozen=True, eq=False)
class Bank:
    """State of the hypotheses."""

    power: FloatArray
    """Shape (M,). Effective power of the wire under each, in A^2."""
    cost: FloatArray
    """Shape (M,). Sum of squared independent errors of each within the last seconds."""
    branch: FloatArray
    """Shape (257,). Angle on the rising branch at equal steps of the effective power, in
    degrees."""
    colder: float = 0.0
    """Least cost of a stronger cooling less that of a colder ambient."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypotheses:
    """Ambients from -65 to +30 K, convections from 0.74 to 33 times those at identification."""

    wire: HeatedWire
    """The identified wire."""
    rise: float
    """Steady rise of the temperature of a hot wire for a heating power, in K per A^2."""
    cold_resistance: float
    """Resistance of a cold wire over that of a hot one: if the resistance is lower, a degree of the
    ambient equals more power."""
    highest: float = HIGHEST_CURRENT
    """Largest current in A."""

    def begin(self, estimate: Estimate, *, moving: bool) -> Bank:
        """Return the bank before a heating.

        ``estimate``: of the wire now. ``moving``: whether the angle determines the effective power.
        If not, the wire has settled in its surroundings.
        """
        grid = np.linspace(self._low, self._high, _TABLE)
        state = estimate.wire
        if moving:
            power = np.full(self.ambient.size, state.power)
            rising = np.maximum(grid, state.power)
            branch = self.wire.operator.simulate(rising, state.tracker.memory)
        else:
            left = max(state.power - estimate.ambient, 0.0)
            power = self.ambient / self.resistance + left
            branch = self.wire.operator.simulate(grid)
        return Bank(power, np.zeros(power.size), np.maximum.accumulate(branch))

    def step(self, bank: Bank, current: float, measurement: float, interval: float) -> Bank:
        """Return the bank after an interval with a current; the measurement may be NaN."""
        wire, decay = self.wire, float(np.exp(-interval / _MEMORY))
        power, cost, colder = _kernels.advance(
            bank.power,
            bank.cost,
            bank.branch,
            self._low,
            self._per_unit,
            self._around,
            self.colder,
            wire.operator.range,
            (wire.lag, wire.latent),
            current**2,
            interval,
            measurement,
            (_MODEL_ERROR, _MOST_MISS, interval / _DECORRELATION, decay),
        )
        return Bank(power, cost, bank.branch, colder)

    def weights(self, bank: Bank) -> FloatArray:
        """Return the weight (M,) of each hypothesis; they sum to 1."""
        weight = self._prior * np.exp(-0.5 * (bank.cost - bank.cost.min()))
        return np.asarray(weight / weight.sum())

    def final(
        self,
        bank: Bank,
        angle: float,
        current: float,
        chosen: IntArray | None = None,
        beyond: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Return the final angle under a current for each chosen hypothesis, in degrees.

        Its error at the present angle is assumed to remain, and the branch to be higher by
        ``beyond`` degrees.
        """
        some = np.arange(bank.power.size) if chosen is None else chosen
        final: FloatArray = _kernels.settled(
            bank.power[some],
            bank.branch,
            self._low,
            self._per_unit,
            self._around[:, some],
            self.wire.operator.range,
            current**2,
            angle,
            np.broadcast_to(np.float64(beyond), some.shape),
            (_NEAR, _ITERATIONS),
        )
        return final

    @staticmethod
    def independent(seconds: float) -> float:
        """Return the number of independent readings in a cost after some seconds."""
        return min(seconds, _MEMORY) / _DECORRELATION

    @cached_property
    def ambient(self) -> FloatArray:
        """Power (M,) in A^2 to which the ambient of each hypothesis is equivalent, hot wire."""
        return np.asarray(self._drawn[0] / self.rise)

    @cached_property
    def cooling(self) -> FloatArray:
        """Convection (M,) of each hypothesis over that at identification."""
        return np.asarray(np.exp(self._drawn[1]))

    @cached_property
    def resistance(self) -> FloatArray:
        """Resistance (M,) of each hypothesis, cold over hot."""
        return np.asarray(self.cold_resistance + _RESISTANCE_SPREAD * self._drawn[2])

    @cached_property
    def steeper(self) -> FloatArray:
        """Slope (M,) of the branch of each hypothesis over that of the identified one."""
        return np.asarray(1.0 + _STEEPER * self._drawn[3])

    @cached_property
    def colder(self) -> IntArray:
        """Whether the ambient of each (M,) changes the reach more than its cooling: 1, else 0."""
        return (-self.ambient > self.highest**2 * (1.0 - 1.0 / self.cooling)).astype(np.intp)

    @cached_property
    def density(self) -> FloatArray:
        """Density (M,) of the drawn quantities of each hypothesis beside its change; at most 1.

        Weights do not contain it, as more hypotheses are drawn where it is higher. It is for
        comparing single hypotheses.
        """
        changes = np.abs(self._drawn[:2])
        beside = changes[1, :_EACH] / _BESIDE[1], changes[0, _EACH:] / _BESIDE[0]
        return np.asarray(np.exp(-np.concatenate(beside) - 0.5 * self._drawn[2] ** 2))

    @cached_property
    def _prior(self) -> FloatArray:
        """Prior weights (M,) of each hypothesis."""
        changes = np.abs(self._drawn[:2])
        unlikely = changes[0, :_EACH] / _LIKELY[0], changes[1, _EACH:] / _LIKELY[1]
        return np.asarray(np.exp(-np.concatenate(unlikely)))

    @cached_property
    def _drawn(self) -> FloatArray:
        """Changes of ambient and convection, resistances and errors of the branch, (4, M).

        Changes are in K, and of the logarithm of the convection. Either ambient or convection is
        drawn uniformly from its range, and the other from its prior, as is the resistance, in
        standard deviations. Errors of the branch are uniform shares of the largest one.
        """
        rng = np.random.default_rng(0)
        ambients, coolings = rng.uniform(*_AMBIENTS, _EACH), rng.uniform(*_COOLINGS, _EACH)
        first = [ambients, rng.laplace(scale=_BESIDE[1], size=_EACH)]
        second = [rng.laplace(scale=_BESIDE[0], size=_EACH), coolings]
        changes = np.concatenate([first, second], axis=1)
        resistances = rng.standard_normal((1, 2 * _EACH))
        return np.concatenate([changes, resistances, rng.random((1, 2 * _EACH))])

    @cached_property
    def _low(self) -> float:
        return float(self.wire.operator.levels[0])

    @cached_property
    def _high(self) -> float:
        return float(self.wire.operator.levels[-1])

    @cached_property
    def _per_unit(self) -> float:
        return (_TABLE - 1) / (self._high - self._low)

    @cached_property
    def _around(self) -> FloatArray:
        return np.array([self.ambient, self.cooling, self.resistance, self.steeper])
