"""Measure by how much a record contradicts every Preisach model.

A system is a Preisach operator if and only if it obeys two laws (Mayergoyz, Mathematical Models of
Hysteresis, 1991, section 1.3). Wiping-out: the output depends only on the remembered extrema.
Congruency: on a branch, the change of the output since the reversal depends only on the input at
the reversal and the present input. If a record returns to the same memory or branch with another
output, no model can reproduce both. Noise and drift also count as violations.
"""

from collections import defaultdict
from collections.abc import Hashable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_pair
from minorloop.errors import SignalError
from minorloop.operators.memory import Memory


@dataclass(frozen=True)
class Representability:
    """Violations of the two laws by a record."""

    wiping_out: float
    """Largest difference between outputs at the same memory, over the range of the output."""
    congruency: float
    """Largest difference between changes along the same branch, over the range of the output."""
    floor: float
    """Lower bound of the root-mean-square error of any Preisach model on this record, over the
    range; 0 if the record repeats no memory or branch."""
    memories: int
    branches: int
    """``memories`` and ``branches``: number of memories and branch points that occur more than
    once."""

    def __str__(self) -> str:
        return (
            f"wiping-out violated by {self.wiping_out:.2%} of range ({self.memories} repeated "
            f"memories), congruency by {self.congruency:.2%} ({self.branches} repeated branch "
            f"points); the rms error of any Preisach model on this record is at least "
            f"{self.floor:.2%}"
        )


def representability(u: npt.ArrayLike, y: npt.ArrayLike) -> Representability:
    """Compare the outputs of a record wherever it repeats a memory or a branch.

    ``u`` (T,): inputs from the lowest input (negative saturation) on; ``y`` (T,): settled outputs,
    NaN if not measured. Raises a `SignalError` if lengths differ, or fewer than two outputs are
    finite.
    """
    inputs, outputs = as_pair(u, y)
    if np.count_nonzero(np.isfinite(outputs)) < 2:
        raise SignalError("fewer than two outputs are finite; there is nothing to compare")
    # Inputs closer than this share of their range count as equal
    step = max(1e-6 * np.ptp(inputs), np.finfo(float).tiny)
    same_memory, same_branch = _groups(np.round(inputs / step) * step, outputs)
    span = float(np.nanmax(outputs) - np.nanmin(outputs)) or 1.0
    measured = int(np.count_nonzero(np.isfinite(outputs)))
    # A branch compares two model errors, at its start and now: (a - b)^2 <= 2 a^2 + 2 b^2.
    from_memory = np.sqrt(_sum_of_squares(same_memory) / measured)
    from_branch = np.sqrt(_sum_of_squares(same_branch) / (4 * measured))
    return Representability(
        wiping_out=_largest_range(same_memory) / span,
        congruency=_largest_range(same_branch) / span,
        floor=float(max(from_memory, from_branch)) / span,
        memories=len(same_memory),
        branches=len(same_branch),
    )


def _groups(u: FloatArray, y: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    """Outputs at each repeated memory, and changes since the reversal at each repeated branch."""
    by_memory: dict[Hashable, dict[int, float]] = defaultdict(dict)
    by_branch: dict[Hashable, list[tuple[Hashable, float]]] = defaultdict(list)
    low, high = float(u.min()), float(u.max())
    memory = Memory.negative(low)
    output_at = {memory.extrema: float(y[0]) if u[0] == low else np.nan}
    for t in range(u.size):
        memory = Memory.after([*memory.extrema[1:], float(u[t])], low=low, high=high)
        past = memory.extrema
        output = float(y[t])
        if not np.isfinite(output):
            output_at.pop(past, None)
            continue
        held = t > 0 and u[t] == u[t - 1]
        if not held:
            by_memory[past][t] = output
        change = output - output_at.get(past[:-1], np.nan)
        if len(past) > 1 and np.isfinite(change):
            by_branch[past[-2:]].append((past[:-2], change))
        output_at[past] = output
    memories = [np.array(list(group.values())) for group in by_memory.values() if len(group) > 1]
    branches = [
        np.array([change for _, change in group])
        for group in by_branch.values()
        if len({history for history, _ in group}) > 1
    ]
    return memories, branches


def _sum_of_squares(groups: Iterable[FloatArray]) -> float:
    """Sum of squares about the mean of each group."""
    return float(sum(np.sum((group - group.mean()) ** 2) for group in groups))


def _largest_range(groups: Iterable[FloatArray]) -> float:
    return float(max((np.ptp(group) for group in groups), default=0.0))
