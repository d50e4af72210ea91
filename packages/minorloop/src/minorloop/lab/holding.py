"""One level while it is held: its samples, its duration, and the uncertainty of its times."""

import math
from collections.abc import Iterator

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.plan import Plan
from minorloop.lab.records import Record


class Hold:
    """A level that is held in stretches; the output is judged after each.

    A record without ``timing`` counts as exactly as long as requested, with its last sample at the
    end. The clock of other records may continue from one stretch to the next, or restart with each;
    then a stretch follows the end of the previous one.

    ``plan``: the plan; ``index``: the level, counted from 0; ``answer``: time that the meter takes
    for a reading, in seconds; 0 if it takes no time.

    Attributes
    ----------
    held : float
        Time for which the level has been held, in seconds.
    timed : bool
        Whether the actuator measures when a hold begins and ends.
    began : float
        Time when the input was on, by the clock of the actuator, in seconds; NaN if not timed.
    uncertainty : float
        Largest error of a time of the hold, in seconds; 0 if times are exact.
    """

    def __init__(self, plan: Plan, index: int, answer: float = 0.0) -> None:
        self._plan, self._index, self._answer = plan, index, answer
        self._t: list[FloatArray] = []
        self._y: list[FloatArray] = []
        self._left = float(plan.longest[index])
        self._on, self._latest = 0.0, -math.inf  # when the input was on, and the latest sample
        self.held, self.timed, self.began, self.uncertainty = 0.0, False, math.nan, 0.0

    def stretches(self) -> Iterator[float]:
        """Yield the lengths of the next stretches, in seconds.

        All but the last are whole numbers of sample intervals, so that samples stay evenly spaced.
        """
        pace = max(self._plan.sample_interval, self._answer)
        least = max(self._plan.sample_interval / 2, self._answer)
        stretch = float(self._plan.shortest[self._index])
        while self._left > (least if self.timed else 0.0) or not self._t:
            length = max(1, round(stretch / pace)) * pace
            if self._left - length < least:
                length = self._left
            yield length
            stretch = self._plan.window / 2  # judgements of the output in each window

    def add(self, record: Record, length: float) -> None:
        """Add a finished stretch.

        ``record``: record from the actuator; ``length``: requested duration of the stretch, in
        seconds.
        """
        before, timing = self.held, record.timing
        if timing is None:
            self.held += length
            t = self.held + (record.t - record.t[-1])
        else:
            if not self._t:
                self.timed, self.began = True, timing.began
            if record.t[0] < self._latest or not self._t:  # a clock that restarts
                self._on = timing.began - before
            self._latest, t = float(record.t[-1]), record.t - self._on
            self.held = timing.ended - self._on
            self.uncertainty = max(self.uncertainty, timing.uncertainty)
            if self.held > before:  # a clock may have stopped
                length = self.held - before
        self._t.append(t)
        self._y.append(record.y)
        self._left -= length

    @property
    def ended(self) -> float:
        """End of the latest stretch, by the clock of the actuator, in seconds."""
        return self.began + self.held

    @property
    def latest(self) -> float:
        """Latest sample of the output."""
        return float(self._y[-1][-1])

    @property
    def trace(self) -> tuple[FloatArray, FloatArray]:
        """Times since the level was applied, and outputs; (T,) each."""
        return np.concatenate(self._t), np.concatenate(self._y)

    @property
    def sample_interval(self) -> float:
        """Mean time between samples, in seconds; NaN for a single sample."""
        if not self.timed:
            return self._plan.sample_interval
        t, _ = self.trace
        return float((t[-1] - t[0]) / (t.size - 1)) if t.size > 1 else math.nan
