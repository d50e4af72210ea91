"""Direct identification from first-order reversal curves measured on a mesh.

This is not a fit: a weight is a mixed difference of four measured values. Their noise may make
weights negative. `minorloop.identify` on the same record keeps them positive or zero.
"""

import numpy as np
import numpy.typing as npt

from minorloop.arrays import Levels, as_levels, as_pair
from minorloop.errors import SignalError
from minorloop.operators import plane
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach


def identify_reversal_curves(u: npt.ArrayLike, y: npt.ArrayLike, levels: npt.ArrayLike) -> Preisach:
    """Model that passes through every measured reversal value, or the mean of repeated values.

    Raises a `SignalError` if lengths differ, or a reversal value was not measured.

    ``u`` (T,): applied inputs, from negative saturation, in any order of curves, such as those of
    `minorloop.excitation.reversal_curves`; only inputs at levels count; ``y`` (T,): outputs; NaN if
    not measured; ``levels`` (L + 1,): thresholds.

    References
    ----------
    Mayergoyz, 1991, eq. 1.24: the mixed difference of reversal curves is the weight times the
    swing of a relay, which is 2 for relays between -1 and +1.
    """
    inputs, outputs = as_pair(u, y)
    grid = as_levels(levels)
    total, count = np.zeros((2, grid.size, grid.size))
    low, high = float(grid[0]), float(grid[-1])
    memory = Memory.negative(low)
    for value, output in zip(inputs, outputs, strict=True):
        memory = Memory.after([*memory.extrema[1:], value], low=low, high=high)
        place = _place(grid, memory.extrema)
        if place is not None and np.isfinite(output):
            total[place] += output
            count[place] += 1
    # Falling to the lowest level wipes everything out.
    total[:, 0], count[:, 0] = total[0, 0], count[0, 0]
    missing = np.argwhere(np.tril(count == 0))
    if len(missing):
        a, b = missing[0]
        raise SignalError(
            f"{len(missing)} reversal values are missing, the first on the curve from "
            f"{grid[a]:g} at {grid[b]:g}; measure excitation.reversal_curves(levels) in full, or "
            "use identify, which does not need a complete mesh"
        )
    values = total / np.maximum(count, 1)
    weights = plane.weights_from_nodes(np.tril(values.diagonal()[:, None] - values) / 2)
    return Preisach(grid, weights, float(values[0, 0] + weights.sum()))


def _place(grid: Levels, extrema: tuple[float, ...]) -> tuple[int, int] | None:
    """Indices (a, b) of a memory that is a point of the mesh, None where it is not."""
    if len(extrema) > 3:
        return None
    top = extrema[1] if len(extrema) > 1 else extrema[0]
    a, b = (int(np.abs(grid - value).argmin()) for value in (top, extrema[-1]))
    # Distance from a level, over the range, up to which an input is on it: far above rounding, and
    # far below a band
    near = 1e-9 * (grid[-1] - grid[0])
    on_mesh = abs(grid[a] - top) <= near and abs(grid[b] - extrema[-1]) <= near
    return (a, b) if on_mesh else None
