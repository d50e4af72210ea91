"""Actuators that wrap another actuator: converted, limited, or one channel of several."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import (
    InstrumentError,
    MinorloopError,
    ParameterError,
    SafetyError,
    SignalError,
)
from minorloop.lab.actuator import (
    Actuator,
    Channel,
    Rounding,
    Timed,
    Value,
    check_input,
    one_or_all,
)
from minorloop.lab.conversion import Conversion
from minorloop.lab.records import Quantity, Record


class WrappedActuator:
    """The base of actuators that change the inputs or outputs of another actuator.

    ``actuator``: the other actuator; ``restorable``: whether to offer its ``checkpoint`` and
    ``restore``, if it has them, so that a run restores it and does not replay it.
    """

    checkpoint: Callable[[], dict[str, Any]]
    restore: Callable[[dict[str, Any]], None]

    def __init__(self, actuator: Any, *, restorable: bool = True) -> None:
        self._actuator = actuator
        if restorable and hasattr(actuator, "restore"):
            self.checkpoint, self.restore = actuator.checkpoint, actuator.restore
        self.inputs: tuple[Channel, ...] = tuple(actuator.inputs)
        self.outputs: tuple[Channel, ...] = tuple(actuator.outputs)
        self.warnings: tuple[str, ...] = tuple(getattr(actuator, "warnings", ()))

    @property
    def tick(self) -> float:
        """Duration of one ``exchange``, in seconds."""
        tick: float = self._actuator.tick
        return tick

    @property
    def description(self) -> dict[str, Any] | None:
        """The instruments, as the actuator describes them; None if it does not."""
        found: dict[str, Any] | None = getattr(self._actuator, "description", None)
        return found

    def answer_time(self) -> float:
        """Return the time of one reading, in seconds; 0 if the actuator does not give it."""
        return self._actuator.answer_time() if isinstance(self._actuator, Timed) else 0.0

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied."""
        return self._actuator.written(u) if isinstance(self._actuator, Rounding) else u

    def safe(self) -> None:
        """Make the actuator safe."""
        self._actuator.safe()

    def close(self) -> None:
        """Close the connections of the actuator, if it has any."""
        getattr(self._actuator, "close", lambda: None)()


class LimitedActuator(WrappedActuator):
    """An actuator that gets only inputs within its limits, and is made safe after any error.

    ``actuator``: an actuator whose inputs have finite limits. Raises a `ParameterError` if a
    channel, a method or a limit is missing.
    """

    def __init__(self, actuator: Any) -> None:
        _check_actuator(actuator)
        super().__init__(actuator)
        self.serial: str | None = getattr(actuator, "serial", None)
        self._present: FloatArray | None = None
        if hasattr(self, "restore"):
            self.restore = self._restore

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold inputs as the actuator does; an `InstrumentError` leaves it safe."""
        values = check_input(self.inputs, u)
        record: Record = self._done(lambda: self._actuator.apply(u, duration, sample_interval))
        self._present = values
        return record

    def exchange(self, u: Value) -> Value:
        """Hold inputs for one tick as the actuator does; an `InstrumentError` leaves it safe."""
        values = check_input(self.inputs, u, before=self._present, interval=self.tick)
        y: Value = self._done(lambda: self._read(self._actuator.exchange(u)))
        self._present = values
        return y

    def answer_time(self) -> float:
        """Return the time of one reading, in seconds; 0 if the actuator does not give it."""
        found: float = self._done(super().answer_time)
        return found

    def safe(self) -> None:
        """Make the actuator safe.

        Raises a `SafetyError` if it fails.
        """
        self._present = None
        try:
            self._actuator.safe()
        except SafetyError:
            raise
        except Exception as error:
            raise SafetyError(
                f"the actuator may still be on, switch it off by hand: {_described(error)}"
            ) from error

    def _restore(self, checkpoint: dict[str, Any]) -> None:
        self._present = None
        self._actuator.restore(checkpoint)

    def _done(self, work: Any) -> Any:
        """Return the result of ``work``; after an error the actuator is safe."""
        try:
            return work()
        except BaseException as error:
            self.safe()
            if isinstance(error, MinorloopError) or not isinstance(error, Exception):
                raise
            raise InstrumentError(f"the actuator failed: {_described(error)}") from error

    def _read(self, y: npt.ArrayLike) -> Value:
        values = np.asarray(y, dtype=np.float64).reshape(-1)
        if values.size != len(self.outputs):
            raise InstrumentError(
                f"the actuator gives {values.size} readings for {len(self.outputs)} outputs"
            )
        return one_or_all(values)


class SingleChannel(WrappedActuator):
    """One input of an actuator, with the others at rest, and one output, which may be converted.

    ``input`` and ``output``: numbers of input and output; ``conversion``: conversion of the
    readings to the output; ``begun``: whether this run has converted readings before: then a hold
    without a converted reading is not an error.
    """

    def __init__(
        self,
        actuator: Actuator,
        input: int = 0,
        output: int = 0,
        conversion: Conversion | None = None,
        *,
        begun: bool = False,
    ) -> None:
        super().__init__(actuator)
        self._input, self._output, self._conversion = input, output, conversion
        self._begun, self._unit = begun, actuator.outputs[output].unit
        self.inputs = (actuator.inputs[input],)
        self.outputs = (actuator.outputs[output],)
        if conversion is not None:
            found = conversion.quantity(Quantity(self.outputs[0].name, self._unit))
            self.outputs = (Channel(found.name, found.unit),)

    @property
    def covered(self) -> str:
        """Readings that the conversion covers, for a message; empty without a conversion."""
        return "" if self._conversion is None else self._conversion.covered

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied."""
        return super().written(u) if len(self._actuator.inputs) == 1 else u

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold the input, and return a record of it and the output.

        Raises a `SignalError` if the conversion covers none of the first readings.
        """
        found = self._actuator.apply(self._all(u), duration, sample_interval)
        u, raw = np.atleast_2d(found.u)[self._input], np.atleast_2d(found.y)[self._output]
        y, known = self._converted(raw), np.isfinite(raw)
        if not self._begun and known.any() and not np.isfinite(y[known]).any():
            raise SignalError(
                f"the conversion covers none of the readings, {raw[known].min():.6g} to "
                f"{raw[known].max():.6g} {self._unit}; it covers {self.covered}: check its numbers"
            )
        self._begun = True
        names = str(self.inputs[0]), str(self.outputs[0])
        return Record(u, y, found.t, *names, found.time, found.timing)

    def exchange(self, u: Value) -> Value:
        """Hold the input for one tick, and return the output at its end."""
        y = np.atleast_1d(self._actuator.exchange(self._all(u)))
        return float(self._converted(y[self._output : self._output + 1])[0])

    def _converted(self, readings: FloatArray) -> FloatArray:
        return readings if self._conversion is None else self._conversion.convert(readings)

    def _all(self, u: Value) -> Value:
        if len(self._actuator.inputs) == 1:
            return u
        every: FloatArray = np.zeros(len(self._actuator.inputs))
        every[:] = getattr(self._actuator, "rest", 0.0)
        every[self._input] = float(np.ravel(u)[0])
        return every


def single_channel(
    actuator: Actuator, input: str | None = None, output: str | None = None
) -> Actuator:
    """Return one input and one output of an actuator, by their names.

    Raises a `ParameterError` if there is no such channel, or there are several to choose from.

    It is the actuator itself if it has one of each.

    ``input`` and ``output``: name, or name with unit, of a channel; by default the only input, and
    the output that belongs to the input.
    """
    place = _named(actuator.inputs, input, "input")
    own = getattr(actuator, "measures", range(len(actuator.outputs)))
    belonging = [k for k, source in enumerate(own) if source == place]
    if output is None and len(belonging) == 1:
        sensor = belonging[0]
    else:
        sensor = _named(actuator.outputs, output, "output")
    if len(actuator.inputs) == len(actuator.outputs) == 1:
        return actuator
    return SingleChannel(actuator, place, sensor)


def _named(channels: tuple[Channel, ...], name: str | None, what: str) -> int:
    """Return the number of the channel with a name, or of the only channel without a name."""
    if name is None and len(channels) == 1:
        return 0
    for number, channel in enumerate(channels):
        if name is not None and name in (channel.name, str(channel)):
            return number
    if not channels:
        raise ParameterError(f"the actuator has no {what}; give it one")
    known = ", ".join(f"'{channel}'" for channel in channels)
    if name is None:
        raise ParameterError(f"the actuator has the {what}s {known}; choose one with --{what}")
    raise ParameterError(f"the actuator has no {what} {name!r}; it has {known}")


def _check_actuator(actuator: Any) -> None:
    needed = "inputs", "outputs", "tick", "apply", "exchange", "safe"
    missing = [name for name in needed if not hasattr(actuator, name)]
    if missing:
        raise ParameterError(
            f"{type(actuator).__name__} is not an actuator: it has no {', '.join(missing)}; see "
            "minorloop.Actuator"
        )
    for channel in (*actuator.inputs, *actuator.outputs):
        if not isinstance(channel, Channel):
            raise ParameterError(f"{channel!r} is not a channel; give a minorloop.Channel")
    for channel in actuator.inputs:
        if not (math.isfinite(channel.low) and math.isfinite(channel.high)):
            raise ParameterError(f"{channel} has no limits; give the least and greatest input")


def _described(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
