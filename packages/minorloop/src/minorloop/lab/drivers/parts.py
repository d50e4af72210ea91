"""Protocols of the parts of a bench."""

import time
from collections.abc import Mapping
from typing import Any, Protocol

from minorloop.lab.actuator import Value

__all__ = ["Clock", "Closable", "Lines", "Meter", "Source", "WallClock"]


class Source(Protocol):
    """Sets the inputs of a plant."""

    def set(self, value: Any) -> None:
        """Apply inputs, a number for one, an array for several; return only when they are on."""

    def safe(self) -> None:
        """Go to a safe state; raise an error unless this is confirmed."""


class Meter(Protocol):
    """Reads the outputs of a plant."""

    def read(self) -> Value:
        """Return the outputs now, a number for one, an array for several."""


class Lines(Protocol):
    """Digital lines, such as for LEDs and a pump."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lines."""

    def switch(self, values: Mapping[str, bool]) -> None:
        """Switch lines on or off by their names; return only when they are."""


class Closable(Protocol):
    """What a bench closes at its end."""

    def close(self) -> None:
        """Close the connection."""


class Clock(Protocol):
    """Time in seconds."""

    def now(self) -> float:
        """Return the time since some origin."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class WallClock:
    """The clock of the machine."""

    def now(self) -> float:
        """Return the time since some origin, in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for a number of seconds."""
        time.sleep(seconds)
