"""A Preisach operator that follows one live input."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from minorloop.arrays import as_finite
from minorloop.operators import _kernels
from minorloop.operators.memory import Memory

if TYPE_CHECKING:
    from minorloop.operators.preisach import Preisach, Start


class Tracker:
    """A Preisach operator that follows one live input and owns its memory.

    Parameters
    ----------
    model : Preisach
        The operator.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first sample.
    """

    __slots__ = ("_plane", "_rows", "_stack", "_u", "_y", "model")

    def __init__(self, model: Preisach, start: Start = "negative") -> None:
        self.model = model
        self._plane = model._plane
        self._stack, self._rows = model._stack(start, room=64)
        self._u, self._y = np.empty(1), np.empty(1)

    @property
    def memory(self) -> Memory:
        """What is remembered now."""
        return Memory(self._stack[: self._rows, _kernels.VALUE].tolist())

    def push(self, u: float) -> float:
        """Output after the next input, which is committed to memory.

        Parameters
        ----------
        u : float
            The next input, in its unit.

        Raises
        ------
        ParameterError
            If the input is not a finite number.
        """
        if not isinstance(u, float) or not -np.inf < u < np.inf:
            u = as_finite("u", u)
        if self._rows > len(self._stack) - 2:
            self._stack = np.concatenate([self._stack, np.empty_like(self._stack)])
        self._u[0] = u
        self._rows = _kernels.simulate(self._plane, self._stack, self._rows, self._u, self._y)
        return float(self._y[0])

    def peek(self, u: float) -> float:
        """Output that the next input would give; nothing is committed.

        Parameters
        ----------
        u : float
            An input, in its unit.

        Returns
        -------
        float
            In the unit of the output.
        """
        return self.copy().push(u)

    def aim(self, y: float) -> float:
        """Nearest input that brings the output to y; nothing is committed.

        Beyond the range of the model it is the end of the grid that comes nearest.

        Parameters
        ----------
        y : float
            Output wanted, in its unit.

        Raises
        ------
        NotInvertibleError
            If the model is not monotone.
        ParameterError
            If the target is not a finite number.
        """
        self.model._require_monotone()
        target = as_finite("target", y)
        low, high = self.model.range
        return float(
            _kernels.aim(self._plane, self._stack, self._rows, min(max(target, low), high))
        )

    def copy(self) -> Tracker:
        """An independent tracker with the same memory."""
        twin = object.__new__(Tracker)
        twin.model, twin._plane, twin._rows = self.model, self._plane, self._rows
        twin._stack, twin._u, twin._y = self._stack.copy(), np.empty(1), np.empty(1)
        return twin
