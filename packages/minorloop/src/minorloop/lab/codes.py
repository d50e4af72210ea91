"""Readings that are codes of an instrument: overload, or nothing measured."""

import numpy as np

from minorloop.arrays import LARGEST, BoolArray, FloatArray
from minorloop.errors import SignalError
from minorloop.lab.faults import Fault, codes_among, without

__all__ = ["FEWEST", "OVERLOAD", "SENTINELS", "codes", "without_codes"]

FEWEST = 3
"""Measured samples below which nothing is fitted."""

OVERLOAD = 9e36
"""Magnitude from which a reading is an overload code, as 9.9e37 and 9.91e37 are."""
SENTINELS = (
    *(-999.0, -9999.0, -99999.0, -999999.0, -9999999.0, -999.25, -999.9, -9999.9, -6999.0, -7999.0),
    *(9999.0, 99999.0, 999999.0, 9999999.0, 999.99, 9999.9, 9999.99, 99999.9, 7999.0),
    *(32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(1e20, -1e20, 1e30, -1e30, 1e35, -1e35),
)
"""Values that loggers and file formats use for a missing reading."""
_CODE_DISTANCE = 0.25
"""Distance of a sentinel from the range of all other readings, over that range."""
_ABSURD, _ABSURD_SHARE, _FEWEST = 1e4, 0.001, 12
"""Distance from the median of a reading that is none, over the greatest of all other distances; the
share of readings that may be so far away; and readings from which this is checked."""


def codes(y: FloatArray, noun: str = "reading") -> tuple[Fault, ...]:
    """Find the readings that are overload codes or sentinels, or absurdly far from all others.

    Parameters
    ----------
    y : (T,) array
        Outputs; NaN where nothing was measured.
    noun : str
        What they are.
    """
    known = np.sort(SENTINELS)
    tolerance = 1e-6 * np.abs(known)
    suspect = np.abs(y) >= OVERLOAD
    place = np.flatnonzero(np.abs(y) >= 0.999 * np.abs(known).min())
    above = np.searchsorted(known, y[place])
    for near in (np.maximum(above - 1, 0), np.minimum(above, known.size - 1)):
        suspect[place[np.abs(y[place] - known[near]) <= tolerance[near]]] = True
    suspect |= _absurd(np.where(suspect, np.nan, y))
    if not suspect.any():
        return ()
    rest = y[np.isfinite(y) & ~suspect]
    suspect &= np.isfinite(y)
    if rest.size < 3:
        return ()
    low, high = rest.min(), rest.max()
    apart = _CODE_DISTANCE * (high - low)
    suspect &= (y < low - apart) | (y > high + apart)
    return (codes_among(y, np.flatnonzero(suspect), noun),) if suspect.any() else ()


def without_codes(u: FloatArray, y: FloatArray) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the outputs with NaN in place of codes, and the fault that they are.

    Raises a `SignalError` if an input is an overload code, or hardly any output is none.

    Parameters
    ----------
    u, y : (T,) array
        Inputs, and outputs; NaN where nothing was measured.
    """
    over = np.flatnonzero(np.abs(u) >= OVERLOAD)
    if over.size and codes(u):
        raise SignalError(
            f"u is {u[over[0]]:g} at index {over[0]}, which is an overload code and no input; give "
            "what was applied, or cut these rows"
        )
    finite = y[np.isfinite(y)]
    sound = int(np.count_nonzero(np.abs(finite) < OVERLOAD))
    if sound < min(finite.size, FEWEST) and np.abs(finite).max() <= LARGEST:
        raise SignalError(
            f"{f'{finite.size - sound} of' if sound else 'all'} {finite.size} outputs are overload "
            f"codes, as {finite[np.abs(finite) >= OVERLOAD][0]:g} is, and no measurement; check "
            "the range of the instrument and repeat, or scale what was measured to below "
            f"{OVERLOAD:g}"
        )
    coded = codes(y)
    return without(y, coded), coded


def _absurd(y: FloatArray) -> BoolArray:
    """Return the readings (T,) that are ten thousand times further away than all others."""
    known = np.isfinite(y)
    values = y[known]
    if values.size < _FEWEST:
        return np.zeros(y.size, dtype=np.bool_)
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.abs(y - np.median(values))
        last = values.size - 1 - max(int(_ABSURD_SHARE * values.size), 1)
        others = np.partition(distance[known], last)[last]
        found: BoolArray = known & (others > 0) & (distance > _ABSURD * others)
    return found
