"""Read and check checkpoints of simulated actuators."""

import math
from reprlib import repr as short
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.lab.actuator import ROUNDING, Channel

_MOST_SAMPLES = 2**62
"""Most samples of a clock: a counter of 64 bits does not overflow."""


class Checkpoint:
    """Reads the parts of a checkpoint, and refuses impossible ones.

    ``parts``: the checkpoint, possibly read from JSON; ``identity``: options of the twin that must
    be equal, by name. Raises a `ParameterError` if it is not a checkpoint, or belongs to a twin
    with other options.
    """

    def __init__(self, parts: dict[str, Any], identity: dict[str, Any]) -> None:
        if not isinstance(parts, dict):
            raise ParameterError(f"the checkpoint is {short(parts)}; give a dict from checkpoint()")
        for name, own in identity.items():
            if name not in parts or parts[name] != own:
                raise ParameterError(
                    f"the checkpoint has {name} {short(parts.get(name))} and this twin "
                    f"{own!r}; restore it into a twin with the same options"
                )
        self._parts = parts

    def number(self, name: str, low: float, high: float) -> float:
        """Return a number within bounds."""
        value = float(self.array(name, np.zeros(())))
        if not low <= value <= high:
            raise damaged(f"{name} is {value:g}, not from {low:g} to {high:g}")
        return value

    def count(self, name: str, most: int = _MOST_SAMPLES) -> int:
        """Return a whole number from 0."""
        value = self._part(name)
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
            raise damaged(f"{name} is {short(value)}, not a whole number from 0 to {most}")
        return value

    def clock(self) -> float:
        """Return the simulated time since the start, in seconds."""
        # In seconds: beyond it, rounding of the clock loses steps of a millisecond
        return self.number("clock", 0.0, 1e12)

    def array(self, name: str, like: FloatArray) -> FloatArray:
        """Return finite numbers with the shape of ``like``."""
        values = self._numbers(name, self._part(name))
        if values.shape != like.shape or not np.isfinite(values).all():
            raise damaged(f"{name} is not {like.shape} finite numbers")
        return values

    def readings(self, name: str, like: FloatArray) -> FloatArray:
        """Return numbers with the shape of ``like``; None becomes NaN."""
        part = self._part(name)
        if not isinstance(part, list):
            raise damaged(f"{name} is not a list")
        values = self._numbers(name, [math.nan if each is None else each for each in part])
        if values.shape != like.shape or np.isinf(values).any():
            raise damaged(f"{name} is not {like.shape} readings")
        return values

    def inputs(self, name: str, channels: tuple[Channel, ...], like: FloatArray) -> FloatArray:
        """Return one number within the limits of each channel, with the shape of ``like``."""
        values = self.array(name, like)
        for channel, value in zip(channels, values.ravel().tolist(), strict=True):
            slack = ROUNDING * (channel.high - channel.low)
            if not channel.low - slack <= value <= channel.high + slack:
                raise damaged(f"{channel.name} is {value:g}, beyond its limits")
        return values

    def absent(self, name: str) -> bool:
        """Whether a part is None."""
        return self._part(name) is None

    def _part(self, name: str) -> Any:
        if name not in self._parts:
            raise damaged(f"it has no {name}")
        return self._parts[name]

    def _numbers(self, name: str, part: Any) -> FloatArray:
        try:
            return np.array(part, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise damaged(f"{name} is not made of numbers") from None


def damaged(why: str) -> ParameterError:
    """Return the error of an impossible checkpoint."""
    return ParameterError(f"the checkpoint is damaged: {why}; take another one")


def check_within(values: FloatArray, low: FloatArray, high: FloatArray, what: str) -> None:
    """Refuse values outside bounds of the physics, except for rounding.

    Raises a `ParameterError` that names the first of them.
    """
    slack = 1e-9 * (high - low)
    outside = (values < low - slack) | (values > high + slack)
    if outside.any():
        index = tuple(int(i) for i in np.argwhere(outside)[0])
        raise damaged(
            f"{what} {list(index)} is {values[index]:g}, not from {low[index]:g} to {high[index]:g}"
        )
