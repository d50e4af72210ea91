"""Base of camera and probe: devices on the head, which turn and travel with it."""

from __future__ import annotations

from minorloop.arrays import as_finite
from minorloop_head.geometry import Mount


class Mounted:
    """A device on the head.

    ``mount``: place of the head in the pipe; on the axis without it.
    """

    def __init__(self, mount: Mount | None) -> None:
        self._mount = mount or Mount()
        self._pan, self._tilt, self._rates = 0.0, 0.0, (0.0, 0.0)
        self._clock = 0.0

    @property
    def clock(self) -> float:
        """Time at which the next frame begins or the next pulse is fired, in seconds."""
        return self._clock

    def look(self, pan: float, tilt: float, *, rates: tuple[float, float] = (0.0, 0.0)) -> None:
        """Set the angles of the head now, and their rates.

        ``pan`` and ``tilt``: in radians; ``rates``: of pan and tilt, in radians per second.
        """
        self._pan, self._tilt = as_finite("pan", pan), as_finite("tilt", tilt)
        self._rates = (as_finite("rate of pan", rates[0]), as_finite("rate of tilt", rates[1]))

    def move(self, mount: Mount) -> None:
        """Move the head to another place in the pipe."""
        self._mount = mount

    def _advance(self, seconds: float) -> None:
        """Advance the clock: the head continues to turn."""
        self._clock += seconds
        self._pan += seconds * self._rates[0]
        self._tilt += seconds * self._rates[1]
