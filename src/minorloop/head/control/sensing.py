"""Whether a reading can be believed: lost, stuck, or out of this world."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from minorloop.errors import ParameterError
from minorloop.head.control.controller import within

Fault: TypeAlias = Literal["", "lost", "stuck", "implausible"]
_SEEN, _SELDOM = 10, 0.1
"""A sensor is noisy if so many readings differed, and no more than this share did not."""


@dataclass(frozen=True)
class Sensed:
    """What is known of a sensor.

    Parameters
    ----------
    value : float
        Reading that can be used, NaN if there is none now.
    fault : {"", "lost", "stuck", "implausible"}
        What is wrong with the sensor, once it is certain.
    last : float
        Last reading that was plausible, NaN before the first.
    repeats : int
        How often it has come again since.
    missing, odd, good : int
        Readings that were not there and that were implausible, less those since that were
        not; readings in a row that can be used.
    changes, equals : int
        How often a reading differed from the one before, and how often not, runs that were
        found to be stuck left out: what tells a noisy sensor.
    """

    value: float = math.nan
    fault: Fault = ""
    last: float = math.nan
    repeats: int = 0
    missing: int = 0
    odd: int = 0
    good: int = 0
    changes: int = 0
    equals: int = 0


@dataclass(frozen=True, kw_only=True)
class SensorWatch:
    """Tells readings that can be believed from others.

    Parameters
    ----------
    noise : float
        Standard deviation in degrees. A sensor that has been seen to be noisy and repeats itself
        is stuck; one without noise (0), or one with steps as coarse as its noise, may repeat
        itself, and a stuck one shows only in that a heated wire does not move.
    repeats : int
        Equal readings in a row after which a noisy sensor is stuck.
    patience : int
        Readings missing or implausible in a row after which the sensor is at fault.
    recovery : int
        Usable readings in a row after which it is trusted again.
    low, high : float
        Between which angles are plausible, in degrees.
    jump : float
        Largest plausible difference between two readings, in degrees.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    noise: float = 0.05
    repeats: int = 15
    patience: int = 5
    recovery: int = 25
    low: float = -45.0
    high: float = 135.0
    jump: float = 20.0

    def __post_init__(self) -> None:
        within("noise", self.noise, 0.0, 100.0, "degrees")
        within("repeats", self.repeats, 2, 10_000)
        within("patience", self.patience, 1, 10_000)
        within("recovery", self.recovery, 1, 10_000)
        within("jump", self.jump, 1e-6, 1e6, "degrees")
        if not self.low < self.high:
            raise ParameterError(f"angles from {self.low} to {self.high}; give low < high")

    def step(self, state: Sensed, measurement: object) -> Sensed:
        """What is known after one more reading, whatever it may be."""
        value = as_number(measurement)
        if math.isnan(value):
            missing = min(state.missing + 1, self.patience)
            known = replace(state, value=math.nan, missing=missing, good=0)
        elif not self._plausible(state, value):
            odd = min(state.odd + 1, self.patience)
            known = replace(state, value=math.nan, odd=odd, good=0)
        else:
            known = self._usable(state, value)
        fault = self._fault(known)
        return replace(known, fault=fault, value=math.nan if fault else known.value)

    def _usable(self, state: Sensed, value: float) -> Sensed:
        same = value == state.last
        repeats = state.repeats + 1 if same else 0
        ended = 0 if same or self._repeated(state, state.repeats) else state.repeats
        known = replace(
            state,
            value=value,
            last=value,
            repeats=repeats,
            missing=max(state.missing - 1, 0),
            odd=max(state.odd - 1, 0),
            changes=state.changes + (not same),
            equals=state.equals + ended,
        )
        return replace(known, good=0 if self._repeated(known, repeats) else state.good + 1)

    def _plausible(self, state: Sensed, value: float) -> bool:
        """In range, and near the last reading unless that was long ago."""
        if not self.low <= value <= self.high:
            return False
        stale = state.missing + state.odd >= self.patience or math.isnan(state.last)
        return stale or abs(value - state.last) <= self.jump

    def _repeated(self, known: Sensed, repeats: int) -> bool:
        noisy = known.changes >= _SEEN and known.equals <= _SELDOM * known.changes
        return self.noise > 0 and noisy and repeats + 1 >= self.repeats

    def _fault(self, known: Sensed) -> Fault:
        if known.missing >= self.patience:
            return "lost"
        if known.odd >= self.patience:
            return "implausible"
        if self._repeated(known, known.repeats):
            return "stuck"
        return known.fault if known.fault and known.good < self.recovery else ""


def as_number(value: object) -> float:
    """A float, NaN if it is none."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan
