"""Find the stretches in which a noisy sensor repeats one reading exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.noise import noise_of

__all__ = ["FrozenReadings", "frozen"]

_FEWEST = 20
"""Equal readings in a row below which a sensor is not called stuck: they do little harm."""
_CHANCE = 1e-6
"""Expected number of such runs in a record of independent noise."""
_ALTERNATES = 0.5
"""Share of second differences that change sign from which they are noise. It is 0.73 for
independent noise (the correlation of neighbours is -2/3), and near 0 for a smooth signal."""
_FINE = 0.01
"""Quantile of the steps between readings that stands for the resolution of the sensor. The least
step would be too small where the format rounds small numbers more finely."""


@dataclass(frozen=True)
class FrozenReadings:
    """Stretches without noise of a sensor that has noise elsewhere.

    Parameters
    ----------
    runs : tuple of (int, int)
        First reading and the one after the last of each stretch.
    noise : float
        Standard deviation of the noise elsewhere.
    """

    runs: tuple[tuple[int, int], ...]
    noise: float


def frozen(values: FloatArray) -> FrozenReadings:
    """Find runs of equal readings that are longer than the noise of the others lets expect.

    Nothing is found where the noise is less than the resolution of the readings: such a sensor
    repeats itself.

    Parameters
    ----------
    values : (N,) array
        Finite readings in order.
    """
    none = FrozenReadings((), 0.0)
    if values.size < 2 * _FEWEST:
        return none
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    counts = np.diff(edges)
    if counts.max() < _FEWEST:
        return none
    noise = _noise(values[edges[:-1]].repeat(np.minimum(counts, _FEWEST)))
    if not noise:
        return none
    short = counts[counts < _FEWEST]
    equal = max(1 - short.size / max(short.sum(), 1), 1 / values.size)  # share of neighbours
    least = max(_FEWEST, 1 + np.log(values.size / _CHANCE) / -np.log(equal))
    long = np.flatnonzero(counts >= least)
    return FrozenReadings(tuple((int(edges[k]), int(edges[k + 1])) for k in long), noise)


def _noise(values: FloatArray) -> float:
    """Return the standard deviation of noise, 0 where there is none above the resolution."""
    bends = np.diff(values, 2)
    ways = np.sign(bends)  # products of large numbers overflow
    if np.mean(ways[1:] * ways[:-1] < 0) < _ALTERNATES:
        return 0.0
    sd = noise_of(bends, 2)
    steps = np.abs(np.diff(values))
    return sd if sd >= np.quantile(steps[steps > 0], _FINE) else 0.0
