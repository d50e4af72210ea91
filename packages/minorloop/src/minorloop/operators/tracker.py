"""Operators that follow one live input: implementations of `LiveTracker`."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np

from minorloop.arrays import FloatArray, as_finite
from minorloop.operators import _kernels
from minorloop.operators.inversion import Unreachable, as_reachable
from minorloop.operators.memory import Memory, Start

_AnyMemory = TypeVar("_AnyMemory")


class Tracker:
    """A Preisach operator that follows one live input and keeps its memory.

    ``model``: the operator; ``start``: memory before the first sample.
    """

    __slots__ = ("_rows", "_stack", "_tables", "_u", "_y", "model")

    def __init__(self, model: Any, start: Start = "negative") -> None:
        self.model = model
        self._tables = model.tables
        self._stack, self._rows = model.stack(start, room=64)
        self._u, self._y = np.empty(1), np.empty(1)

    @property
    def memory(self) -> Memory:
        """Present memory."""
        return Memory(self._stack[: self._rows, _kernels.VALUE].tolist())

    def push(self, u: float) -> float:
        """Return the output after the next input, and update the memory."""
        self._make_room()
        self._rows = self._advance(self._stack, u)
        return float(self._y[0])

    def run(self, loop: Callable[..., int], *arguments: object) -> None:
        """Update the memory by a compiled loop that adds at most one extremum.

        ``loop``: takes `PlaneTables`, the stack, the rows in use, and the arguments; returns the
        rows; ``*arguments``: of the loop.
        """
        self._make_room()
        self._rows = int(loop(self._tables, self._stack, self._rows, *arguments))

    def _make_room(self) -> None:
        """Make room for another row of the stack: an input adds at most one."""
        if self._rows > len(self._stack) - 2:
            self._stack = np.concatenate([self._stack, np.empty_like(self._stack)])

    def peek(self, u: float) -> float:
        """Return the output for a next input; the memory does not change."""
        # One input adds at most one row; rows after the present ones are not read.
        stack = np.empty((self._rows + 2, self._stack.shape[1]))
        stack[: self._rows] = self._stack[: self._rows]
        self._advance(stack, u)
        return float(self._y[0])

    def _advance(self, stack: FloatArray, u: float) -> int:
        """Update a stack for the next input; ``self._y`` has the output. Return the rows in use."""
        if not isinstance(u, float) or not -np.inf < u < np.inf:
            u = as_finite("u", u)
        self._u[0] = u
        return int(_kernels.simulate(self._tables, stack, self._rows, self._u, self._y))

    def aim(self, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the nearest input that brings the output to y; the memory does not change."""
        self.model.require_monotone()
        low, high = self.model.range
        target = as_reachable(y, low, high, unreachable)
        return float(_kernels.aim(self._tables, self._stack, self._rows, target))

    def copy(self) -> Tracker:
        """Return an independent tracker with the same memory."""
        other = object.__new__(Tracker)
        other.model, other._tables, other._rows = self.model, self._tables, self._rows
        other._stack, other._u, other._y = self._stack.copy(), np.empty(1), np.empty(1)
        return other


class StepTracker(Generic[_AnyMemory]):
    """An operator that follows one live input and keeps its memory.

    ``model``: for example `PrandtlIshlinskii`; ``memory``: memory before the first sample.
    """

    __slots__ = ("memory", "model")

    def __init__(self, model: Any, memory: _AnyMemory) -> None:
        self.model = model
        self.memory = memory

    def push(self, u: float) -> float:
        """Return the output after the next input, and update the memory."""
        y, self.memory = self.model.step(self.memory, u)
        return float(y)

    def peek(self, u: float) -> float:
        """Return the output for a next input; the memory does not change."""
        return float(self.model.step(self.memory, u)[0])

    def aim(self, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y; the memory does not change."""
        return float(self.model.aim(self.memory, y, unreachable))

    def copy(self) -> StepTracker[_AnyMemory]:
        """Return an independent tracker with the same memory."""
        return copy.copy(self)
