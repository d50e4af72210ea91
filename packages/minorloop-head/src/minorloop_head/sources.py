"""Protocols of a camera and an ultrasonic probe, and their data; for simulated and real ones."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray

__all__ = ["EchoSource", "Frame", "FrameSource", "Shot"]


@dataclass(frozen=True, eq=False)
class Frame:
    """An image and its time."""

    t: float
    """Time on the clock of the plant, in seconds."""
    image: npt.NDArray[np.uint8]
    """(height, width) or (height, width, 3) array of uint8. Row 0 is the top."""


@dataclass(frozen=True, eq=False)
class Shot:
    """An ultrasonic trace and the time of its pulse."""

    t: float
    """Time on the clock of the plant, in seconds."""
    trace: FloatArray
    """Shape (T,). Samples since the pulse was fired."""
    sample_interval: float
    """Time between samples, in seconds."""


@runtime_checkable
class FrameSource(Protocol):
    """A camera."""

    def frame(self) -> Frame:
        """Return the next image."""


@runtime_checkable
class EchoSource(Protocol):
    """An ultrasonic probe."""

    def shot(self) -> Shot:
        """Fire one pulse, and return the received trace."""
