"""Follow a live input with an operator whose step is a pure function."""

from __future__ import annotations

from typing import Any, Generic, Protocol, TypeVar

from minorloop.operators.inversion import Unreachable

Memory = TypeVar("Memory")


class Stepping(Protocol[Memory]):
    """An operator whose step and one-sample inverse are pure functions."""

    def step(self, memory: Memory, u: float) -> tuple[float, Memory]:
        """Return output and memory after one input."""

    def aim(self, memory: Memory, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y."""


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
        """Return the output after the next input, and update the memory."""
        y, self.memory = self.model.step(self.memory, u)
        return y

    def peek(self, u: float) -> float:
        """Return the output for a next input; the memory stays as it is."""
        return self.model.step(self.memory, u)[0]

    def aim(self, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y; the memory stays as it is."""
        return self.model.aim(self.memory, y, unreachable)

    def copy(self) -> StepTracker[Memory]:
        """Return an independent tracker with the same memory."""
        return StepTracker(self.model, self.memory)
