"""Closed loops of a record, and their areas."""

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, writable
from minorloop.identification import _condensing_kernels as _kernels
from minorloop.identification.curves import Curves

_TOLERANCE = 0.01
"""Distance from its beginning, over the width of the loop, at which a loop counts as closed."""
_GAP = 0.1
"""Distance over the width of the last sample, if the input passes the beginning after it."""


def closed_loops(u: FloatArray, scored: BoolArray, curves: Curves) -> IntArray:
    """(C, 2) first and last samples of the closed loops of an input, in the order of closing.

    A loop begins at a turning point of the input and closes where the input returns to it. Before a
    loop closes, smaller loops may close within it. The first sample of a curve is a turning point
    only at the least or the greatest input of the curve. Loops of less than 2 % of the range of the
    input, of fewer than 8 samples, or with samples that are not scored are left out.

    ``u`` (T,): inputs; ``scored`` (T,) of bool: samples with an output; ``curves``: parts of the
    record, each with its own loops.
    """
    low, high = float(u.min()), float(u.max())
    # Width of a loop over the range of the input below which it is not counted
    near, narrowest = _TOLERANCE * (high - low), 0.02 * (high - low)
    found = []
    for first, last in curves.parts(u.size):
        part = writable(u[first:last])
        turns, begin, end = np.empty((3, part.size), dtype=np.int64)
        extreme = bool(min(part[0] - part.min(), part.max() - part[0]) <= near)
        limits = _TOLERANCE, _GAP, narrowest
        count = _kernels.closed_loops(part, extreme, *limits, turns, begin, end)
        found.append(first + np.column_stack([begin[:count], end[:count]]))
    loops = np.concatenate(found)
    before = np.concatenate([[0], np.cumsum(scored)])
    samples = loops[:, 1] + 1 - loops[:, 0]
    whole = before[loops[:, 1] + 1] - before[loops[:, 0]] == samples
    # With fewer samples the area of a loop is not known
    return np.asarray(loops[whole & (samples >= 8)])


def loop_areas(u: FloatArray, y: FloatArray, loops: IntArray) -> FloatArray:
    """Return the areas (C,) of loops (C, 2) from `closed_loops`, in units of input times output.

    The area of a loop is that of the polygon through its samples, also those of smaller loops
    within it. It is positive if the output is late.
    """
    if not loops.size:
        return np.zeros(0)
    x, z = u - u.mean(), y - np.nanmean(y)
    z[np.isnan(z)] = 0.0
    sums = np.zeros(u.size)
    np.cumsum(x[:-1] * z[1:] - x[1:] * z[:-1], out=sums[1:])
    begin, end = loops.T
    closing = x[end] * z[begin] - x[begin] * z[end]
    return np.asarray((sums[end] - sums[begin] + closing) / 2)
