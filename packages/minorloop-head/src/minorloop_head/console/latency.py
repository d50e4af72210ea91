"""Delay of head and picture after the operator's head, by stage."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.console.messages import Pair

STAGES = ("tracker", "network", "loop", "wire", "picture")
_LONGEST = 60.0
"""Newest seconds of following that count."""
_LEAST, _TURNED = 30.0, math.radians(2.0)
"""Least seconds, and least turn as a standard deviation in radians, for a delay to be estimated."""
_SLOWEST = 3.0
"""Longest delay in the search, in seconds."""


@dataclass(eq=False)
class Latency:
    """Ticks in which the head followed.

    ``interval``: length of a tick in seconds.
    """

    interval: float
    _ticks: deque[tuple[float, ...]] = field(init=False)

    def __post_init__(self) -> None:
        self._ticks = deque(maxlen=round(_LONGEST / self.interval))

    def note(
        self,
        *,
        tracker: float,
        waited: float,
        aimed: Pair,
        command: Pair,
        angle: Pair,
        picture: float,
    ) -> None:
        """Take in a tick: ages in seconds, and directions in radians.

        ``tracker``, ``waited``, ``picture``: age of the pose when it was sent, time from then to
        this tick, age of the picture; ``aimed``, ``command``, ``angle``: direction of the pose,
        commanded angle, and angle of the head.
        """
        self._ticks.append((tracker, waited, picture, *aimed, *command, *angle))

    def clear(self) -> None:
        """Forget all ticks."""
        self._ticks.clear()

    def stages(self) -> dict[str, float]:
        """Return the delay of each of `STAGES` in seconds; NaN if it cannot be estimated.

        The delay of the network is unknown: packets and pages have their own clocks.
        """
        if len(self._ticks) * self.interval < _LEAST:
            return dict.fromkeys(STAGES, math.nan)
        ticks = np.array(self._ticks)
        tracker, waited, picture = np.median(ticks[:, :3], axis=0).tolist()
        aimed, command, angle = ticks[:, 3:5], ticks[:, 5:7], ticks[:, 7:9]
        loop = waited + delay(aimed, command, self.interval)
        found = (tracker, math.nan, loop, delay(command, angle, self.interval), picture)
        return dict(zip(STAGES, found, strict=True))

    @property
    def words(self) -> str:
        """The known delays as a sentence; empty without one."""
        known = {name: value for name, value in self.stages().items() if math.isfinite(value)}
        said = ", ".join(f"{name} {1e3 * value:.0f} ms" for name, value in known.items())
        return f"behind your head: {said}" if said else ""


def delay(signal: FloatArray, response: FloatArray, interval: float) -> float:
    """Return the delay in seconds of a response (T, N) after a signal with the best fit.

    NaN if the signal hardly moved, or the response is later than the longest delay.
    """
    most = min(round(_SLOWEST / interval), len(signal) // 2)
    if np.std(signal, axis=0).max() < _TURNED:
        return math.nan
    off = []
    for shift in range(most + 1):
        apart = response[shift:] - signal[: len(signal) - shift]
        off.append(np.var(apart, axis=0).sum())
    best = int(np.argmin(off))
    return interval * best if best < most else math.nan
