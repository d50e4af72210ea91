"""An actuator of somebody else's making, behind the limits that it states."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MinorloopError, ParameterError, SafetyError
from minorloop.lab.actuator import Channel, Value, check_input
from minorloop.lab.records import Record
from minorloop.lab.wrapped_actuator import WrappedActuator

__all__ = ["LimitedActuator"]


class LimitedActuator(WrappedActuator):
    """An actuator that is sent no input beyond its limits, and made safe after any error.

    Parameters
    ----------
    actuator : Actuator
        Its inputs have finite limits.

    Raises
    ------
    ParameterError
        If a channel, a method or a limit is missing.
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
        """Return how long one reading takes, in seconds; 0 where the actuator does not say."""
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
                f"the actuator may still be on, switch it off by hand: {_said(error)}"
            ) from error

    def _restore(self, checkpoint: dict[str, Any]) -> None:
        self._present = None
        self._actuator.restore(checkpoint)

    def _done(self, work: Any) -> Any:
        """Return what was done; after an error the actuator is safe."""
        try:
            return work()
        except BaseException as error:
            self.safe()
            if isinstance(error, MinorloopError) or not isinstance(error, Exception):
                raise
            raise InstrumentError(f"the actuator failed: {_said(error)}") from error

    def _read(self, y: npt.ArrayLike) -> Value:
        values = np.asarray(y, dtype=np.float64).reshape(-1)
        if values.size != len(self.outputs):
            raise InstrumentError(
                f"the actuator gives {values.size} readings for {len(self.outputs)} outputs"
            )
        return float(values[0]) if values.size == 1 else values


def _check_actuator(actuator: Any) -> None:
    needed = "inputs", "outputs", "tick", "apply", "exchange", "safe"
    missing = [name for name in needed if not hasattr(actuator, name)]
    if missing:
        raise ParameterError(
            f"{type(actuator).__name__} is no actuator: it has no {', '.join(missing)}; see "
            "minorloop.Actuator"
        )
    for channel in (*actuator.inputs, *actuator.outputs):
        if not isinstance(channel, Channel):
            raise ParameterError(f"{channel!r} is no channel; give a minorloop.Channel")
    for channel in actuator.inputs:
        if not (math.isfinite(channel.low) and math.isfinite(channel.high)):
            raise ParameterError(f"{channel} has no limits; give the least and greatest input")


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
