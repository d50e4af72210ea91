"""One level while it is held: its samples, its duration, and how well its times are known."""

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.plan import Plan
from minorloop.lab.records import Record

__all__ = ["Hold"]

JUDGEMENTS = 2
"""Judgements of the output in each window."""


class Hold:
    """A level that is held in stretches; the output is judged after each.

    Times are those of the records of the stretches; a record without ``timing`` counts as exactly
    as long as was asked for. The clock of the records may run on from one stretch to the next, or
    begin anew with each; then a stretch follows the end of the one before.

    Parameters
    ----------
    plan : Plan
        The plan.
    index : int
        The level, counted from 0.
    answer : float
        How long the meter takes for a reading, in seconds; 0 where it takes no time.

    Attributes
    ----------
    held : float
        How long the level has been held, in seconds.
    """

    def __init__(self, plan: Plan, index: int, answer: float = 0.0) -> None:
        self._plan, self._index, self._answer = plan, index, answer
        self._records: list[Record] = []
        self._offsets: list[float] = []  # added to the times of a record: one clock for all
        self._left = float(plan.longest[index])
        self.held = 0.0

    def stretches(self) -> Iterator[float]:
        """Yield the lengths of the stretches to come, in seconds.

        All but the last are whole numbers of sample intervals, so that samples stay evenly spaced.
        """
        pace = max(self._plan.sample_interval, self._answer)
        least = max(self._plan.sample_interval / 2, self._answer)
        stretch = float(self._plan.shortest[self._index])
        while self._left > (least if self.timed else 0.0) or not self._records:
            length = max(1, round(stretch / pace)) * pace
            if self._left - length < least:
                length = self._left
            yield length
            stretch = self._plan.window / JUDGEMENTS

    def add(self, record: Record, length: float) -> None:
        """Add a stretch that was carried out.

        Parameters
        ----------
        record : Record
            What the actuator returned.
        length : float
            How long it was asked to hold, in seconds.
        """
        before = self.held
        self._offsets.append(self._offset(record, length))
        self._records.append(record)
        if self.timed:
            self.held = self.ended - self.began
            if self.held > before:  # a clock may stand still
                length = self.held - before
        else:
            self.held += length
        self._left -= length

    @property
    def began(self) -> float:
        """When the input was on, by the clock of the actuator, in seconds."""
        timing = self._records[0].timing
        return float(self._records[0].t[0]) if timing is None else timing.began

    @property
    def ended(self) -> float:
        """When the latest stretch ended, by the clock of the actuator, in seconds."""
        timing = self._records[-1].timing
        ended = float(self._records[-1].t[-1]) if timing is None else timing.ended
        return ended + self._offsets[-1]

    @property
    def latest(self) -> float:
        """Latest sample of the output."""
        return float(self._records[-1].y[-1])

    @property
    def trace(self) -> tuple[FloatArray, FloatArray]:
        """Times since the level was applied, and outputs; (T,) each."""
        parts = zip(self._records, self._offsets, strict=True)
        t = np.concatenate([record.t + offset for record, offset in parts])
        y = np.concatenate([record.y for record in self._records])
        if self.timed:
            return t - self.began, y
        # The last sample is taken at the end of the hold, whatever the clock of the actuator says.
        return self.held + (t - t[-1]), y

    @property
    def uncertainty(self) -> float:
        """Largest error of a time of the hold, in seconds; 0 where times are exact."""
        return max(r.timing.uncertainty if r.timing else 0.0 for r in self._records)

    @property
    def sample_interval(self) -> float:
        """Time between samples on average, in seconds; NaN where there is only one."""
        if not self.timed:
            return self._plan.sample_interval
        t, _ = self.trace
        return float((t[-1] - t[0]) / (t.size - 1)) if t.size > 1 else float("nan")

    @property
    def timed(self) -> bool:
        """Whether the actuator measures when a hold begins and ends."""
        return bool(self._records) and all(record.timing for record in self._records)

    def _offset(self, record: Record, length: float) -> float:
        """Return what joins the times of a stretch to those before, in seconds."""
        if not self._records:
            return 0.0
        last, offset = self._records[-1], self._offsets[-1]
        first, end, before = float(record.t[0]), float(record.t[-1]), float(last.t[-1])
        if record.timing and last.timing:
            if first >= before:
                return offset
            return last.timing.ended + offset - record.timing.began
        # A single time after those before may still be one of a clock that begins anew.
        if first >= before and abs(end - before - length) <= abs(end - length):
            return offset
        return before + offset + max(length - end, -first)
