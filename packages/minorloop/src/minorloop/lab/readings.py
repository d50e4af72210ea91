"""Readings of a sensor that can be used, and their conversion, with notes on the others."""

from collections.abc import Sequence

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.errors import ParameterError, are
from minorloop.lab.codes import codes
from minorloop.lab.conversion import Conversion
from minorloop.lab.frozen import frozen
from minorloop.lab.holds import FoundHold
from minorloop.lab.records import Record
from minorloop.lab.spikes import spikes

__all__ = ["converted", "input_without_spikes", "usable", "without_spikes"]

_STUCK = 4
"""Equal readings in a row, at an end of the range of the output, that count as saturated."""
_NOISY = 0.3
"""Share of the readings at which an output with noise turns; two thirds for independent noise."""


def usable(record: Record, limits: tuple[float, float] | None) -> tuple[FloatArray, list[str]]:
    """Return the readings, NaN where the sensor is beyond its range or saturated; and notes."""
    y, notes = record.y, []
    coded = codes(y)
    if coded:
        notes.append(
            f"{len(coded)} of {y.size} readings of {record.output} are codes of the instrument, "
            f"first {coded[0].value:g} at sample {coded[0].sample}; they are not used"
        )
        y = y.copy()
        y[[code.sample for code in coded]] = np.nan
    if limits is not None:
        low, high = limits
        if not low < high:
            raise ParameterError(
                f"the range of the sensor is [{low:g}, {high:g}]; give low below high"
            )
        beyond = (y <= low) | (y >= high)
        if beyond.any():
            notes.append(
                f"{np.count_nonzero(beyond)} of {y.size} readings of {record.output} "
                f"{are(int(np.count_nonzero(beyond)))} beyond "
                f"the range of the sensor, {low:g} to {high:g}, first {y[np.argmax(beyond)]:g} at "
                f"sample {np.argmax(beyond)}; they are not used: move the sensor or reduce the "
                "input, or correct the range of the sensor"
            )
            y = np.where(beyond, np.nan, y)
    for extreme, saturated in _saturated(y):
        notes.append(
            f"the sensor is saturated: {np.count_nonzero(saturated)} of {y.size} readings of "
            f"{record.output} {are(int(np.count_nonzero(saturated)))} exactly {extreme:g}, first "
            f"at sample {np.argmax(saturated)}; "
            "they are not used: use a wider range or reduce the input"
        )
        y = np.where(saturated, np.nan, y)
    places = np.flatnonzero(np.isfinite(y))
    found = frozen(y[places])
    if found.runs:
        stuck = np.concatenate([places[begin:end] for begin, end in found.runs])
        first = int(stuck[0])
        notes.append(
            f"the sensor is stuck: {stuck.size} of {y.size} readings of {record.output} repeat one "
            f"exactly, first {y[first]:g} from sample {first} to "
            f"{places[found.runs[0][1] - 1]}, while others scatter with a standard deviation of "
            f"{found.noise:.2g}; they are not used: check the sensor and the logger, and measure "
            "these holds again"
        )
        y = y.copy()
        y[stuck] = np.nan
    return y, notes


def without_spikes(
    record: Record, readings: FloatArray, holds: Sequence[FoundHold]
) -> tuple[FloatArray, list[str]]:
    """Return the readings, NaN where they are spikes within a hold; and notes."""
    found = np.zeros(readings.size, dtype=np.bool_)
    for hold in holds:
        found[hold.begin : hold.end] = spikes(readings[hold.begin : hold.end])
    count = int(np.count_nonzero(found))
    if not count:
        return readings, []
    first = int(np.argmax(found))
    note = (
        f"{count} of {readings.size} readings of {record.output} {are(count)} far from the "
        f"readings around {'it' if count == 1 else 'them'}, first {readings[first]:g} at sample "
        f"{first}; {'it is' if count == 1 else 'they are'} not used: check the cable and the "
        "trigger of the sensor"
    )
    return np.where(found, np.nan, readings), [note]


def input_without_spikes(u: FloatArray, name: str) -> tuple[FloatArray, list[str]]:
    """Return a measured input with straight lines in place of its spikes; and notes.

    A spike would count as a passed extreme, and delete the memory of a model.
    """
    found = spikes(u)
    if not found.any():
        return u, []
    samples, count = np.arange(u.size), int(np.count_nonzero(found))
    first = int(np.argmax(found))
    one = count == 1
    note = (
        f"{count} of {u.size} readings of {name} {are(count)} far from those around "
        f"{'it' if one else 'them'}, first {u[first]:g} at sample {first}; "
        f"{'it counts' if one else 'they count'} as {'an error' if one else 'errors'} of the "
        "measurement and not as the input: if the source made them, give what was applied as input"
    )
    return np.interp(samples, samples[~found], u[~found]), [note]


def _saturated(y: FloatArray) -> list[tuple[float, BoolArray]]:
    """Return extremes that a noisy output takes several times in a row, and where it does."""
    known = y[np.isfinite(y)]
    low, high = known.min(initial=np.inf), known.max(initial=-np.inf)
    ways = np.sign(np.diff(known[(known > low) & (known < high)]))
    if ways.size < 2 * _STUCK or np.mean(ways[1:] * ways[:-1] < 0) < _NOISY:
        return []
    found = []
    for extreme in (float(low), float(high)):
        at = y == extreme
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
        if edges.size and int(np.diff(edges)[::2].max()) >= _STUCK:
            found.append((extreme, at))
    return found


def converted(readings: FloatArray, conversion: Conversion) -> tuple[FloatArray, list[str]]:
    """Return the converted readings, NaN where the conversion does not cover them; and notes."""
    y = conversion.convert(readings)
    lost = np.isfinite(readings) & ~np.isfinite(y)
    if not lost.any():
        return y, []
    first = int(np.argmax(lost))
    return y, [
        f"{np.count_nonzero(lost)} of {y.size} readings cannot be converted, first "
        f"{readings[first]:g} at sample {first}; the conversion covers {conversion.covered}: check "
        "the geometry of the laser, or the calibration and its unit (--convert)"
    ]
