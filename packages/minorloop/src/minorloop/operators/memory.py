"""The reduced memory sequence: the state of a Preisach operator.

The operator remembers alternating minima and maxima, each pair inside the previous pair; all other
inputs have been wiped out. The first entry is the minimum of negative saturation, the last entry
the present input.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from minorloop.errors import ParameterError
from minorloop.operators import _memory_kernels as _kernels

Saturation: TypeAlias = Literal["negative", "positive", "demagnetised"]

Start: TypeAlias = "Memory | Saturation"
StartOfCurve: TypeAlias = "Memory | Saturation | Literal['as-left']"
"""Memory before a curve; ``"as-left"``: the memory that the previous curve left."""

ROOM = 32
"""Default number of extrema in a memory of bounded length."""
LEAST_ROOM, MOST_ROOM = 6, 10_000
"""Bounds of that number. To drop a loop, four extrema must be between the start and the present
input; 10,000 extrema take 400 kB, more than a history needs."""


@dataclass(frozen=True)
class Memory:
    """Remembered extrema, oldest first, ending with the present input.

    Raises a `ParameterError` if there are no extrema, one is not finite, or they do not nest.

    Parameters
    ----------
    extrema : sequence of float
        Minimum, maximum, minimum, ... in the unit of the input. Minima strictly increase,
        maxima strictly decrease, every maximum lies above every minimum. The first is the
        lower end of the plane: negative saturation.

    References
    ----------
    Mayergoyz, Mathematical Models of Hysteresis, 1991, section 1.2.

    Examples
    --------
    >>> ml.Memory.after([0.8, -0.5, 0.2], low=-1.0, high=1.0).extrema
    (-1.0, 0.8, -0.5, 0.2)
    """

    extrema: tuple[float, ...]

    def __init__(self, extrema: Sequence[float]) -> None:
        values = tuple(float(value) for value in extrema)
        _check_nested(values)
        object.__setattr__(self, "extrema", values)

    @classmethod
    def after(cls, inputs: Iterable[float], *, low: float, high: float) -> Memory:
        """Memory after a sequence of inputs from negative saturation.

        Raises a `ParameterError` if an input is NaN.

        Parameters
        ----------
        inputs : iterable of float
            Inputs in order; beyond [low, high] they count as the nearer end.
        low, high : float
            Ends of the plane in the unit of the input, ``levels[0]`` and ``levels[-1]``.
        """
        values = np.fromiter(inputs, dtype=np.float64)
        extrema = np.empty(values.size + 1)
        count = _kernels.reduce(extrema, values, float(low), float(high))
        if not count:
            index = int(np.argmax(np.isnan(values)))
            raise ParameterError(f"input {index} is NaN; give only applied inputs")
        return cls(extrema[:count].tolist())

    @classmethod
    def negative(cls, low: float) -> Memory:
        """Negative saturation of a plane that begins at ``low``, as of `after`."""
        return cls((low,))

    @classmethod
    def positive(cls, low: float, high: float) -> Memory:
        """Positive saturation of a plane from ``low`` to ``high``, as of `after`."""
        return cls((low, high))

    @classmethod
    def demagnetised(cls, low: float, high: float) -> Memory:
        """Memory after an oscillation that shrinks evenly from the whole plane to its middle.

        The swing shrinks by 1/512 of the plane per turn. A plane that is symmetric about its middle
        then has its middle output to within about 1/512 of its range. The ends are as of `after`.
        """
        # Turns of the oscillation, for the middle output to within about 1/512 of the range
        turns = 512
        middle, half = (low + high) / 2, (high - low) / 2
        shrink = 1 - np.arange(2 * turns) / (2 * turns - 1)
        signs = np.where(np.arange(2 * turns) % 2 == 0, 1.0, -1.0)
        return cls.after(middle + signs * half * shrink, low=low, high=high)

    @property
    def u(self) -> float:
        """The present input."""
        return self.extrema[-1]

    def __len__(self) -> int:
        return len(self.extrema)


def _check_nested(values: tuple[float, ...]) -> None:
    if not values:
        raise ParameterError("a memory holds at least one extremum, the lower end of the plane")
    if not all(np.isfinite(values)):
        raise ParameterError(f"memory {values} has an entry that is not finite")
    minima, maxima = values[::2], values[1::2]
    rises = all(a < b for a, b in pairwise(minima))
    falls = all(a > b for a, b in pairwise(maxima))
    if not (rises and falls and (not maxima or maxima[-1] > minima[-1])):
        raise ParameterError(
            f"memory {values[:8]}{'...' if len(values) > 8 else ''} does not nest: minima must "
            "rise, maxima fall, starting with a minimum; Memory.after(inputs) reduces any history"
        )
