"""Faults of a record: outliers, stuck and clipped stretches, and a lag."""

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.curves import Curves
from minorloop.identification.flat_stretches import clipped, stuck
from minorloop.identification.late_output import LONGEST_LAG, lagging
from minorloop.identification.rough_model import RoughRecord, beyond_neighbours
from minorloop.lab.faults import Fault, far_from_others
from minorloop.lab.noise import spread
from minorloop.threads import one_thread

_OFF_SD, _OFF, _FEW = 8.0, 0.2, 10
"""Least error of an outlier against the rough model, in robust deviations and in ranges; and least
readings for each outlier: if there are more, they are not outliers."""


def record_faults(
    u: FloatArray, y: FloatArray, curves: Curves, lag: int, *, searched: bool = False
) -> tuple[Fault, ...]:
    """Find the faults of a record, most important first.

    ``u`` and ``y`` (T,): the record, without codes; y is NaN if not measured; ``curves``: where the
    memory is reset; ``lag``: lag of the model in samples; ``searched``: whether the lag was
    searched; a remaining lag then has another cause.
    """
    known = np.isfinite(y)
    known[curves.positions(u.size) < lag] = False
    # Shorter records are not checked
    if np.count_nonzero(known) < 12:
        return ()
    with one_thread():
        return _faults(u, y, known, curves, lag, searched)


def _faults(
    u: FloatArray, y: FloatArray, known: BoolArray, curves: Curves, lag: int, searched: bool
) -> tuple[Fault, ...]:
    record = RoughRecord.of(u, y, known, curves, lag)
    sound = known.copy()
    cut = [*clipped(record)]
    flat = [*cut, *stuck(record, {k for one in cut for k in one.samples})]
    sound[[k for one in flat if one.kind == "stuck" for k in one.samples]] = False
    off = _off_rough_model(record)
    off = off[sound[off]]
    sound[off] = False
    late = [*lagging(record, sound, searched)]
    if late:  # A late output does not move at the beginning, which does not mean that it is stuck.
        flat = [one for one in flat if one.kind == "stuck" and one.samples[-1] > LONGEST_LAG]
    far = (far_from_others(y, off),) if off.size else ()
    return (*far, *flat, *late)


def _off_rough_model(record: RoughRecord) -> IntArray:
    """Readings with a much larger error against the rough model than their neighbours."""
    off = record.values - record.rough[record.places]
    limit = max(_OFF_SD * spread(off), _OFF * float(np.ptp(record.values)))
    found = record.places[beyond_neighbours(off, record.values, limit) & (np.abs(off) > limit)]
    return found if found.size <= record.places.size // _FEW else found[:0]
