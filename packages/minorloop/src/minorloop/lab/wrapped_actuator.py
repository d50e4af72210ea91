"""What an actuator that stands before another passes on unchanged."""

from collections.abc import Callable
from typing import Any

from minorloop.lab.actuator import Channel, Rounding, Timed

__all__ = ["WrappedActuator"]


class WrappedActuator:
    """The base of actuators that change what another one takes or gives.

    Parameters
    ----------
    actuator : Actuator
        The other one.
    restorable : bool
        Whether it has ``checkpoint`` and ``restore`` where the other one has them, so that a run
        restores it and does not replay it.
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
        """How long one ``exchange`` takes, in seconds."""
        tick: float = self._actuator.tick
        return tick

    @property
    def description(self) -> dict[str, Any] | None:
        """The instruments, as the actuator describes them; None if it does not."""
        found: dict[str, Any] | None = getattr(self._actuator, "description", None)
        return found

    def answer_time(self) -> float:
        """Return how long one reading takes, in seconds; 0 where the actuator does not say."""
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
