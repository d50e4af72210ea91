"""Whether readings are later than they should be.

An angle turns back when the temperature of its wire does: the output of the operator is monotone in
its input. The temperature turns back when the current changes so, whatever the surroundings are, as
long as they do not change. Readings that go on for some time after that, at one turn after the
other and for the same time, are late by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from minorloop.head.control.controller import Loop, within

_BEYOND, _ROUGH = 1.0 / 3.0, 3.0
"""Share of `jump`, and times the mean change of slope of the readings, by which they must go on:
the second is six standard deviations of noise."""
_GROWN = 0.05
"""Share of how far they went on by which they must go on further to count as still going."""
_LEARNED = 0.05
"""Share by which a change of slope changes the mean one."""
_LATER, _LONGEST = 0.2, 0.8
"""Seconds of lateness from which a turn counts, and up to which."""
_SHORTEST = 0.8
"""Seconds from a turn to the next, at least."""
_ALIKE = 0.12
"""Seconds by which the lateness of turns may differ."""
_TURNS = 4
"""Turns in a row that are late alike: a load that sways the wire moves it at one or two."""
_DOUBTED = 30.0
"""Seconds for which late readings are not used, until they are tried again."""


@dataclass(frozen=True)
class Lateness:
    """What is known of how late the readings are.

    Parameters
    ----------
    late : float
        Lateness in seconds, 0 if none is known.
    doubted : float
        Seconds for which late readings will not be used yet.
    power : float
        Power of the wire by its current alone, in A^2.
    way : int
        Direction of the last reversal of this power: 1 if it began to fall, -1 to rise, 0 before.
    age : float
        Seconds since that reversal.
    mark, extreme : float
        Reading when it should have turned, and the farthest one since, in degrees.
    went : float
        Seconds from the reversal until then.
    turns : tuple of float
        Lateness in seconds of the last turns that were late alike.
    before : tuple of float
        The last two readings in degrees.
    rough : float
        Mean change of slope from a reading to the next, in degrees.
    """

    late: float = 0.0
    doubted: float = 0.0
    power: float = math.nan
    way: int = 0
    age: float = 0.0
    mark: float = math.nan
    extreme: float = math.nan
    went: float = 0.0
    turns: tuple[float, ...] = ()
    before: tuple[float, ...] = ()
    rough: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class LatenessWatch(Loop):
    """Finds readings that are late while their times are current.

    Parameters
    ----------
    jump : float
        As in `minorloop.head.control.motion.WireWatch`.
    interval, delay, highest
        As in `Loop`.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    jump: float = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        within("jump", self.jump, 1e-6, 1e6, "degrees")

    def step(self, before: Lateness, reading: float, power: float, *, steps: int = 1) -> Lateness:
        """Return what is known after one more reading.

        Parameters
        ----------
        before : Lateness
        reading : float
            In degrees; NaN where there is none that is believed.
        power : float
            Of the wire by its current alone, in A^2.
        steps : int
            Intervals since the last reading was due.
        """
        passed = steps * self.interval
        if before.doubted > 0.0:
            doubted = before.doubted - passed
            return replace(before, doubted=doubted) if doubted > 0.0 else Lateness()
        way = before.way
        if power != before.power and not math.isnan(before.power):
            way = 1 if power < before.power else -1
        state = replace(before, power=power, age=before.age + passed)
        if way != before.way:
            state = replace(self._turned(state), way=way, age=0.0, mark=math.nan, went=0.0)
        if math.isnan(reading):
            return state
        return self._followed(self._with_noise(state, reading), reading)

    def _with_noise(self, state: Lateness, reading: float) -> Lateness:
        seen = (*state.before, reading)
        if len(seen) < 3:
            return replace(state, before=seen)
        bend = abs(seen[0] - 2.0 * seen[1] + seen[2])
        return replace(state, before=seen[1:], rough=state.rough + _LEARNED * (bend - state.rough))

    def _followed(self, state: Lateness, reading: float) -> Lateness:
        """Return the state with how far the readings went on since the last reversal."""
        if state.way == 0 or state.age < self._due:
            return state
        if math.isnan(state.mark):
            return replace(state, mark=reading, extreme=reading, went=self._due)
        further = state.way * (reading - state.extreme)
        if further > max(_GROWN * abs(state.extreme - state.mark), state.rough):
            return replace(state, extreme=reading, went=state.age)
        return state

    def _turned(self, state: Lateness) -> Lateness:
        """Return the state at the next reversal: whether the readings were late at the last one."""
        if math.isnan(state.mark) or state.age < _SHORTEST:
            return state
        beyond = state.way * (state.extreme - state.mark)
        late = state.went - self._due
        far = beyond > max(_BEYOND * self.jump, _ROUGH * state.rough)
        if not (far and _LATER <= late <= _LONGEST):
            return replace(state, turns=())
        turns = (*state.turns, state.went)
        while max(turns) - min(turns) > _ALIKE:
            turns = turns[1:]
        if len(turns) < _TURNS:
            return replace(state, turns=turns)
        return Lateness(late=sum(turns) / len(turns), doubted=_DOUBTED)

    @cached_property
    def _due(self) -> float:
        """Seconds after a reversal at which the readings should turn."""
        return (self.delay + 1) * self.interval
