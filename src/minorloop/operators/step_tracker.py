"""Follow a live input with any operator that has a pure step."""

from __future__ import annotations

from typing import Any, Generic, Protocol, TypeVar

Memory = TypeVar("Memory")


class Stepping(Protocol[Memory]):
    """An operator with a pure step and the one-sample inverse."""

    def step(self, memory: Memory, u: float) -> tuple[float, Memory]:
        """Output and memory after one input."""

    def aim(self, memory: Memory, y: float) -> float:
        """Input that brings the output to y."""


class StepTracker(Generic[Memory]):
    """An operator that follows one live input and owns its memory.

    Parameters
    ----------
    model : operator with ``step`` and ``aim``
        For example `PrandtlIshlinskii`.
    memory : as ``model.step`` takes it
        Memory before the first sample.
    """

    __slots__ = ("memory", "model")

    def __init__(self, model: Stepping[Any], memory: Memory) -> None:
        self.model = model
        self.memory = memory

    def push(self, u: float) -> float:
        """Output after the next input, which is committed to memory."""
        y, self.memory = self.model.step(self.memory, u)
        return y

    def peek(self, u: float) -> float:
        """Output that the next input would give; nothing is committed."""
        return self.model.step(self.memory, u)[0]

    def aim(self, y: float) -> float:
        """Input that brings the output to y; nothing is committed."""
        return self.model.aim(self.memory, y)

    def copy(self) -> StepTracker[Memory]:
        """An independent tracker with the same memory."""
        return StepTracker(self.model, self.memory)
