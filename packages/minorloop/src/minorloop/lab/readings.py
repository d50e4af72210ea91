"""Faults that the readings of a sensor show alone, and the readings that are left without them."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, are, counted
from minorloop.lab.codes import codes
from minorloop.lab.faults import Fault, clipped, listed, stuck, without
from minorloop.lab.frozen import frozen, noise_above_resolution

__all__ = ["DETECTORS", "usable"]

Detector: TypeAlias = Callable[[FloatArray], Iterable[Fault]]
"""Finds faults of one kind in readings (T,), NaN where there is none."""

_STUCK = 4
"""Equal readings in a row, at an end of the range of the output, that count as clipped."""


def usable(
    y: FloatArray, limits: tuple[float, float] | None = None
) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the readings (T,) with NaN in place of those that cannot be used; and the faults."""
    found: tuple[Fault, ...] = ()
    detectors: tuple[Detector, ...] = (partial(_beyond, limits), *DETECTORS)
    for detect in detectors:
        faults = tuple(detect(y))
        y, found = without(y, faults), (*found, *faults)
    return y, found


def _beyond(limits: tuple[float, float] | None, y: FloatArray) -> Iterator[Fault]:
    """Find readings at or beyond the limits of the sensor."""
    low, high = limits or (-np.inf, np.inf)
    if not low < high:
        raise ParameterError(f"the range of the sensor is [{low:g}, {high:g}]; give low below high")
    places = np.flatnonzero((y <= low) | (y >= high))
    if places.size:
        text = (
            f"{counted(places.size, 'reading')} {are(places.size)} beyond the range of the sensor"
        )
        remedy = "move the sensor or reduce the input, or correct the range (--holds range=...)"
        text += f", {low:g} to {high:g}: {listed(places, y)}"
        yield Fault.at(places, y, "range", text, remedy)


def _clipped(y: FloatArray) -> Iterator[Fault]:
    """Find extremes that an output with noise takes several times in a row."""
    known = y[np.isfinite(y)]
    if not known.size:
        return
    for word, extreme in (("lowest", known.min()), ("highest", known.max())):
        at = y == extreme
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))
        often = int(np.diff(edges)[::2].max()) >= _STUCK
        if often and noise_above_resolution(known[known != extreme]):
            yield clipped(y, np.flatnonzero(at), word)


def _stuck(y: FloatArray) -> Iterator[Fault]:
    """Find stretches without the noise that a sensor has elsewhere."""
    places = np.flatnonzero(np.isfinite(y))
    found = frozen(y[places])
    stretches = [places[begin:end] for begin, end in found.runs]
    if stretches:
        yield stuck(y, stretches, f"others scatter with a standard deviation of {found.noise:.2g}")


DETECTORS: tuple[Detector, ...] = (codes, _clipped, _stuck)
"""Each looks at the readings that those before have left."""
