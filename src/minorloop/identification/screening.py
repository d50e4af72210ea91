"""What in a record is no honest measurement: codes, outliers, stuck and clipped stretches, lag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.flat_stretches import clipped, stuck
from minorloop.identification.late_output import LONGEST_LAG, lagging
from minorloop.identification.rough_model import RecordFault, RoughRecord, spread
from minorloop.operators.memory import Start
from minorloop.threads import one_thread

OVERLOAD = 9e36
"""Magnitude from which a reading is an overload code, as 9.9e37 and 9.91e37 are."""
SENTINELS = (
    *(-999.0, -9999.0, -99999.0, -999999.0, -9999999.0, -999.25, -999.9, -9999.9, -6999.0, -7999.0),
    *(9999.0, 99999.0, 999999.0, 9999999.0, 999.99, 9999.9, 9999.99, 99999.9, 7999.0),
    *(32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(1e20, -1e20, 1e30, -1e30, 1e35, -1e35),
)
"""Values that loggers and files write for a reading that they do not have."""
_CODE_APART = 0.25
"""Spans of the other readings by which a sentinel must lie outside them."""
_FEWEST = 12
_SHOWN = 6
_FAR, _FAR_INPUT = 3.0, 30.0
"""Widths of the middle 90 % by which an outlier is outside, more where its input is outside."""
_OFF_SD, _OFF, _UNUSUAL = 8.0, 0.2, 0.5
"""Robust deviations and ranges by which an outlier is off, and where an input is too far out."""


@dataclass(frozen=True)
class Code:
    """A reading that is a code of the instrument and no measurement.

    Parameters
    ----------
    sample : int
        Which, counted from 0.
    value : float
        The code.
    """

    sample: int
    value: float


def codes(y: FloatArray) -> tuple[Code, ...]:
    """Readings that are overload codes or sentinels, apart from all others.

    Parameters
    ----------
    y : (T,) array
        Outputs; NaN where nothing was measured.
    """
    suspect = np.abs(y) >= OVERLOAD
    tolerance = 1e-6 * np.abs(SENTINELS)
    for value, close in zip(SENTINELS, tolerance, strict=True):
        suspect |= np.abs(y - value) <= close
    suspect &= np.isfinite(y)
    rest = y[np.isfinite(y) & ~suspect]
    if not suspect.any() or rest.size < 3:
        return ()
    low, high = rest.min(), rest.max()
    apart = _CODE_APART * (high - low)
    suspect &= (y < low - apart) | (y > high + apart)
    return tuple(Code(int(k), float(y[k])) for k in np.flatnonzero(suspect))


def screened(
    u: FloatArray, y: FloatArray, start: Start, lag: int, *, sought: bool = False
) -> tuple[RecordFault, ...]:
    """What is wrong with a record, most important first.

    Parameters
    ----------
    u, y : (T,) arrays
        The record, without codes; y is NaN where nothing was measured.
    start : start state
        Memory before the first sample.
    lag : int
        Samples by which the model lets the output follow the input.
    sought : bool
        Whether that lag is the best of several; then none beyond it is looked for.

    Returns
    -------
    tuple of Finding
    """
    known = np.isfinite(y)
    known[:lag] = False
    if np.count_nonzero(known) < _FEWEST:
        return ()
    with one_thread():
        return _screened(u, y, known, start, lag, sought)


def _screened(
    u: FloatArray, y: FloatArray, known: BoolArray, start: Start, lag: int, sought: bool
) -> tuple[RecordFault, ...]:
    record = RoughRecord.of(u, y, known, start, lag)
    far = _far(record)
    sound = known.copy()
    sound[far] = False
    if far.size:
        record = RoughRecord.of(u, y, sound, start, lag)
    cut = [*clipped(record)]
    flat = [*cut, *stuck(record, {k for one in cut for k in one.samples})]
    sound[[k for one in flat if one.kind == "stuck" for k in one.samples]] = False
    off = _off_course(record)
    off = off[sound[off]]
    sound[off] = False
    late = [] if sought else [*lagging(record, sound)]
    if late:  # A lagging output has not begun yet at first.
        flat = [one for one in flat if one.kind != "stuck" or one.samples[-1] > LONGEST_LAG]
    return (*_outliers(y, np.union1d(far, off), known), *flat, *late)


def _far(record: RoughRecord) -> IntArray:
    """Readings far outside the others at inputs that are not."""
    out, far = _outside(record.values), _outside(record.u[record.places])
    # An input that goes beyond the others explains an output that does.
    return _if_few(record.places[out > _FAR + _FAR_INPUT * far], record)


def _off_course(record: RoughRecord) -> IntArray:
    """Readings that lie off the rough model as their neighbours do not."""
    off = record.values - record.rough[record.places]
    alone = np.zeros(off.size)  # the first and the last have a neighbour on one side only
    steps = np.abs(np.diff(off))
    alone[1:-1] = np.min([np.abs(off[1:-1]), steps[:-1], steps[1:]], axis=0)
    limit = max(_OFF_SD * spread(off), _OFF * float(np.ptp(record.values)))
    usual = _outside(record.u[record.places]) < _UNUSUAL
    return _if_few(record.places[(alone > limit) & usual], record)


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
        f"{places.size} {word}: {_listed(y, places)} against what the input and the readings "
        f"around say; the others lie in [{rest.min():.6g}, {rest.max():.6g}]. Repeat the "
        "measurement, or empty these cells, which counts as not measured",
    )


def _outside(values: FloatArray) -> FloatArray:
    """Distance outside the middle 90 % of the values, in widths of it."""
    low, high = np.percentile(values, [5, 95])
    width = float(high - low) or float(np.ptp(values)) or 1.0
    return np.asarray(np.maximum(np.maximum(low - values, values - high), 0) / width)


def _listed(y: FloatArray, places: IntArray) -> str:
    shown = ", ".join(f"sample {k} ({y[k]:.6g})" for k in places[:_SHOWN])
    return shown if places.size <= _SHOWN else f"{shown} and {places.size - _SHOWN} more"
