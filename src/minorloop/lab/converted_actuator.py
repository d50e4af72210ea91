"""An actuator whose sensor readings are converted, such as laser distance to curvature."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop.lab.actuator import Actuator, Channel, Rounding, Timed, Value
from minorloop.lab.conversion import Conversion
from minorloop.lab.records import Quantity, Record

__all__ = ["ConvertedActuator", "ConvertedTwin", "with_conversion"]


class ConvertedActuator:
    """An actuator that shows its converted output.

    Parameters
    ----------
    actuator : Actuator
        What is driven; it has one output.
    conversion : Conversion
        From its readings to the output wanted.

    Raises
    ------
    ParameterError
        If the actuator has several outputs.
    """

    def __init__(self, actuator: Actuator, conversion: Conversion) -> None:
        if len(actuator.outputs) != 1:
            raise ParameterError(
                f"the actuator has {len(actuator.outputs)} outputs; a conversion is for one"
            )
        self._actuator, self._conversion = actuator, conversion
        reading = Quantity(actuator.outputs[0].name, actuator.outputs[0].unit)
        quantity = conversion.quantity(reading)
        self.outputs: tuple[Channel, ...] = (Channel(quantity.name, quantity.unit),)
        self.warnings: tuple[str, ...] = tuple(getattr(actuator, "warnings", ()))
        self._covered_once = False

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The inputs of the actuator."""
        return self._actuator.inputs

    @property
    def covered(self) -> str:
        """Which readings are covered by the conversion, for a message."""
        return self._conversion.covered

    @property
    def tick(self) -> float:
        """How long one ``exchange`` takes, in seconds."""
        return self._actuator.tick

    @property
    def description(self) -> dict[str, Any] | None:
        """The instruments, as the actuator describes them; None if it does not."""
        found: dict[str, Any] | None = getattr(self._actuator, "description", None)
        return found

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input as the actuator does; the output of the record is converted.

        Raises
        ------
        SignalError
            If the conversion covers none of the first readings.
        """
        raw = self._actuator.apply(u, duration, sample_interval)
        y = self._conversion.convert(raw.y)
        finite = np.isfinite(raw.y)
        if not self._covered_once and finite.any() and not np.isfinite(y[finite]).any():
            low, high = raw.y[finite].min(), raw.y[finite].max()
            raise SignalError(
                f"the conversion covers none of the readings, {low:.6g} to {high:.6g} "
                f"{self._actuator.outputs[0].unit}; it covers {self.covered}: check its numbers"
            )
        self._covered_once = True
        names = [str(channel) for channel in self.outputs]
        return Record(raw.t, raw.u, y, raw.inputs, names, raw.time, raw.timing)

    def exchange(self, u: Value) -> Value:
        """Hold an input for one tick, and return the converted output at its end."""
        reading: FloatArray = self._conversion.convert(np.atleast_1d(self._actuator.exchange(u)))
        return float(reading[0])

    def safe(self) -> None:
        """Make the actuator safe."""
        self._actuator.safe()

    def answer_time(self) -> float:
        """Return how long one reading takes, in seconds; 0 where the actuator does not say."""
        return self._actuator.answer_time() if isinstance(self._actuator, Timed) else 0.0

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied."""
        return self._actuator.written(u) if isinstance(self._actuator, Rounding) else u


class ConvertedTwin(ConvertedActuator):
    """A converted actuator whose state can be saved and restored."""

    _actuator: Any

    def checkpoint(self) -> dict[str, Any]:
        """Return the state, ready for JSON."""
        found: dict[str, Any] = self._actuator.checkpoint()
        return found

    def restore(self, checkpoint: dict[str, Any]) -> None:
        """Go back to a saved state."""
        self._actuator.restore(checkpoint)


def with_conversion(actuator: Actuator, conversion: Conversion) -> ConvertedActuator:
    """Return an actuator that shows its converted output.

    Parameters
    ----------
    actuator : Actuator
        What is driven; it has one output.
    conversion : Conversion
        From its readings to the output wanted.

    Raises
    ------
    ParameterError
        If the actuator has several outputs.
    """
    kind = ConvertedTwin if hasattr(actuator, "restore") else ConvertedActuator
    return kind(actuator, conversion)
