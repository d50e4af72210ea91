"""Faults of a record: outliers, stuck and clipped stretches, and a lag."""

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.curves import Curves
from minorloop.identification.flat_stretches import clipped, stuck
from minorloop.identification.late_output import LONGEST_LAG, lagging
from minorloop.identification.rough_model import (
    RecordFault,
    RoughRecord,
    beyond_neighbours,
    spread,
)
from minorloop.threads import one_thread

_FEWEST = 12
"""Readings below which a record is not checked."""
_SHOWN = 6
_OFF_SD, _OFF, _UNUSUAL = 8.0, 0.2, 0.5
"""Error of an outlier against the rough model, in robust deviations and in ranges; and the distance
of its input from the middle 90 % above which the rough model is not reliable."""


def record_faults(
    u: FloatArray, y: FloatArray, curves: Curves, lag: int, *, searched: bool = False
) -> tuple[RecordFault, ...]:
    """Find the faults of a record, most important first.

    Parameters
    ----------
    u, y : (T,) arrays
        The record, without codes; y is NaN where nothing was measured.
    curves : Curves
        Where the memory is reset.
    lag : int
        Lag of the model in samples.
    searched : bool
        Whether that lag was searched; then what is left is no lag alone.

    Returns
    -------
    tuple of RecordFault
    """
    known = np.isfinite(y)
    known[curves.positions(u.size) < lag] = False
    if np.count_nonzero(known) < _FEWEST:
        return ()
    with one_thread():
        return _faults(u, y, known, curves, lag, searched)


def _faults(
    u: FloatArray, y: FloatArray, known: BoolArray, curves: Curves, lag: int, searched: bool
) -> tuple[RecordFault, ...]:
    record = RoughRecord.of(u, y, known, curves, lag)
    sound = known.copy()
    cut = [*clipped(record)]
    flat = [*cut, *stuck(record, {k for one in cut for k in one.samples})]
    sound[[k for one in flat if one.kind == "stuck" for k in one.samples]] = False
    off = _off_rough_model(record)
    off = off[sound[off]]
    sound[off] = False
    late = [*lagging(record, sound, searched)]
    if late:  # A lagging output does not move at the beginning, and belongs to other inputs.
        flat = [one for one in flat if one.kind == "stuck" and one.samples[-1] > LONGEST_LAG]
    return (*_outliers(y, off, known), *flat, *late)


def _off_rough_model(record: RoughRecord) -> IntArray:
    """Readings with an error against the rough model that their neighbours do not have."""
    off = record.values - record.rough[record.places]
    limit = max(_OFF_SD * spread(off), _OFF * float(np.ptp(record.values)))
    found = beyond_neighbours(off, record.values, limit) & (np.abs(off) > limit)
    usual = _outside(record.u[record.places]) < _UNUSUAL
    return _if_few(record.places[found & usual], record)


def _if_few(places: IntArray, record: RoughRecord) -> IntArray:
    """The places, unless they are too many to be outliers."""
    return places if places.size <= record.places.size // 10 else places[:0]


def _outliers(y: FloatArray, places: IntArray, known: BoolArray) -> Iterator[RecordFault]:
    if not places.size:
        return
    rest = y[np.setdiff1d(np.flatnonzero(known), places)]
    word = "outlier" if places.size == 1 else "outliers"
    yield RecordFault(
        "outlier",
        tuple(map(int, places)),
        f"{places.size} {word}: {_listed(y, places)} contradicts the input and the readings "
        f"around it; the others lie in [{rest.min():.6g}, {rest.max():.6g}]. Repeat the "
        "measurement, or empty these cells, which then count as not measured",
    )


def _outside(values: FloatArray) -> FloatArray:
    """Distance from the middle 90 % of the values, over its width."""
    low, high = np.percentile(values, [5, 95])
    width = float(high - low) or float(np.ptp(values)) or 1.0
    outside = low - values
    np.maximum(outside, values - high, out=outside)
    np.maximum(outside, 0, out=outside)
    return np.asarray(outside / width)


def _listed(y: FloatArray, places: IntArray) -> str:
    shown = ", ".join(f"sample {k} ({y[k]:.6g})" for k in places[:_SHOWN])
    return shown if places.size <= _SHOWN else f"{shown} and {places.size - _SHOWN} more"
