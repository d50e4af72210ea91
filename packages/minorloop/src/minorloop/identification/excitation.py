"""Inputs for identification, and the part of the plane that they determine.

Inputs are in the order in which they are applied and measured.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, as_levels, as_samples
from minorloop.errors import SignalError, counted
from minorloop.figures import Drawn
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.diagnosis import rank_and_condition


def staircase(levels: npt.ArrayLike) -> FloatArray:
    """Return every level going up, then going down, (2 L + 1,).

    ``levels`` (L + 1,): strictly increasing inputs.
    """
    grid = as_levels(levels)
    return np.concatenate([grid, grid[-2::-1]])


def major_loop(levels: npt.ArrayLike) -> FloatArray:
    """Return every level going up, down and up again, (3 L + 1,): a closed loop."""
    grid = as_levels(levels)
    return np.concatenate([grid, grid[-2::-1], grid[1:]])


def decaying_staircase(levels: npt.ArrayLike) -> FloatArray:
    """Return a staircase up and down, one level shorter at each turn: 1 + L (L + 1) / 2 inputs.

    There are as many measurements as weights and offset. Each step adds one unknown, so the inputs
    determine the plane exactly. The levels are as of `staircase`.
    """
    grid = as_levels(levels)
    low, high = 0, grid.size - 1
    steps = [0]
    while low < high:
        steps += range(low + 1, high + 1)
        low += 1
        steps += range(high - 1, low - 1, -1)
        high -= 1
    return grid[steps]


def reversal_curves(levels: npt.ArrayLike) -> FloatArray:
    """Return first-order reversal curves: up to each level in turn, and down every level.

    They are 1 + L + L (L + 1) / 2 inputs, with the returns to the lowest level. The levels are as
    of `staircase`.
    """
    grid = as_levels(levels)
    curves = [grid[top::-1] for top in range(1, grid.size)]
    return np.concatenate([grid[:1], *curves])


@dataclass(frozen=True, eq=False)
class ExcitationReport(Drawn):
    """The part of the plane that an input determines if every sample is measured."""

    samples: int
    unknowns: int
    """``samples`` and ``unknowns``: number of measurements; number of weights and offset."""
    rank: int
    """Number of independent unknowns that the input determines."""
    condition: float
    """Condition number of the regressors with unit columns, within the rank."""
    excited: BoolArray
    """Shape (L, L). Cells in which a sample evaluates the Everett function."""

    @property
    def excited_fraction(self) -> float:
        """Share of the cells that are excited."""
        bands = len(self.excited)
        return float(np.count_nonzero(self.excited)) / (bands * (bands + 1) // 2)

    @property
    def sufficient(self) -> bool:
        """Whether the input determines every unknown."""
        return self.rank == self.unknowns

    def __str__(self) -> str:
        verdict = "determines the plane" if self.sufficient else "does not determine the plane"
        return (
            f"{counted(self.samples, 'sample')}, rank {self.rank} of {self.unknowns} unknowns, "
            "condition "
            f"{self.condition:.3g}, {self.excited_fraction:.0%} of the cells excited: {verdict}"
        )


def report(u: npt.ArrayLike, levels: npt.ArrayLike) -> ExcitationReport:
    """Return rank, condition and excited cells of an input, before it is applied.

    Raises a `SignalError` if ``u`` is not one finite sequence.

    ``u`` (T,): inputs, each is measured; ``levels`` (L + 1,): thresholds of the plane to be
    identified.
    """
    inputs = as_samples(u, name="u")
    if inputs.ndim != 1:
        raise SignalError(f"u has shape {inputs.shape}; give one sequence, (T,)")
    spec = PlaneSpec(as_levels(levels))
    matrix = DesignMatrix(spec, inputs, np.ones(inputs.size, dtype=np.bool_), "negative")
    rank, condition = rank_and_condition(matrix)
    return ExcitationReport(inputs.size, spec.unknowns, rank, condition, matrix.excited)
