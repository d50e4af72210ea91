"""Direct identification from first-order reversal curves measured on a mesh.

No fit: weights are mixed differences of the measured values, so noise enters each of them
four times over and may make some negative. `minorloop.identify` on the same record keeps them
from that.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_levels, as_samples
from minorloop.errors import SignalError
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach

_TOLERANCE = 1e-9
"""Distance from a level, over the range, up to which an input is on it: far above rounding,
and far below a band."""


def _reversal_values(u: npt.ArrayLike, y: npt.ArrayLike, levels: npt.ArrayLike) -> FloatArray:
    """Sort a record of reversal curves into a mesh of reversal values.

    Parameters
    ----------
    u : (T,) array_like
        Inputs applied, from negative saturation, in any order of curves; those that count are
        level values.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    levels : (L + 1,) array_like
        Thresholds.

    Returns
    -------
    (L + 1, L + 1) array
        ``f[a, b]``, b <= a: mean output after rising from saturation to level a and falling
        to level b; NaN where it was not measured, and above the diagonal.

    Raises
    ------
    SignalError
        If lengths differ.
    """
    inputs, outputs = as_samples(u, name="u"), as_samples(y, name="y", gaps=True)
    grid = as_levels(levels)
    if inputs.shape != outputs.shape or inputs.ndim != 1:
        raise SignalError(f"u has shape {inputs.shape} and y {outputs.shape}; give two of (T,)")
    total, count = np.zeros((grid.size, grid.size)), np.zeros((grid.size, grid.size))
    low, high = float(grid[0]), float(grid[-1])
    memory = Memory.negative(low)
    for value, output in zip(inputs, outputs, strict=True):
        memory = Memory.after([*memory.extrema[1:], value], low=low, high=high)
        place = _place(grid, memory.extrema)
        if place is not None and np.isfinite(output):
            total[place] += output
            count[place] += 1
    values = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    values[:, 0] = values[0, 0]  # falling to the lowest level wipes everything out
    return np.where(np.tri(grid.size) > 0, values, np.nan)


def identify_reversal_curves(u: npt.ArrayLike, y: npt.ArrayLike, levels: npt.ArrayLike) -> Preisach:
    """Model that passes through every measured reversal value.

    Parameters
    ----------
    u, y : (T,) array_like
        Record of the inputs of `minorloop.excitation.reversal_curves`.
    levels : (L + 1,) array_like
        Thresholds.

    Raises
    ------
    SignalError
        If a reversal value was not measured.
    """
    grid = as_levels(levels)
    values = _reversal_values(u, y, grid)
    missing = np.argwhere(np.isnan(values) & (np.tri(grid.size) > 0))
    if len(missing):
        a, b = missing[0]
        raise SignalError(
            f"{len(missing)} reversal values are missing, the first on the curve from "
            f"{grid[a]:g} at {grid[b]:g}; measure excitation.reversal_curves(levels) in full, or "
            "use identify, which needs no complete mesh"
        )
    return Preisach.from_reversal_values(grid, values)


def _place(grid: Levels, extrema: tuple[float, ...]) -> tuple[int, int] | None:
    """Indices (a, b) of a memory that is a point of the mesh, None where it is not."""
    if len(extrema) > 3:
        return None
    top = extrema[1] if len(extrema) > 1 else extrema[0]
    a, b = (int(np.abs(grid - value).argmin()) for value in (top, extrema[-1]))
    near = _TOLERANCE * (grid[-1] - grid[0])
    on_mesh = abs(grid[a] - top) <= near and abs(grid[b] - extrema[-1]) <= near
    return (a, b) if on_mesh else None
