"""The protocol of rate-independent operators."""

from __future__ import annotations

from typing import Any, Protocol

import numpy.typing as npt

from minorloop.arrays import Samples
from minorloop.operators.inversion import Inversion, Unreachable


class Operator(Protocol):
    """A rate-independent operator, such as `Preisach`, `PrandtlIshlinskii` or `Polynomial`."""

    def simulate(self, u: npt.ArrayLike, start: Any = ...) -> Samples:
        """Return the outputs for an input signal."""

    def invert(
        self, targets: npt.ArrayLike, start: Any = ..., unreachable: Unreachable = ...
    ) -> Inversion:
        """Return inputs that bring the output to each target."""

    def step(self, memory: Any, u: float) -> tuple[float, Any]:
        """Return output and memory after one input."""
