"""Whether readings are later than they should be, where a motion gets slower.

A wire slows down when its current falls, at once: the rate of its angle is that of its temperature,
and this follows the power. At the end of a motion `StopWatch` compares by which delay the rate of
the readings follows the power. What makes a wire start later than its model expects, a colder room
or the width of the hysteresis, does not matter there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control import _lateness_kernels as _kernels
from minorloop_head.control.motion import WireWatch

_LATER = 0.2
"""Seconds of lateness from which a stop tells it."""
_DOUBTED = 30.0
"""Seconds for which late readings are not used, until they are tried again."""
_WINDOW, _RATE = 2.4, 4
"""Seconds of a motion up to its stop that are compared, and intervals in which a rate is taken."""
_OLDEST = 2.0
"""Seconds of lateness up to which it does: a network holds pictures back by as much."""
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
    """What is known of how late the readings are."""

    late: float = 0.0
    """Lateness in seconds, 0 if none is known."""
    doubted: float = 0.0
    """Seconds for which late readings will not be used yet."""

    def later(self, passed: float, found: float) -> Lateness:
        """Return what is known some seconds later; it begins anew if it was ``found`` again.

        Parameters
        ----------
        passed : float
            In seconds.
        found : float
            Age of the readings in seconds, 0 if they are not known to be late.
        """
        if found > 0.0:
            return Lateness(found, _DOUBTED)
        doubted = self.doubted - passed
        return Lateness(self.late, doubted) if doubted > 0.0 else Lateness()


@dataclass(frozen=True, eq=False)
class Stop:
    """State of `StopWatch`."""

    recent: FloatArray = field(default_factory=lambda: np.empty((2, 0)))
    """Shape (2, n). Powers in A^2 that were applied up to the newest readings, oldest first, and
    the readings in degrees, NaN where there was none."""
    row: int = 0
    """Steps in a row in which they were late."""
    late: float = 0.0
    """Age of the readings in seconds, 0 if they are not known to be late."""


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
