"""Checks of sensor readings: lost, stuck or implausible."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from minorloop.errors import ParameterError
from minorloop_head.control.controller import within

Fault: TypeAlias = Literal["", "lost", "stuck", "implausible", "unconfirmed", "reversed", "late"]
_SEEN, _SELDOM = 10, 0.1
"""A sensor is noisy if at least so many readings differed, and at most this share did not."""


@dataclass(frozen=True)
class Sensed:
    """State of a sensor."""

    value: float = math.nan
    """Usable reading, NaN if there is none now."""
    fault: Fault = ""
    """One of "", "lost", "stuck", "implausible", "unconfirmed", "reversed", "late". Fault of the
    sensor, once it is certain. That it is unconfirmed or reversed is found by
    `minorloop_head.control.motion`, that it is late by `minorloop_head.control.lateness`."""
    last: float = math.nan
    """Last plausible reading, NaN before the first."""
    repeats: int = 0
    """Number of equal readings since."""
    missing: int = 0
    odd: int = 0
    """Number of missing and of implausible readings, less those that the good ones since make up
    for."""
    good: int = 0
    """Number of usable readings since the sensor was at fault."""
    changes: int = 0
    equals: int = 0
    """How often a reading differed from the one before, and how often it did not; stuck runs do not
    count. They tell whether the sensor is noisy."""


@dataclass(frozen=True, kw_only=True)
class SensorWatch:
    """Separates usable readings from others.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    noise: float = 0.05
    """Standard deviation in degrees. A noisy sensor that repeats a reading is stuck. One without
    noise (0), or with steps as coarse as its noise, may repeat itself; that it is stuck is noticed
    only when a heated wire does not move."""
    repeats: int = 15
    """Equal readings in a row after which a noisy sensor is stuck."""
    patience: int = 5
    """Readings missing or implausible in a row after which the sensor is at fault."""
    recovery: int = 25
    """Usable readings after which it is trusted again, if it is not at fault anew between them."""
    low: float = -45.0
    high: float = 135.0
    """Limits of plausible angles, in degrees."""
    jump: float = 1.5
    """Most degrees by which two readings differ beside the motion of the wire, as in
    `minorloop_head.control.motion.MotionWatch`."""
    makes_up: int = 1
    """Missing or implausible readings that a usable one makes up for. With 1, a sensor of which
    more than half the readings are lost is at fault; with ``patience``, only those in a row
    count."""

    def __post_init__(self) -> None:
        within("noise", self.noise, 0.0, 100.0, "degrees")
        within("repeats", self.repeats, 2, 10_000)
        within("patience", self.patience, 1, 10_000)
        within("recovery", self.recovery, 1, 10_000)
        within("makes_up", self.makes_up, 1, 10_000)
        within("jump", self.jump, 1e-6, 1e6, "degrees")
        if not self.low < self.high:
            raise ParameterError(f"angles from {self.low} to {self.high}; give low < high")

    def step(self, state: Sensed, measurement: object, *, believed: bool = True) -> Sensed:
        """Return the state after one more reading of any kind.

        Parameters
        ----------
        state : Sensed
        measurement : object
            The reading.
        believed : bool
            Whether the wire can have turned as it says.
        """
        value = as_number(measurement)
        if math.isnan(value):
            missing = min(state.missing + 1, self.patience)
            known = replace(state, value=math.nan, missing=missing)
        elif not (believed and self.possible(value)):
            odd = min(state.odd + 1, self.patience)
            known = replace(state, value=math.nan, odd=odd)
        else:
            known = self._usable(state, value)
        if max(known.missing, known.odd) >= self.patience:
            known = replace(known, good=0)
        fault = self._fault(known)
        if not fault and not known.fault:
            return known
        return replace(known, fault=fault, value=math.nan if fault else known.value)

    def _usable(self, state: Sensed, value: float) -> Sensed:
        same = value == state.last
        repeats = state.repeats + 1 if same else 0
        before = self._repeated(state.changes, state.equals, state.repeats)
        ended = 0 if same or before else state.repeats
        changes, equals = state.changes + (not same), state.equals + ended
        stuck = self._repeated(changes, equals, repeats)
        return Sensed(
            value=value,
            fault=state.fault,
            last=value,
            repeats=repeats,
            missing=max(state.missing - self.makes_up, 0),
            odd=max(state.odd - self.makes_up, 0),
            good=0 if stuck else state.good + 1,
            changes=changes,
            equals=equals,
        )

    def possible(self, value: float) -> bool:
        """Whether a reading is in range."""
        return self.low <= value <= self.high

    def _repeated(self, changes: int, equals: int, repeats: int) -> bool:
        noisy = changes >= _SEEN and equals <= _SELDOM * changes
        return self.noise > 0 and noisy and repeats + 1 >= self.repeats

    def _fault(self, known: Sensed) -> Fault:
        if known.missing >= self.patience:
            return "lost"
        if known.odd >= self.patience:
            return "implausible"
        if self._repeated(known.changes, known.equals, known.repeats):
            return "stuck"
        return known.fault if known.fault and known.good < self.recovery else ""


def as_number(value: object) -> float:
    """Return a value as a float, NaN if it is not a number."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan
