"""Whether readings are older than they should be: observers with longer delays are compared.

Late readings make a loop swing, and an observer that believes them errs. So does one whose
surroundings have changed: a colder wire starts later. Beside the observer of a loop run some with
longer delays, and some in time but with a colder or a warmer wire. Readings are late if one of the
first expects them much better than each of the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import width
from minorloop_head.control.observer import Estimate, PowerObserver

_ERRS = 0.5
"""Degrees by which readings must differ from what the loop expects for a comparison to begin."""
_BACK = 1.5
"""Seconds before that at which it begins: the estimate of the loop was still right then."""
_LONGEST, _CALM = 6.0, 2.0
"""Seconds after which it ends, and seconds in which the loop expects the readings to half of
`_ERRS`."""
_COLDER = -0.25, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1
"""Powers that the surroundings may add to those that the loop knows, as shares of the range."""
_ENDURED = 0.16, 0.28
"""Seconds by which readings may be later and a loop still comes to rest, nearer to its target than
by its model alone."""
_LATER = 0.4, 0.48, 0.6, 0.72, 0.88, 1.08, 1.32, 1.6, 2.0
"""Seconds by which they may be too late; the last is there to show that they are later still."""
_WITHIN = 0.8
"""Time constant in seconds of the mean squares that are compared."""
_LEAST, _BETTER, _ROW = 0.5, 2.2, 5
"""Rms error in degrees of all that are in time, how many times smaller that of a later one must be,
and for how many readings in a row. By trial on simulated heads with late readings and such in time;
``python -m benchmarks.late_readings`` counts how many of both are called late."""
_MOVED = 3.0
"""Degrees by which the readings of the last `_BACK` must vary: noise has no delay."""

_Moment: TypeAlias = tuple[Estimate, float, float]
"""Estimate of the loop, the current in A that was then applied, and the reading after it."""


@dataclass(frozen=True, eq=False)
class _Comparison:
    """Estimates of the observers, in the order of `DelayWatch._observers`.

    ``squares`` are their mean square errors in degrees^2, not yet divided by ``weight``; ``steps``
    counts those since the beginning, ``calm`` those in a row in which the loop erred little, and
    ``row`` those in which the readings were late.
    """

    estimates: tuple[Estimate, ...]
    squares: FloatArray
    weight: float = 0.0
    steps: int = 0
    calm: int = 0
    row: int = 0


@dataclass(frozen=True, eq=False)
class Delays:
    """State of `DelayWatch`."""

    recent: tuple[_Moment, ...] = ()
    """The last moments, oldest first: the estimate of the loop, the current in A that was applied
    then, and the reading after it in degrees, NaN where there was none."""
    comparison: _Comparison | None = None
    """The present one."""
    late: float = 0.0
    """Age of the readings in seconds, 0 if they are not known to be late."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DelayWatch:
    """Finds readings that are late by comparing observers."""

    observer: PowerObserver
    """That of the loop."""

    def step(
        self,
        before: Delays,
        estimate: Estimate,
        current: float,
        reading: float,
        *,
        expected: float,
        steps: int = 1,
    ) -> Delays:
        """Return what is known after one more reading.

        Parameters
        ----------
        before : Delays
        estimate : Estimate
            Of the loop, before the current was applied.
        current : float
            In A, that was on until the reading.
        reading : float
            In degrees; NaN where there is none that is believed.
        expected : float
            What the loop expects, in degrees.
        steps : int
            Intervals since the last reading was due.
        """
        lost: _Moment = (estimate, current, math.nan)
        new = [lost] * min(steps - 1, self._kept) + [(estimate, current, reading)]
        recent = (*before.recent, *new)[-self._kept :]
        error, found = abs(reading - expected), before.comparison
        if not math.isnan(reading) and self._ended(before.recent):
            found = None
        if found is None:
            if not error > _ERRS:
                return Delays(recent)
            first = self._first(recent)
            found, new = self._begun(recent[: first + 1]), list(recent[first:])
        for moment in new:
            found = self._advanced(found, *moment[1:])
        calm = 0 if error > 0.5 * _ERRS else found.calm + steps
        late = self._late(found, recent)
        row = found.row + 1 if late else 0
        if calm >= self._count(_CALM) or found.steps >= self._count(_LONGEST):
            return Delays(recent)
        return Delays(recent, replace(found, calm=calm, row=row), late if row >= _ROW else 0.0)

    def _ended(self, recent: tuple[_Moment, ...]) -> bool:
        """Return whether the readings have ended: those that a network held back come late then."""
        last = recent[-self._count(_ENDURED[0]) :]
        return bool(last) and all(math.isnan(reading) for _, _, reading in last)

    def _first(self, recent: tuple[_Moment, ...]) -> int:
        """Return the moment at which a comparison begins: where readings ended, if they did so."""
        first = max(len(recent) - self._count(_BACK), 0)
        if self._ended(recent[:-1]):
            while len(recent) > first + 1 and not math.isnan(recent[first][2]):
                first += 1
        return first

    def _begun(self, recent: tuple[_Moment, ...]) -> _Comparison:
        """Return the comparison that begins at the last of some moments."""
        now = recent[-1][0]
        angles = [moment[0].wire.angle for moment in reversed(recent)]
        angles += [angles[-1]] * self._kept
        estimates = [
            replace(now, ambient=now.ambient + more, error=0.0, past=tuple(angles[: each.delay]))
            for each, more in self._observers
        ]
        return _Comparison(tuple(estimates), np.zeros(len(estimates)))

    def _advanced(self, before: _Comparison, current: float, reading: float) -> _Comparison:
        """Return the comparison one interval later."""
        share = self.observer.interval / _WITHIN
        squares, estimates = before.squares.copy(), []
        for k, ((observer, _), last) in enumerate(
            zip(self._observers, before.estimates, strict=True)
        ):
            predicted = observer.predicted(last, current)
            if not math.isnan(reading):
                squares[k] += share * ((reading - predicted.expected) ** 2 - squares[k])
            estimates.append(observer.corrected(predicted, reading))
        weight = before.weight + share * (1.0 - before.weight) * (not math.isnan(reading))
        return replace(
            before,
            estimates=tuple(estimates),
            squares=squares,
            weight=weight,
            steps=before.steps + 1,
        )

    def _late(self, found: _Comparison, recent: tuple[_Moment, ...]) -> float:
        """Return the age of the readings in s, 0 if those in time explain them."""
        borne = len(_COLDER) + len(_ENDURED)
        in_time, later = np.split(found.squares / max(found.weight, 1e-9), [borne])
        best, least = int(np.argmin(later)), float(in_time.min())
        if not least > max(_LEAST**2, _BETTER**2 * later[best]) or best == len(later) - 1:
            return 0.0
        newest = [reading for _, _, reading in recent[-self._count(_BACK) :]]
        read = [reading for reading in newest if not math.isnan(reading)]
        if not read or max(read) - min(read) < _MOVED:
            return 0.0
        return self._observers[borne + best][0].delay * self.observer.interval

    def _count(self, seconds: float) -> int:
        return max(round(seconds / self.observer.interval), 1)

    @cached_property
    def _kept(self) -> int:
        """Moments from which the observer with the longest delay can begin."""
        return self._count(_BACK) + max(observer.delay for observer, _ in self._observers)

    @cached_property
    def _observers(self) -> tuple[tuple[PowerObserver, float], ...]:
        """Observers, with the power in A^2 that their surroundings add at the beginning."""
        most = width(self.observer.wire)
        colder = [(self.observer, share * most) for share in _COLDER]
        times = (*_ENDURED, *_LATER)
        return (*colder, *((self.observer.later(self._count(t)), 0.0) for t in times))
