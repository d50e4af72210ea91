"""Noise of readings, by medians, and detection of a faulty sensor that repeats its readings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from minorloop.arrays import FloatArray

_MEDIAN = 0.6745
"""Median of the magnitude of a normal variable over its standard deviation."""


def noise_of(differences: FloatArray, order: int) -> float:
    """Return the standard deviation of white noise from its differences.

    The squares of the binomial coefficients of an order n sum to the binomial coefficient of 2n
    over n. The median ignores occasional motions.

    ``differences`` (N,): differences of a signal of some order, at least one; ``order``: 1 for
    differences of neighbours.
    """
    scale = _MEDIAN * math.sqrt(math.comb(2 * order, order))
    return float(np.median(np.abs(differences))) / scale


def spread(values: FloatArray) -> float:
    """Return the standard deviation of values (N,) by their median distance from the median."""
    return float(np.median(np.abs(values - np.median(values)))) / _MEDIAN


_FEWEST = 20
"""Least equal readings in a row of a stuck sensor: fewer do little harm."""
_CHANCE = 1e-6
"""Expected number of such runs of equal readings in a record of independent noise."""
_SUSPECT, _ACROSS = 0.5, 0.9
"""Shares of the range of the inputs. Up to the first, a play, a plateau or a threshold, as of a
heated wire, may keep all readings equal; over the second, no working actuator does."""


@dataclass(frozen=True)
class FrozenReadings:
    """Stretches without noise of a sensor that has noise elsewhere."""

    runs: tuple[tuple[int, int], ...]
    """Tuple of (int, int). First reading of each stretch, and the reading after its last."""
    noise: float
    """Standard deviation of the noise elsewhere."""


def frozen(values: FloatArray) -> FrozenReadings:
    """Find runs of equal readings that are longer than the noise of the others explains.

    There are none if the noise is less than the resolution of the readings: such a sensor repeats
    its readings.

    ``values`` (N,): finite readings in order.
    """
    none = FrozenReadings((), 0.0)
    if values.size < 2 * _FEWEST:
        return none
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    counts = np.diff(edges)
    if counts.max() < _FEWEST:
        return none
    noise = noise_above_resolution(values[edges[:-1]].repeat(np.minimum(counts, _FEWEST)))
    if not noise:
        return none
    short = counts[counts < _FEWEST]
    equal = max(1 - short.size / max(short.sum(), 1), 1 / values.size)  # share of neighbours
    least = max(_FEWEST, 1 + np.log(values.size / _CHANCE) / -np.log(equal))
    long = np.flatnonzero(counts >= least)
    return FrozenReadings(tuple((int(edges[k]), int(edges[k + 1])) for k in long), noise)


_CLEAR, _SHARE = 3, 0.02
"""Least distance between the readings of two holds if the output has moved, in steps of the
resolution and as a share of the range of the readings: creep may cause a smaller distance."""
_NONE = (math.nan, math.nan)


@dataclass(frozen=True)
class Response:
    """Inputs that moved the output on the way back from a turn, within the last way.

    By congruency and with weights that are not negative, the output moves again whenever the input
    goes from one end of such a way to the other (Mayergoyz, Mathematical Models of Hysteresis,
    1991), with any memory.
    """

    moved: tuple[tuple[float, float], ...] = ()
    """Lowest and highest input of each such way; no way is within another."""
    turns: tuple[float, float] = _NONE
    """The last two turns of the input, the latest last."""
    at_turn: tuple[float, float] = _NONE
    """Lowest and highest reading at the end of the hold at the latest turn."""
    level: float = math.nan
    """The latest input."""
    ends: tuple[float, float] = _NONE
    """Lowest and highest reading at the end of the latest hold."""

    def after(self, level: float, known: FloatArray, clear: float) -> Response:
        """Return the state after one more hold.

        ``level``: its input; ``known`` (T,): its readings; ``clear``: least change of the readings,
        in their unit, if the output has moved.
        """
        ends = widened(_NONE, known[known.size // 2 :])
        turns, at_turn, moved = self.turns, self.at_turn, self.moved
        if (level - self.level) * (self.level - turns[1]) <= 0 or math.isnan(turns[1]):
            turns, at_turn = (turns[1], self.level), self.ends
        way = min(level, turns[1]), max(level, turns[1])
        apart = max(ends[0] - at_turn[1], at_turn[0] - ends[1])
        inside = abs(level - turns[1]) <= abs(turns[0] - turns[1])
        if inside and apart >= clear > 0 and not self.reaches(way):
            wider = [one for one in moved if not (one[0] <= way[0] and way[1] <= one[1])]
            moved = (*wider, way)
        return Response(moved, turns, at_turn, level, ends)

    def reaches(self, inputs: tuple[float, float]) -> bool:
        """Whether inputs from the lowest to the highest have moved the output before."""
        return any(inputs[0] <= low and high <= inputs[1] for low, high in self.moved)


@dataclass(frozen=True, eq=False)
class RepeatedReadings:
    """The reading that a sensor repeats exactly from hold to hold, while the input changes.

    A working sensor may also repeat its readings: it is coarse, or the actuator has a threshold or
    is saturated. So the sensor counts as faulty only

    - if the inputs of these holds cover nearly the whole range of the run, unless the readings show
      that the sensor is coarse; equal readings do not show this, and need the whole range;
    - or if it is `frozen`, and not at an extreme of its readings, as a saturated sensor is.

    It is dead if a smaller range of these inputs moved the output before. Holds without any reading
    count as holds of the same reading, and as dead.
    """

    range: tuple[float, float]
    """Lowest and highest input of the run, as far as it is known."""
    readings: FloatArray = field(default_factory=lambda: np.zeros(0))
    """The different readings of the latest hold, in the unit of the output; NaN if it has none."""
    holds: int = 0
    """Number of holds in a row that repeat the reading."""
    inputs: tuple[float, float] = (0.0, 0.0)
    """Lowest and highest input of these holds, in its unit; zeros before the first."""
    verdict: Literal["dead", "faulty", "suspect", ""] = ""
    """``dead``, ``faulty``, ``suspect`` if the inputs cover only half of the range, or empty."""
    repeated: int = 0
    """Number of readings of these holds, without the first hold."""
    extremes: tuple[float, float] = _NONE
    """Lowest and highest reading before."""
    latest: tuple[FloatArray, ...] = ()
    """Tuple of (T,) arrays. Readings of the latest holds that did not repeat the hold before."""
    response: Response = field(default_factory=Response)
    """Inputs that moved the output before."""

    @classmethod
    def of_plan(cls, levels: FloatArray) -> RepeatedReadings:
        """Return the state before the first hold.

        ``levels`` (N,): inputs of the run, NaN if not known yet.
        """
        return cls(widened(_NONE, levels))

    def after(self, level: float, readings: FloatArray) -> RepeatedReadings:
        """Return the state after one more hold.

        ``level``: its input; ``readings`` (T,): its readings, NaN if not measured.
        """
        known = readings[np.isfinite(readings)]
        reach = widened(self.range, level)
        values = np.unique(known) if known.size else np.array([math.nan])
        if values.size > 1 or not np.array_equal(values, self.readings, equal_nan=True):
            # Holds before the repeated reading that show the noise and the resolution
            latest = (*self.latest, known)[-4:]
            extremes = widened(self.extremes, known)
            clear = max(
                _CLEAR * resolution(np.concatenate(latest)), _SHARE * float(np.ptp(extremes))
            )
            return RepeatedReadings(
                range=reach,
                readings=values,
                holds=1,
                inputs=(level, level),
                extremes=extremes,
                latest=latest,
                response=self.response.after(level, known, clear),
            )
        now = replace(
            self,
            range=reach,
            holds=self.holds + 1,
            inputs=widened(self.inputs, level),
            repeated=self.repeated + known.size,
            response=self.response.after(level, known, math.inf),
        )
        if not known.size or now.response.reaches(now.inputs):
            return replace(now, verdict="dead")
        faulty = now._is_across(_ACROSS) or now._is_frozen()
        suspect = now._is_across(_SUSPECT)
        return replace(now, verdict="faulty" if faulty else "suspect" if suspect else "")

    def _is_across(self, share: float) -> bool:
        change, whole = np.ptp(self.inputs), np.ptp(self.range)
        if not change or change < share * whole:
            return False
        before = np.concatenate(self.latest)
        step = resolution(before)
        if not step:
            return bool(share < _ACROSS or change == whole)
        # A sensor with at least 16 steps over the range of its readings is not coarse
        return bool(np.ptp(before) >= 16 * step)

    def _is_frozen(self) -> bool:
        before = np.concatenate(self.latest)
        repeated = min(self.repeated, before.size)  # more repetitions do not show more
        values = np.append(before, np.full(repeated, self.readings[0]))
        runs = frozen(values).runs
        inside = self.extremes[0] < self.readings[0] < self.extremes[1]
        return bool(inside and runs and runs[-1][1] == values.size and np.ptp(self.inputs))


def resolution(readings: FloatArray) -> float:
    """Return the resolution of readings (N,), in their unit; 0 if all are equal."""
    steps = np.abs(np.diff(readings))
    steps = steps[steps > 0]
    # Quantile of the steps between readings that is the resolution of the sensor. The least step
    # would be too small if the format rounds small numbers more finely.
    return float(np.quantile(steps, 0.01)) if steps.size else 0.0


def widened(ends: tuple[float, float], values: FloatArray | float) -> tuple[float, float]:
    """Return the lowest and the highest value after more values; NaN does not count."""
    all_of_them = np.append(ends, values)
    return float(np.fmin.reduce(all_of_them)), float(np.fmax.reduce(all_of_them))


def noise_above_resolution(values: FloatArray) -> float:
    """Return the standard deviation of noise, 0 if it is below the resolution."""
    bends = np.diff(values, 2)
    if bends.size < 2:
        return 0.0
    ways = np.sign(bends)  # products of large numbers overflow
    # Least share of second differences of noise that change sign. It is 0.73 for independent noise
    # (the correlation of neighbours is -2/3), and near 0 for a smooth signal
    if np.mean(ways[1:] * ways[:-1] < 0) < 0.5:
        return 0.0
    sd = noise_of(bends, 2)
    return sd if sd >= resolution(values) else 0.0
