"""An actuator whose sensor readings are converted, such as laser distance to curvature."""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop.lab.actuator import Actuator, Channel, Value
from minorloop.lab.conversion import Conversion
from minorloop.lab.records import Quantity, Record
from minorloop.lab.wrapped_actuator import WrappedActuator

__all__ = ["ConvertedActuator"]


class ConvertedActuator(WrappedActuator):
    """An actuator that shows its converted output.

    Parameters
    ----------
    actuator : Actuator
        What is driven; it has one output.
    conversion : Conversion
        From its readings to the output wanted.
    begun : bool
        Whether readings were converted in this run before: then a hold without one is no error.

    Raises
    ------
    ParameterError
        If the actuator has several outputs.
    """

    def __init__(self, actuator: Actuator, conversion: Conversion, *, begun: bool = False) -> None:
        if len(actuator.outputs) != 1:
            raise ParameterError(
                f"the actuator has {len(actuator.outputs)} outputs; a conversion is for one"
            )
        super().__init__(actuator)
        self._conversion = conversion
        reading = Quantity(actuator.outputs[0].name, actuator.outputs[0].unit)
        quantity = conversion.quantity(reading)
        self.outputs = (Channel(quantity.name, quantity.unit),)
        self._covered_once = begun

    @property
    def covered(self) -> str:
        """Which readings are covered by the conversion, for a message."""
        return self._conversion.covered

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input as the actuator does; the output of the record is converted.

        Raises a `SignalError` if the conversion covers none of the first readings.
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
        return Record(raw.u, y, raw.t, raw.inputs, names, raw.time, raw.timing)

    def exchange(self, u: Value) -> Value:
        """Hold an input for one tick, and return the converted output at its end."""
        reading: FloatArray = self._conversion.convert(np.atleast_1d(self._actuator.exchange(u)))
        return float(reading[0])
