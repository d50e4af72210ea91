"""Run a loop over independent signals on all cores."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Samples, as_samples, writable


def in_parallel(work: Callable[[int], None], rows: int) -> None:
    """Call ``work(row)`` for every row in threads; compiled loops release the GIL."""
    workers = min(rows, os.cpu_count() or 1)
    if workers < 2:
        for row in range(rows):
            work(row)
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, range(rows)))


def filled(u: npt.ArrayLike, fill: Callable[[FloatArray, FloatArray], None]) -> Samples:
    """Return outputs for inputs, (T,) or (S, T); ``fill(u, y)`` fills the outputs of one signal.

    Raises a `SignalError` if the inputs are not finite numbers of one of these shapes.
    """
    inputs = writable(as_samples(u, name="u"))
    outputs = np.empty_like(inputs)
    rows, out = np.atleast_2d(inputs), np.atleast_2d(outputs)
    in_parallel(lambda row: fill(rows[row], out[row]), len(rows))
    return outputs
