"""Condense the samples of long records before a solver uses them."""

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, Levels
from minorloop.identification import _condensing_kernels as _kernels
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach

LONG = 20_000
"""Least samples of a record that is condensed."""


@dataclass(frozen=True, eq=False)
class Condensed:
    """A shorter record with the same normal equations."""

    u: FloatArray
    """Shape (T,). Inputs."""
    measured: BoolArray
    """Shape (T,). Whether there is an output after each input."""
    y: FloatArray
    counts: FloatArray
    """``y`` and ``counts``: shape (M,). Outputs, and the number of samples that each replaces, not
    necessarily whole."""
    rows: IntArray
    """Shape (M,). A sample of the long record for each output."""
    within: float
    """Mean square of the outputs about the polynomials that replace them."""


def condense(
    levels: Levels,
    start: Start,
    u: FloatArray,
    y: FloatArray,
    measured: BoolArray,
    labels: IntArray | None = None,
) -> Condensed | None:
    """Condense samples on one branch and in one band; None if the record is short.

    Within a band of the levels, the regressors are polynomials of the input of degree two, so that
    three weighted outputs have the same normal equations as any number of samples.

    ``levels`` (L + 1,): thresholds, or a refinement of them; ``start``: memory before the first
    input. The condensed record begins at negative saturation. ``u`` and ``y`` (T,): inputs and
    outputs; ``measured`` (T,) of bool: whether an output is used; ``labels`` (T,) of int: samples
    with different labels are not condensed together.
    """
    if u.size < LONG or u.min() < levels[0] or u.max() > levels[-1]:
        return None
    bands = levels.size - 1
    plane = Preisach(levels, np.zeros((bands, bands)))
    past = np.array(plane.memory(start).extrema[1:])
    tables, most = plane.tables, u.size + 2
    inputs, outputs, weights = np.empty(most), np.empty(most), np.empty(most)
    rows = np.empty(most, dtype=np.int64)
    count = _kernels.condense(
        tables.levels,
        tables.buckets,
        tables.per_unit,
        past,
        np.ascontiguousarray(u),
        y,
        measured,
        np.zeros(u.size, dtype=np.int64) if labels is None else labels,
        inputs,
        outputs,
        weights,
        rows,
    )
    kept = weights[:count] > 0
    short, counts = outputs[:count][kept], weights[:count][kept]
    middle = float(y[measured].mean())
    square = float(np.sum((y[measured] - middle) ** 2) - counts @ (short - middle) ** 2)
    within = max(square, 0.0) / float(counts.sum())
    short_u = np.concatenate([past, inputs[:count]])
    before = np.zeros(past.size, dtype=np.bool_)
    return Condensed(
        short_u, np.concatenate([before, kept]), short, counts, rows[:count][kept], within
    )
