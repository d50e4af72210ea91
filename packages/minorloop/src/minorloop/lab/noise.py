"""Noise of readings, by medians, and the readings that a faulty sensor repeats without any."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from minorloop.arrays import FloatArray

_MEDIAN = 0.6745
"""Median of the magnitude of a normal variable over its standard deviation."""


def noise_of(differences: FloatArray, order: int) -> float:
    """Return the standard deviation of white noise of which these are the differences.

    The squares of the binomial coefficients of an order sum to that of twice the order over it.
    The median leaves out what moves now and then.

    ``differences`` (N,): differences of a signal of some order, at least one; ``order``: 1 for
    differences of neighbours.
    """
    scale = _MEDIAN * math.sqrt(math.comb(2 * order, order))
    return float(np.median(np.abs(differences))) / scale


def spread(values: FloatArray) -> float:
    """Return the standard deviation of values (N,) by their median distance from the median."""
    return float(np.median(np.abs(values - np.median(values)))) / _MEDIAN


_FEWEST = 20
"""Equal readings in a row below which a sensor is not called stuck: they do little harm."""
_CHANCE = 1e-6
"""Expected number of such runs in a record of independent noise."""
_SUSPECT, _ACROSS = 0.5, 0.9
"""Shares of the range of the inputs over which all readings may be the same by a play, a plateau or
a threshold, as that of a heated wire, and over which no working actuator leaves them the same."""


@dataclass(frozen=True)
class FrozenReadings:
    """Stretches without noise of a sensor that has noise elsewhere."""

    runs: tuple[tuple[int, int], ...]
    """Tuple of (int, int). First reading and the one after the last of each stretch."""
    noise: float
    """Standard deviation of the noise elsewhere."""


def frozen(values: FloatArray) -> FrozenReadings:
    """Find runs of equal readings that are longer than the noise of the others lets expect.

    Nothing is found where the noise is less than the resolution of the readings: such a sensor
    repeats itself.

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
"""Steps of the resolution, and share of the range of the readings, by which the readings of two
holds are apart where the output has moved: by less, its creep may move it."""
_NONE = (math.nan, math.nan)


@dataclass(frozen=True)
class Response:
    """Inputs that moved the output on the way back from a turn, before that way left the last one.

    By congruency and with weights that are not negative, an output that such a way moved is moved
    wherever the input goes from one end of it to the other (Mayergoyz, Mathematical Models of
    Hysteresis, 1991), whatever came before.
    """

    moved: tuple[tuple[float, float], ...] = ()
    """Lowest and highest input of each such way, none within another."""
    turns: tuple[float, float] = _NONE
    """The last two turns of the input, the latest last."""
    at_turn: tuple[float, float] = _NONE
    """Lowest and highest reading of the end of the hold there."""
    level: float = math.nan
    """The latest input."""
    ends: tuple[float, float] = _NONE
    """Lowest and highest reading of the end of its hold."""

    def after(self, level: float, known: FloatArray, clear: float) -> Response:
        """Return what is known after one more hold.

        ``level``: its input; ``known`` (T,): its readings; ``clear``: change of the readings from
        which the output has moved, in their unit.
        """
        ends = _widened(_NONE, known[known.size // 2 :])
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

    A sensor that works may do so too: it is coarse, or the actuator has a threshold or is
    saturated. So it counts as faulty only

    - where the inputs of these holds reach across nearly the whole range of the run, unless the
      readings show that it is coarse; across all of it where no two readings differ, which do not
      show how coarse it is;
    - or where it is `frozen`, and not at an extreme of its readings, as a saturated one is.

    It is dead where fewer of these inputs moved the output before. Holds without any reading count
    as holds of the same reading, and as dead.
    """

    range: tuple[float, float]
    """Lowest and highest input of the run, as far as it is known."""
    readings: FloatArray = field(default_factory=lambda: np.zeros(0))
    """The different readings of the latest hold, in the unit of the output; NaN if it has none."""
    holds: int = 0
    """How many holds in a row repeat it."""
    inputs: tuple[float, float] = (0.0, 0.0)
    """Lowest and highest input of these holds, in its unit; zeros before the first."""
    verdict: Literal["dead", "faulty", "suspect", ""] = ""
    """``dead``, ``faulty``, ``suspect`` where the inputs reach across half of the range only, or
    empty."""
    repeated: int = 0
    """Readings of these holds, beside those of the first."""
    extremes: tuple[float, float] = _NONE
    """Lowest and highest reading before."""
    latest: tuple[FloatArray, ...] = ()
    """Tuple of (T,) arrays. Readings of the latest holds that did not repeat the hold before."""
    response: Response = field(default_factory=Response)
    """What moved the output before."""

    @classmethod
    def of_plan(cls, levels: FloatArray) -> RepeatedReadings:
        """Return what is known before the first hold.

        ``levels`` (N,): inputs of the run, NaN where they are not known yet.
        """
        return cls(_widened(_NONE, levels))

    def after(self, level: float, readings: FloatArray) -> RepeatedReadings:
        """Return what is known after one more hold.

        ``level``: its input; ``readings`` (T,): its readings, NaN where nothing was measured.
        """
        known = readings[np.isfinite(readings)]
        reach = _widened(self.range, level)
        values = np.unique(known) if known.size else np.array([math.nan])
        if values.size > 1 or not np.array_equal(values, self.readings, equal_nan=True):
            # Holds before the repeated reading that show the noise and the resolution
            latest = (*self.latest, known)[-4:]
            extremes = _widened(self.extremes, known)
            clear = max(
                _CLEAR * _resolution(np.concatenate(latest)), _SHARE * float(np.ptp(extremes))
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
            inputs=_widened(self.inputs, level),
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
        step = _resolution(before)
        if not step:
            return bool(share < _ACROSS or change == whole)
        # Resolution of a sensor, in steps of the range of its readings, from which it is not coarse
        return bool(np.ptp(before) >= 16 * step)

    def _is_frozen(self) -> bool:
        before = np.concatenate(self.latest)
        repeated = min(self.repeated, before.size)  # more of them show no more
        values = np.append(before, np.full(repeated, self.readings[0]))
        runs = frozen(values).runs
        inside = self.extremes[0] < self.readings[0] < self.extremes[1]
        return bool(inside and runs and runs[-1][1] == values.size and np.ptp(self.inputs))


def _resolution(readings: FloatArray) -> float:
    """Return the resolution of readings (N,), in their unit; 0 where no two differ."""
    steps = np.abs(np.diff(readings))
    steps = steps[steps > 0]
    # Quantile of the steps between readings that stands for the resolution of the sensor. The least
    # step would be too small where the format rounds small numbers more finely.
    return float(np.quantile(steps, 0.01)) if steps.size else 0.0


def _widened(ends: tuple[float, float], values: FloatArray | float) -> tuple[float, float]:
    """Return the lowest and the highest with more values; NaN does not count."""
    all_of_them = np.append(ends, values)
    return float(np.fmin.reduce(all_of_them)), float(np.fmax.reduce(all_of_them))


def noise_above_resolution(values: FloatArray) -> float:
    """Return the standard deviation of noise, 0 where there is none above the resolution."""
    bends = np.diff(values, 2)
    if bends.size < 2:
        return 0.0
    ways = np.sign(bends)  # products of large numbers overflow
    # Share of second differences that change sign from which they are noise. It is 0.73 for
    # independent noise (the correlation of neighbours is -2/3), and near 0 for a smooth signal
    if np.mean(ways[1:] * ways[:-1] < 0) < 0.5:
        return 0.0
    sd = noise_of(bends, 2)
    return sd if sd >= _resolution(values) else 0.0
