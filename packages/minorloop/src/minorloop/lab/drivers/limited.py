"""Limits of value and rate, which every command to a driver passes through."""

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, LimitError
from minorloop.lab.actuator import ROUNDING, Channel, Value, check_input
from minorloop.lab.drivers.parts import Clock, Source

__all__ = ["LimitedSource"]


class LimitedSource:
    """A source that refuses inputs beyond limits, changes that are too fast, NaN and infinity.

    One command changes an input by at most its rate limit times the time since the last command,
    and a tick at most. After a command that failed, nothing is set until `safe` has succeeded.

    Parameters
    ----------
    source : Source
        Sets all inputs at once: a number for one, an array for several.
    channels : tuple of Channel
        The inputs.
    rest : (channels,) array
        The inputs that are on when the source is safe.
    tick : float
        In seconds.
    clock : Clock
    """

    def __init__(
        self,
        source: Source,
        channels: tuple[Channel, ...],
        rest: FloatArray,
        tick: float,
        clock: Clock,
    ) -> None:
        self.source, self._channels, self._clock = source, channels, clock
        self._rates = np.array([channel.rate for channel in channels])
        self.rest, self.present, self._tick = rest, rest.copy(), tick
        self._changed, self._known = -math.inf, True

    @property
    def due(self) -> float:
        """Time on the clock from which a change may be as large as the rate allows in a tick."""
        return self._changed + self._tick if np.isfinite(self._rates).any() else -math.inf

    def nearest(self, wanted: npt.ArrayLike) -> FloatArray:
        """Return the inputs (channels,) on the way to ``wanted`` that are allowed now."""
        most = self._most()
        return np.asarray(np.clip(wanted, self.present - most, self.present + most))

    def set(self, value: Value) -> None:
        """Apply inputs.

        Raises
        ------
        LimitError
            If a number is not finite, or beyond a limit or a rate limit; nothing is sent then.
        InstrumentError
            If the source fails, or has failed and was not made safe since.
        """
        values = check_input(self._channels, value)
        most, change = self._most(), np.abs(values - self.present)
        if (change > most * (1 + ROUNDING) + ROUNDING * np.abs(self.present)).any():
            k = int(np.argmax(change - most))
            channel = self._channels[k]
            raise LimitError(
                f"{channel.name} from {self.present[k]:g} to {values[k]:g} {channel.unit} is "
                f"faster than the limit {channel.rate:g} {channel.unit}/s; nothing was applied"
            )
        if not self._known:
            raise InstrumentError("the last command failed; make the source safe first")
        self._known = False
        self.source.set(float(values[0]) if values.size == 1 else values)
        self.present, self._changed, self._known = values, self._clock.now(), True

    def safe(self) -> None:
        """Go to the safe inputs, however far they are; raise an error unless confirmed."""
        self.source.safe()
        self.present, self._known = self.rest.copy(), True

    def _most(self) -> FloatArray:
        """Return the largest change (channels,) that is allowed now."""
        now = self._clock.now()
        gone = self._tick if now >= self._changed + self._tick else now - self._changed
        unlimited = np.isinf(self._rates)
        return np.where(unlimited, np.inf, np.where(unlimited, 0.0, self._rates) * gone)
