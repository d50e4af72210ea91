"""State of the guard of one wire, and the entries of its log."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from minorloop_head.control.delays import Delays
from minorloop_head.control.lateness import Lateness, Stop
from minorloop_head.control.motion import Belief, Sign
from minorloop_head.control.observer import Estimate
from minorloop_head.control.reach import ReachState, Unreachable
from minorloop_head.control.sensing import Sensed
from minorloop_head.heated_wire import HeatedState

Cause: TypeAlias = Literal[
    "sensor",
    "sensor back",
    "unread",
    "read again",
    "reference",
    "clock",
    "hot",
    "unreachable",
    "reachable",
    "behind",
    "warm",
    "stress",
]
COOLED = ("lost", "stuck", "unconfirmed", "reversed")
"""Faults of the sensor at which the wire cools."""


@dataclass(frozen=True)
class Event:
    """Entry of the log."""

    step: int
    """Number of the step, from 1."""
    cause: Cause
    """Such as ``sensor`` or ``unreachable``."""
    text: str
    """A sentence."""


@dataclass(frozen=True)
class StepClock:
    """What is known of the time by the times of the steps."""

    t: float = math.nan
    """The newest accepted time in seconds, NaN if there was none."""
    waited: int = 0
    """Steps since."""
    strange: int = 0
    """Number of times in a row that differ from that clock, all by as much."""
    off: float = math.nan
    """By how much, in seconds."""


@dataclass(frozen=True, eq=False)
class GuardState:
    """State of the guard.

    Parameters
    ----------
    inner : state of the controller
    estimate : Estimate
        Of the wire.
    heated : float
        Effective power by the current alone, in A^2.
    sensed : Sensed
        Of the sensor.
    belief : Belief
        What is known of the angle by its readings.
    driven : HeatedState
        Wire by its current alone, whatever the readings say.
    bias : float
        Power that the surroundings added at the beginning, in A^2.
    sign : Sign
        What is known of the sign of the readings.
    lateness : Lateness
        What is known of how late they are.
    stop : Stop
        The same, where a motion gets slower.
    delays : Delays
        The same, by observers with other delays.
    reach : ReachState
        Of the target.
    reference : float
        Last target that was a number, in degrees.
    asked : float
        What it was computed from, in degrees; NaN if that was no number.
    applied : float
        Present current in A.
    steps : int
        Steps so far.
    clock : StepClock
        By the times of the steps.
    behind : float
        Seconds for which the wire has been behind a moving target at a limit.
    idle : float
        Seconds for which it has been above its target without a current.
    active : frozenset of str
        Causes that persist.
    log : tuple of Event
        The newest events, oldest first.
    """

    inner: Any
    estimate: Estimate
    heated: float
    driven: HeatedState
    bias: float
    reference: float
    applied: float
    sensed: Sensed = field(default_factory=Sensed)
    belief: Belief = field(default_factory=Belief)
    sign: Sign = field(default_factory=Sign)
    lateness: Lateness = field(default_factory=Lateness)
    stop: Stop = field(default_factory=Stop)
    delays: Delays = field(default_factory=Delays)
    reach: ReachState = field(default_factory=ReachState)
    asked: float = math.nan
    steps: int = 0
    clock: StepClock = field(default_factory=StepClock)
    behind: float = 0.0
    idle: float = 0.0
    active: frozenset[Cause] = frozenset()
    log: tuple[Event, ...] = ()

    @property
    def unreachable(self) -> Unreachable | None:
        """Why the target is out of reach, None if that is not known."""
        return self.reach.verdict

    @property
    def fault(self) -> str:
        """What is wrong with the sensor; empty if nothing is."""
        return self.sensed.fault

    @property
    def cools(self) -> bool:
        """Whether the wire cools for that."""
        return self.fault in COOLED
