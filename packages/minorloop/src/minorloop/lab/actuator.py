"""Protocols of a plant for simulated actuators and instruments."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import LimitError, ParameterError
from minorloop.files import check_name

if TYPE_CHECKING:
    from minorloop.lab.records import Record

Value: TypeAlias = float | FloatArray
"""A number for one channel, a (channels,) array for more."""

ROUNDING = 1e-12
"""Share of a channel's range by which an input may exceed a limit, because of rounding."""
SIX_DIGITS = 5e-6
"""Share of the range by which a written input may differ, because of rounding to six digits."""


@dataclass(frozen=True)
class Channel:
    """One input or output of a plant.

    Raises a `ParameterError` if the limits are not in order, the rate is not positive, or name or
    unit cannot be printed.

    Parameters
    ----------
    name : str
        Such as ``voltage``.
    unit : str
        Such as ``V``; empty for a pure number.
    low, high : float
        Hard limits in the unit of the channel, low below high; infinite if there are none.
    rate : float
        Fastest change allowed, in the unit of the channel per second.

    Examples
    --------
    >>> ml.Channel("voltage", "V", low=-1.2, high=1.2).unit
    'V'
    """

    name: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    rate: float = math.inf

    def __post_init__(self) -> None:
        check_name("the channel", self.name)
        check_name(f"the unit of channel {self.name}", self.unit)
        if not self.low < self.high:
            raise ParameterError(
                f"{self.name} has limits [{self.low}, {self.high}]; give low below high"
            )
        if not self.rate > 0:
            raise ParameterError(
                f"{self.name} has rate limit {self.rate}; give a positive rate or infinity"
            )

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@runtime_checkable
class Actuator(Protocol):
    """A plant with named inputs that can be set and named outputs that can be read.

    Examples
    --------
    >>> strip = ml.connect("twin:ipmc")
    >>> strip.apply(0.5, 10.0, 5.0).y.shape
    (2,)
    """

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """Input channels, with their limits."""

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """Output channels."""

    @property
    def tick(self) -> float:
        """Duration of one ``exchange``, in seconds."""

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input, and return a record of input and output.

        Raises a `LimitError` if the input is beyond a limit; nothing is applied then.

        Parameters
        ----------
        u : float or (channels,) array
            The input to hold, in the units of the channels.
        duration : float
            Duration of the hold, in seconds.
        sample_interval : float
            Time between samples, in seconds; the last sample is taken at the end of the hold.
            If a reading takes longer, there are fewer samples, and the hold ends in time.

        Returns
        -------
        Record
            Its times are those at which the output was read; they never decrease. They may
            continue from call to call, or restart with each call: if the times of a call begin
            before the last time of the previous call, the call counts as following its end. `run`
            holds a level in several calls. A plant whose exchanges take time gives in ``timing``
            when the hold really began and ended; without it, the hold counts as exactly
            ``duration`` long, with the last sample at its end.
        """

    def exchange(self, u: Value) -> Value:
        """Hold an input for one tick, and return the output at its end.

        Raises a `LimitError` if the input is beyond a limit; nothing is applied then.

        Parameters
        ----------
        u : float or (channels,) array
            The input, in its unit.
        """

    def safe(self) -> None:
        """Apply the safe input, which may stay on without supervision.

        It raises an error only if the plant is faulty.
        """


@runtime_checkable
class Timed(Protocol):
    """A plant that knows the answer time of its meter, so that too fast a plan can be refused."""

    def answer_time(self) -> float:
        """Return the time of one reading, in seconds: the median of the latest readings."""


@runtime_checkable
class Rounding(Protocol):
    """A plant whose source writes inputs with few digits; a plan can be checked for rounding."""

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied."""


def check_input(
    channels: tuple[Channel, ...],
    u: npt.ArrayLike,
    *,
    before: npt.ArrayLike | None = None,
    interval: float = 0.0,
) -> FloatArray:
    """Return an input as an array; refuse it if it is beyond the limits of a plant.

    An input that exceeds a limit by at most 1e-12 of the range (rounding) counts as at the limit.

    Raises a `LimitError` if a number is not finite, or beyond a limit or a rate limit; a
    `ParameterError` if there is not one real number for each channel.

    The input (channels,) is returned unchanged; it is not clipped.

    Parameters
    ----------
    channels : tuple of Channel
        The input channels.
    u : float or (channels,) array_like
        The requested input, in the units of the channels.
    before : float or (channels,) array_like, optional
        The present input; rate limits are checked against it.
    interval : float
        Time over which the input changes from ``before`` to ``u``, in seconds.
    """
    values = _one_each(channels, u)
    for channel, value in zip(channels, values, strict=True):
        if not _within(channel, value):
            unit = f" {channel.unit}" if channel.unit else ""
            raise LimitError(
                f"{channel.name} {value:.10g}{unit} is beyond the limits "
                f"[{channel.low:g}, {channel.high:g}]{unit}; nothing was applied"
            )
    if before is not None:
        _check_rates(channels, _one_each(channels, before), values, interval)
    return values


def one_or_all(values: FloatArray) -> Value:
    """Return a number for one channel, an array (channels,) for several channels."""
    return float(values[0]) if values.size == 1 else values


def rounded_up(seconds: float) -> float:
    """Return a time rounded up to two digits.

    ``seconds``: a positive time.
    """
    step = 10.0 ** (math.floor(math.log10(seconds)) - 1)
    return float(f"{step * math.ceil(seconds / step - 1e-9):.2g}")


def _one_each(channels: tuple[Channel, ...], u: npt.ArrayLike) -> FloatArray:
    names = ", ".join(str(channel) for channel in channels)
    if np.iscomplexobj(u):
        raise ParameterError(f"input {u!r} is complex; give real numbers for {names}")
    try:
        values = np.array(u, dtype=np.float64)
    except OverflowError:
        raise ParameterError(
            f"input is more than a float can hold; give one number for each of {names}"
        ) from None
    except (TypeError, ValueError):
        raise ParameterError(f"input {u!r} is not a number; give one for each of {names}") from None
    if values.ndim > 1 or values.size != len(channels):
        raise ParameterError(f"input has shape {values.shape}; give one number for each of {names}")
    return values.reshape(len(channels))


def _within(channel: Channel, value: float) -> bool:
    if not math.isfinite(value):
        return False
    width = channel.high - channel.low
    slack = ROUNDING * width if math.isfinite(width) else 0.0
    return channel.low - slack <= value <= channel.high + slack


def _check_rates(
    channels: tuple[Channel, ...], before: FloatArray, after: FloatArray, interval: float
) -> None:
    for channel, old, new in zip(channels, before, after, strict=True):
        slack = ROUNDING * abs(old)
        if abs(new - old) > channel.rate * interval * (1 + ROUNDING) + slack:
            raise LimitError(
                f"{channel.name} from {old:g} to {new:g} {channel.unit} in {interval:g} s is "
                f"faster than the limit {channel.rate:g} {channel.unit}/s; nothing was applied"
            )
