"""The sensors of the simulated axes: noise, and faults for tests of a loop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray, as_finite, check_kind, check_option
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Channel
from minorloop.twins.simulated_actuator import gaussian

_BLOCK = 1024
"""Random numbers in a block: 2048 take less than three times the 60 us of one."""


@dataclass(frozen=True)
class SimulatedFault:
    """A sensor that fails for a while.

    Raises
    ------
    ParameterError
        If the kind is unknown, or the times are not in order.
    """

    channel: str
    """Name of the output channel, such as ``pan``."""
    kind: str
    """``stuck`` repeats the last reading before the fault, noise and all (the first reading of the
    fault where there is none before); ``lost`` reads NaN."""
    at: float
    until: float = math.inf
    """Start and end on the clock of the twin, in seconds; permanent without ``until``."""

    def __post_init__(self) -> None:
        check_option("kind", self.kind, ("stuck", "lost"))
        for name in ("at", "until"):
            value = getattr(self, name)
            if name == "at" or value != math.inf:
                object.__setattr__(self, name, as_finite(name, value))
        if not self.until > self.at:
            raise ParameterError(f"the fault is from {self.at} to {self.until} s; give at < until")


class Sensor:
    """Turns true outputs into readings; the noise depends on the seed and the sample number.

    Raises a `ParameterError` if the noise is negative, an item is not a fault, or a fault names no
    channel.

    ``outputs``: the output channels; ``noise``: standard deviation, in the unit of each channel;
    ``seed``: seed of the noise; ``faults``: times in which readings fail.
    """

    def __init__(
        self,
        outputs: tuple[Channel, ...],
        noise: float,
        seed: int,
        faults: Sequence[SimulatedFault],
    ) -> None:
        self.noise, self.seed = as_finite("noise", noise), seed
        if self.noise < 0:
            raise ParameterError(f"noise is {noise}; give a standard deviation >= 0")
        if not isinstance(faults, Iterable):
            raise ParameterError(
                f"faults is {faults!r}; give a list of SimulatedFault, empty for none"
            )
        self.faults = tuple(faults)
        names = [channel.name for channel in outputs]
        for fault in self.faults:
            check_kind("a fault", fault, SimulatedFault)
            check_option("channel of the fault", fault.channel, names)
        self._columns = [names.index(fault.channel) for fault in self.faults]
        self._count = len(names)
        self._block = (-1, np.empty(0))
        self.reset()

    def reset(self) -> None:
        """Restart the noise and forget the last reading."""
        self.samples = 0
        self.last: FloatArray = np.full(self._count, math.nan)

    def read(self, t: FloatArray, y: FloatArray) -> FloatArray:
        """Return readings (T, channels) of true outputs y (T, channels) at times t (T,)."""
        if self.noise > 0:
            y = y + self.noise * self._numbers(self.samples * self._count, y.size).reshape(y.shape)
        self.samples += len(y)
        for fault, column in zip(self.faults, self._columns, strict=True):
            failed = np.flatnonzero((t >= fault.at) & (t < fault.until))
            if failed.size:
                y[failed, column] = self._failed(fault, column, y, int(failed[0]))
        self.last = y[-1].copy()
        return y

    def _failed(self, fault: SimulatedFault, column: int, y: FloatArray, first: int) -> float:
        if fault.kind == "lost":
            return math.nan
        before = self.last[column] if first == 0 else y[first - 1, column]
        return float(y[first, column] if np.isnan(before) else before)

    def _numbers(self, first: int, count: int) -> FloatArray:
        """Return standard normal numbers (count,), drawn in blocks, which is faster.

        Number n does not depend on the block.
        """
        number, block = self._block
        begin = first - number * _BLOCK
        if number < 0 or begin < 0 or begin + count > block.size:
            number = first // _BLOCK
            begin = first - number * _BLOCK
            block = gaussian(self.seed, number * _BLOCK, max(2 * _BLOCK, begin + count))
            self._block = number, block
        return block[begin : begin + count]
