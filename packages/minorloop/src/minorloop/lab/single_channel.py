"""One input and one output of an actuator with several."""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator, Channel, Value
from minorloop.lab.records import Record
from minorloop.lab.wrapped_actuator import WrappedActuator

__all__ = ["SingleChannel", "single_channel"]


class SingleChannel(WrappedActuator):
    """One input of an actuator, with the others at rest, and one of the outputs.

    Parameters
    ----------
    actuator : Actuator
    input, output : int
        Which input, and which output.
    """

    def __init__(self, actuator: Actuator, input: int, output: int) -> None:
        super().__init__(actuator)
        self._input, self._output = input, output
        self.inputs = (actuator.inputs[input],)
        self.outputs = (actuator.outputs[output],)

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied."""
        return super().written(u) if len(self._actuator.inputs) == 1 else u

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold the input, and return a record of it and the output."""
        found = self._actuator.apply(self._all(u), duration, sample_interval)
        u, y = np.atleast_2d(found.u)[self._input], np.atleast_2d(found.y)[self._output]
        names = str(self.inputs[0]), str(self.outputs[0])
        return Record(u, y, found.t, *names, found.time, found.timing)

    def exchange(self, u: Value) -> Value:
        """Hold the input for one tick, and return the output at its end."""
        return float(np.atleast_1d(self._actuator.exchange(self._all(u)))[self._output])

    def _all(self, u: Value) -> FloatArray:
        every: FloatArray = np.zeros(len(self._actuator.inputs))
        every[:] = getattr(self._actuator, "rest", 0.0)
        every[self._input] = float(np.ravel(u)[0])
        return every


def single_channel(
    actuator: Actuator, input: str | None = None, output: str | None = None
) -> Actuator:
    """Return one input and one output of an actuator, by their names.

    Raises a `ParameterError` if there is no such channel, or there are several to choose from.

    Parameters
    ----------
    actuator : Actuator
    input, output : str, optional
        Name, or name with unit, of a channel. The only input, and the output that belongs to the
        input, without them.

    Returns
    -------
    Actuator
        The actuator itself if it has one of each.
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
    """Return the number of a channel with a name; of the only one without a name."""
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
