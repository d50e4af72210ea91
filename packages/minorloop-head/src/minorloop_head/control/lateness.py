"""Detection of late readings: at the end of a motion, and by observers with longer delays.

A wire slows down at once when its current falls: the rate of its angle is that of its temperature,
which follows the power. At the end of a motion the rate of the readings is compared with earlier
power. A colder room or the width of the hysteresis make a wire start later than its model expects,
but do not delay its stop.

Late readings make a loop oscillate, and mislead its observer. So do changed surroundings: a colder
wire starts later. Beside the observer of the loop run observers with longer delays, and observers
without delay but with a colder or a warmer wire. Readings are late if one of the former predicts
them much better than each of the latter.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop_head.control import _observer_kernels
from minorloop_head.control.controller import width
from minorloop_head.control.observer import Estimate, PowerObserver

_LATER = 0.2
"""Least lateness in seconds that a stop shows."""
_DOUBTED = 30.0
"""Seconds for which late readings are not used before they are tried again."""
_WINDOW, _RATE = 2.4, 4
"""Compared seconds of a motion before its stop, and intervals over which a rate is taken."""
_OLDEST = 2.0
"""Largest lateness in seconds that a stop shows: a network delays pictures by as much."""
_SLOWER, _BACK = 2.0, 0.5
"""Least decrease of the rate in degrees per second from the first quarter of the window to the
last, and largest reverse rate."""
_IN_TIME = 0.12
"""Largest delay in seconds of readings in time."""
_EXPLAINED, _BETTER = 0.9, 2.5
"""Least share of the changes of the rate that a late response explains, and least ratio of the
unexplained changes of one in time to its own: simulated readings in time never reach both."""
_VARIED = 0.05
"""Least standard deviation of the power in the window, as a share of the full power."""
_GAIN = 0.3, 1.5
"""Least and largest rate per power, over the largest one of the wire."""
_AGAIN = 5
"""Consecutive steps in which this must be found."""
_SEEN = 0.5
"""Least share of the steps of a window in which there is a reading."""
_BEFORE = 1.5
"""Seconds by which a comparison begins earlier: the estimate of the loop was still right then."""
_ERRS = 0.5
"""Least error in degrees of the readings expected by the loop that starts a comparison."""
_LONGEST, _CALM = 6.0, 2.0
"""Seconds after which it ends, and seconds with errors below half of `_ERRS` that end it."""
_COLDER = -0.25, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1
"""Powers that the surroundings may add to those known by the loop, as shares of the range."""
_ENDURED = 0.16, 0.28
"""Tolerable delays in seconds: the loop still comes to rest, nearer to its target than by its model
alone."""
_DELAYS = 0.4, 0.48, 0.6, 0.72, 0.88, 1.08, 1.32, 1.6, 2.0
"""Delays in seconds that are too long; the last one detects even longer ones."""
_WITHIN = 0.8
"""Time constant in seconds of the compared mean squares."""
_LEAST, _NEARER = 0.5, 2.2
"""Least rms error in degrees of all observers in time, and least ratio of it to that of a later
one. By trial on simulated heads with late readings and readings in time;
``python -m benchmarks.late_readings`` counts how many of both are called late."""
_MOVED = 3.0
"""Least range in degrees of the readings of the last `_BEFORE`: noise has no delay."""
_ROOM = 64
"""Initial capacity of memories, in extrema."""


class _Comparison(NamedTuple):
    """Estimates of the observers, in the order of `_DelayWatch._observers`."""

    values: FloatArray
    past: FloatArray
    stacks: FloatArray
    rows: IntArray
    squares: FloatArray
    """Estimates (N, 6), their past angles (N, D), memories (N, rows, 4) and rows in use (N,), and
    mean square errors (N,) in degrees^2, not yet divided by ``weight``; see `_observer_kernels`."""
    weight: float = 0.0
    steps: int = 0
    """Steps since the beginning."""
    calm: int = 0
    row: int = 0
    """Consecutive steps in which the loop erred little, and in which the readings were late."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _DelayWatch:
    """Finds readings that are late by comparing observers."""

    observer: PowerObserver
    """Observer of the loop."""

    def step(
        self,
        before: _Comparison | None,
        recent: FloatArray,
        estimates: tuple[Estimate, ...],
        error: float,
        *,
        steps: int = 1,
    ) -> tuple[_Comparison | None, float]:
        """Return the comparison after one more reading, and the age of late ones in s; 0 if none.

        ``before``: None without a comparison. ``recent`` (3, n): powers in A^2 up to the newest
        readings, angles of the loop before them, and readings in degrees, NaN without a trusted
        one; oldest first. ``estimates``: of the loop, before the last powers. ``error``: newest
        reading less the one expected by the loop, in degrees. ``steps``: intervals since the last
        reading was due.
        """
        powers, angles, readings = recent
        first, found = max(len(readings) - steps, 0), before
        if not np.isnan(error) and self._readings_ended(readings[:first]):
            found = None
        if found is None:
            if not abs(error) > _ERRS:
                return None, 0.0
            first = self._first_index(readings)
            found = self._begin(estimates[first - len(readings)], angles[first::-1])
        found = self._advance(found, powers[first:], readings[first:])
        calm = 0 if abs(error) > 0.5 * _ERRS else found.calm + steps
        late = self._late(found, readings)
        row = found.row + 1 if late else 0
        if calm >= self._count(_CALM) or found.steps >= self._count(_LONGEST):
            return None, 0.0
        return found._replace(calm=calm, row=row), late if row >= _AGAIN else 0.0

    def compile(self) -> None:
        """Compile the comparison, which a loop with small errors does not reach."""
        nothing = np.empty(0)
        self._advance(self._begin(self.observer.found(), np.zeros(1)), nothing, nothing)

    def _readings_ended(self, readings: FloatArray) -> bool:
        """Return whether the readings have stopped: those that a network delays come late then."""
        last = readings[-self._count(_ENDURED[0]) :]
        return bool(last.size and np.isnan(last).all())

    def _first_index(self, readings: FloatArray) -> int:
        """Return the index at which a comparison begins: where readings stopped, if they did."""
        first = max(len(readings) - self._count(_BEFORE), 0)
        if self._readings_ended(readings[:-1]):
            while len(readings) > first + 1 and not np.isnan(readings[first]):
                first += 1
        return first

    def _begin(self, estimate: Estimate, angles: FloatArray) -> _Comparison:
        """Return the comparison that begins at an estimate; angles before are newest first."""
        wire, count = estimate.wire, len(self._delays)
        values = np.tile(estimate.values, (count, 1))
        values[:, _observer_kernels.AMBIENT] += self._colder
        values[:, _observer_kernels.ERROR] = 0.0
        past = np.full(int(self._delays.max()), angles[-1])
        past[: len(angles)] = angles[: len(past)]
        stack, rows = wire.tracker.model.stack(wire.tracker.memory, _ROOM)
        copies = np.tile(stack, (count, 1, 1))
        return _Comparison(
            values, np.tile(past, (count, 1)), copies, np.full(count, rows), np.zeros(count)
        )

    def _advance(
        self, before: _Comparison, powers: FloatArray, readings: FloatArray
    ) -> _Comparison:
        """Return the comparison some intervals later."""
        share = self.observer.interval / _WITHIN
        most = int(before.rows.max()) + 2 * len(powers) + 2  # an interval adds two rows at most
        room = max(most - before.stacks.shape[1], 0)
        stacks = np.pad(before.stacks, ((0, 0), (0, room), (0, 0)))
        values, past, squares = (
            each.copy() for each in (before.values, before.past, before.squares)
        )
        rows = before.rows.copy()
        wire = self.observer.wire.operator
        _observer_kernels.compare(
            wire.tables, stacks, rows, self.observer.constants, wire.range, self._gains,
            self._delays, values, past, squares, powers, readings, share,
        )  # fmt: skip
        read = int(np.isfinite(readings).sum())
        weight = 1.0 - (1.0 - before.weight) * (1.0 - share) ** read
        steps = before.steps + len(powers)
        return _Comparison(
            values, past, stacks, rows, squares, weight, steps, before.calm, before.row
        )

    def _late(self, found: _Comparison, readings: FloatArray) -> float:
        """Return the age of the readings in s, 0 if an observer in time explains them."""
        borne = len(_COLDER) + len(_ENDURED)
        in_time, later = np.split(found.squares / max(found.weight, 1e-9), [borne])
        best, least = int(np.argmin(later)), float(in_time.min())
        if not least > max(_LEAST**2, _NEARER**2 * later[best]) or best == len(later) - 1:
            return 0.0
        newest = readings[-self._count(_BEFORE) :]
        read = newest[np.isfinite(newest)]
        if not read.size or np.ptp(read) < _MOVED:
            return 0.0
        return float(self._delays[borne + best]) * self.observer.interval

    def _count(self, seconds: float) -> int:
        return max(round(seconds / self.observer.interval), 1)

    @cached_property
    def _observers(self) -> tuple[PowerObserver, ...]:
        later = (self.observer.later(self._count(t)) for t in (*_ENDURED, *_DELAYS))
        return (*[self.observer] * len(_COLDER), *later)

    @cached_property
    def _delays(self) -> IntArray:
        return np.array([each.delay for each in self._observers])

    @cached_property
    def _gains(self) -> FloatArray:
        return np.array([each.gains for each in self._observers])

    @cached_property
    def _colder(self) -> FloatArray:
        """Power (N,) in A^2 of the surroundings at the beginning, beyond that known by the loop."""
        colder = np.zeros(len(self._observers))
        colder[: len(_COLDER)] = np.array(_COLDER) * width(self.observer.wire)
        return colder


@dataclass(frozen=True, eq=False)
class Lateness:
    """State of the detection of late readings."""

    recent: FloatArray = field(default_factory=lambda: np.empty((3, 0)))
    """Shape (3, n). Powers in A^2 that were applied up to the newest readings, angles of the
    estimates before them, and readings in degrees, NaN where there was none; oldest first."""
    estimates: tuple[Estimate, ...] = ()
    """The last of these estimates."""
    comparison: _Comparison | None = None
    """Comparison of observers with longer delays, while readings differ from expected ones."""
    row: int = 0
    """Consecutive steps in which a stop showed that they were late."""
    late: float = 0.0
    """Age of late readings in seconds; 0 if they are not known to be late."""
    doubted: float = 0.0
    """Remaining seconds for which late readings are not used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LatenessWatch:
    """Finds late readings: when a motion gets slower, and by observers with longer delays.

    Notes
    -----
    With the effective power w and the slope s, dy/dt = s (p - w) / (tau + q s). Within seconds,
    w and s change slowly: the rate of the readings is regressed on earlier power, on a constant and
    on time. If the loop oscillates, they do change, and the observers find late readings; if
    readings become late at rest, or by 2 s, the regression does.
    """

    observer: PowerObserver
    """Observer of the loop."""

    def step(
        self,
        before: Lateness,
        estimate: Estimate,
        current: float,
        reading: float,
        *,
        expected: float,
        steps: int = 1,
    ) -> Lateness:
        """Return the state after one more reading; late readings are not used for some time.

        ``estimate``: of the loop, before the current was applied. ``current``: in A, applied until
        the reading. ``reading``: in degrees; NaN without a trusted one. ``expected``: the reading
        that the loop expects, in degrees. ``steps``: intervals since the last reading was due.
        """
        recent = _observer_kernels.added(
            before.recent, current**2, estimate.wire.angle, reading, steps, self._kept
        )
        back = max(round(_BEFORE / self.observer.interval), 1)
        estimates = (*before.estimates, *[estimate] * min(steps, back))[-back:]
        comparison, found = self._delays.step(
            before.comparison, recent, estimates, reading - expected, steps=steps
        )
        late = self._late(recent)
        row = before.row + 1 if late else 0
        late = late if row >= _AGAIN else found
        if late:
            return Lateness(recent, estimates, comparison, row, late, _DOUBTED)
        left = max(before.doubted - steps * self.observer.interval, 0.0)
        kept = before.late if left else 0.0
        return Lateness(recent, estimates, comparison, row, kept, left)

    @cached_property
    def _delays(self) -> _DelayWatch:
        watch = _DelayWatch(observer=self.observer)
        watch.compile()
        return watch

    def _late(self, recent: FloatArray) -> float:
        """Return the delay in seconds of the rate after the power, 0 if in time or not known."""
        count, last = self._window, self._lags[-1]
        power, _, reading = recent
        if len(reading) < self._kept:
            return 0.0
        moved = (_SLOWER - _BACK) * _WINDOW / 4  # fewer readings cannot show a motion
        over = _RATE, _RATE * self.observer.interval
        rate = _observer_kernels.slowing(reading, count, _SEEN, moved, over, _SLOWER, _BACK)
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
        varied = size[best] >= (_VARIED * self.observer.highest**2) ** 2 * len(rate)
        least, most = (share * self.observer.wire.fastest for share in _GAIN)
        good = varied and left <= 1.0 - _EXPLAINED and least <= gain[best] <= most
        if not good or best == len(explained) - 1 or otherwise < _BETTER * left:
            return 0.0
        return best * self.observer.interval

    def _fitted(self, values: FloatArray) -> FloatArray:
        """Return the constant and the linear part of values (..., n)."""
        return np.asarray(values @ self._basis @ self._basis.T)

    @cached_property
    def _basis(self) -> FloatArray:
        """Orthonormal constant and time (n, 2) of a window."""
        columns = np.stack([np.ones(self._window), np.arange(self._window)], axis=1)
        return np.asarray(np.linalg.qr(columns)[0])

    @cached_property
    def _window(self) -> int:
        return max(round(_WINDOW / self.observer.interval), 8)

    @cached_property
    def _lags(self) -> tuple[int, int, int]:
        """Intervals up to which readings are in time, and the range in which they are late."""
        in_time, first, last = (
            self.observer.delay + round(t / self.observer.interval)
            for t in (_IN_TIME, _LATER, _OLDEST)
        )
        return in_time, first, last

    @cached_property
    def _kept(self) -> int:
        """Intervals of a window and the longest lag before it."""
        return self._window + self._lags[-1] + _RATE
