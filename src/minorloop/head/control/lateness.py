"""Whether readings are later than they should be: at each stop of a motion, and at turns in a row.

A wire slows down when its current falls, at once: the rate of its angle is that of its temperature,
and this follows the power. At the end of a motion `StopWatch` compares by which delay the rate of
the readings follows the power. What makes a wire start later than its model expects, a colder room
or the width of the hysteresis, does not matter there.

An angle turns back when the temperature of its wire does: the output of the operator is monotone in
its input. The temperature turns back when the current changes so, whatever the surroundings are, as
long as they do not change. Readings that go on for some time after that, at one turn after the
other and for the same time, are late by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.control import _lateness_kernels as _kernels
from minorloop.head.control.controller import Loop, within
from minorloop.head.control.motion import WireWatch

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
_WINDOW, _RATE = 2.4, 4
"""Seconds of a motion up to its stop that are compared, and intervals in which a rate is taken."""
_OLDEST = 2.0
"""Seconds of lateness up to which a stop tells it: a network holds pictures back by as much. A turn
does not: a load that sways the wire slowly makes some that look so late."""
_SLOWER, _BACK = 2.0, 0.5
"""Degrees a second by which a motion must get slower from the first quarter of the window to the
last, and the most by which it may go back."""
_IN_TIME = 0.12
"""Seconds later than expected up to which readings are in time."""
_EXPLAINED, _BETTER = 0.9, 2.5
"""Share of the changes of the rate that a late response must explain, and by how many times less it
must leave unexplained than one in time: simulated readings in time reach one, but not the other."""
_VARIED = 0.05
"""Least standard deviation of the power in the window, as a share of the full power."""
_GAIN = 0.3, 1.5
"""Rate for a power over the largest one of the wire, least and most."""
_AGAIN = 5
"""Steps in a row in which this must be found."""
_SEEN = 0.5
"""Least share of the steps of a window in which there is a reading."""


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


def late_by(seconds: float) -> Lateness:
    """Return what is known of readings that are late by some seconds: for a while none is used."""
    return Lateness(late=seconds, doubted=_DOUBTED)


@dataclass(frozen=True, eq=False)
class Stop:
    """State of `StopWatch`.

    Parameters
    ----------
    recent : (2, n) array
        Powers in A^2 that were applied up to the newest readings, oldest first, and the readings in
        degrees, NaN where there was none.
    row : int
        Steps in a row in which they were late.
    late : float
        Age of the readings in seconds, 0 if they are not known to be late.
    """

    recent: FloatArray = field(default_factory=lambda: np.empty((2, 0)))
    row: int = 0
    late: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class StopWatch(WireWatch):
    """Finds readings that are late where a motion gets slower; parameters as of `WireWatch`.

    Notes
    -----
    With the effective power w and the slope s, dy/dt = s (p - w) / (tau + q s). Within seconds,
    w and s change slowly: the rate of the readings is regressed on the power some time before, on a
    constant and on time.
    """

    def step(self, before: Stop, reading: float, power: float, *, steps: int = 1) -> Stop:
        """Return what is known after one more reading.

        Parameters
        ----------
        before : Stop
        reading : float
            In degrees; NaN where there is none that is believed.
        power : float
            That was applied in the intervals up to it, in A^2.
        steps : int
            Number of these intervals.
        """
        recent = _kernels.added(before.recent, power, reading, steps, self._kept)
        late = self._late(recent)
        row = before.row + 1 if late else 0
        return Stop(recent, row, late if row >= _AGAIN else 0.0)

    def _late(self, recent: FloatArray) -> float:
        """Return after how many seconds the rate follows the power, 0 if in time or not known."""
        count, last = self._window, self._lags[-1]
        power, reading = recent
        if len(reading) < self._kept:
            return 0.0
        moved = (_SLOWER - _BACK) * _WINDOW / 4  # less cannot be such a motion
        over = _RATE, _RATE * self.interval
        rate = _kernels.slowing(reading, count, _SEEN, moved, over, _SLOWER, _BACK)
        if not rate.size:
            return 0.0
        mean = np.convolve(power, np.full(_RATE, 1.0 / _RATE), "valid")
        before = np.lib.stride_tricks.sliding_window_view(mean, count)[::-1][: last + 1]
        return self._compared(rate, before)

    def _compared(self, rate: FloatArray, before: FloatArray) -> float:
        """Return the age of late readings in s by a rate (n,) and the powers (lags, n) before."""
        rate, before = rate - self._fitted(rate), before - self._fitted(before)
        size, square = np.maximum((before**2).sum(axis=1), 1e-12), max(float(rate @ rate), 1e-12)
        gain = before @ rate / size
        explained = np.where(gain > 0, gain**2 * size / square, 0.0)
        in_time, late, _ = self._lags
        best = late + int(np.argmax(explained[late:]))
        left, otherwise = 1.0 - explained[best], 1.0 - explained[: in_time + 1].max()
        varied = size[best] >= (_VARIED * self.highest**2) ** 2 * len(rate)
        least, most = (share * self._fastest for share in _GAIN)
        good = varied and left <= 1.0 - _EXPLAINED and least <= gain[best] <= most
        if not good or best == len(explained) - 1 or otherwise < _BETTER * left:
            return 0.0
        return best * self.interval

    def _fitted(self, values: FloatArray) -> FloatArray:
        """Return the constant and the linear part of values (..., n)."""
        return np.asarray(values @ self._even @ self._even.T)

    @cached_property
    def _even(self) -> FloatArray:
        """Orthonormal constant and time (n, 2) of a window."""
        columns = np.stack([np.ones(self._window), np.arange(self._window)], axis=1)
        return np.asarray(np.linalg.qr(columns)[0])

    @cached_property
    def _window(self) -> int:
        return max(round(_WINDOW / self.interval), 8)

    @cached_property
    def _lags(self) -> tuple[int, int, int]:
        """Intervals up to which readings are in time, and from and up to which they are late."""
        in_time, first, last = (
            self.delay + round(t / self.interval) for t in (_IN_TIME, _LATER, _OLDEST)
        )
        return in_time, first, last

    @cached_property
    def _kept(self) -> int:
        """Intervals of a window and the longest lag before it."""
        return self._window + self._lags[-1] + _RATE


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
        return late_by(sum(turns) / len(turns))

    @cached_property
    def _due(self) -> float:
        """Seconds after a reversal at which the readings should turn."""
        return (self.delay + 1) * self.interval
