"""Bridge the gaps of a record: find those over which the memory of its input continues.

An input that goes one way across a gap leaves nothing open. Where it turned in the gap, the extreme
is estimated from both sides. How well is shown by the turns that were recorded: at each of them a
gap of the same length is made, and the estimates are compared with what was recorded there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.errors import are, counted
from minorloop.lab.holds import turning_points
from minorloop.lab.noise import noise_of
from minorloop.lab.timebase import GAP, UNEVEN, TimeCheck

__all__ = ["Bridges", "between", "bridged", "known_memory", "with_lost_rows"]

UNKNOWN = 0.005
"""Share of the Preisach plane whose state may be unknown after a gap."""

_FEWEST = 3
"""Least samples on each side of a gap that show how the input moves."""
_FITTED = 5
"""Least samples on each side of a gap for a parabola: two more than it has coefficients."""
_SURE = 6.0
"""Standard deviations of noise from which a reversal is one of the input."""
_FASTER, _SLOWER = 2.5, 0.5
"""Most and least speed across a gap, over the greater and the lesser of the speeds beside it. A
sine over half a period whose middle third is missing has twice the speed there; a ramp has the
same; an input that jumps in the gap is beyond the first, one that turns twice is below the second.
"""
_TRIALS, _FEWEST_TRIALS = 8, 3
"""Most recorded turns at which an estimate is tried, and least that show its error."""
_MARGIN = 2.0
"""An extreme may be off by so many times the largest error of the trials, which are few."""
_MISFIT = 0.01
"""Share of the change of the input beside a gap by which parabolas may miss it without trials: on
a sine, that of a gap of a tenth of the period. A longer one may hide several turns."""
_CORNERS = 0.5
"""Share of the usual change from row to row by which an input that steps also changes beside most
of its turns, and least change where all are alike; a sine with more than nine samples in a period
changes less at its turns."""
_LARGE = 0.1
"""Share of the range from which changes are steps although they differ; noise is less."""
_BESIDE = 5
"""Changes on each side of a lost row that show by how much the input steps there."""
_MOST_LOST = 0.2
"""Largest share of intervals with lost rows; with more, the hold times of a plan may differ."""

_CUBIC, _CORNER = 0, 1
"""Two estimates of an extreme: of a cubic with the slopes beside the gap, and where these meet."""


@dataclass(frozen=True, eq=False)
class Bridges:
    """What is known about the input in each gap."""

    after: IntArray
    """Shape (G,). Samples after which a gap follows."""
    known: BoolArray
    """Shape (G,). Whether the input goes one way across the gap, or its turn there is estimated."""
    t: FloatArray
    u: FloatArray
    """``t`` and ``u``: shape (G,). Time and value of the extreme in the gap, where the input
    turned; NaN elsewhere."""
    doubt: FloatArray
    """Shape (G,). By how much the extreme may be off in either direction; 0 where it did not turn.
    """

    @property
    def unknown(self) -> IntArray:
        """Samples after which a gap follows that the memory does not cross."""
        return self.after[~self.known]

    @property
    def turned(self) -> BoolArray:
        """In which gaps the input turned at an extreme that is known in part."""
        return np.isfinite(self.u)

    def turns(self) -> list[tuple[int, float, float]]:
        """Sample after each such gap, and its extreme and doubt."""
        after, u, doubt = (x[self.turned].tolist() for x in (self.after + 1, self.u, self.doubt))
        return list(zip(after, u, doubt, strict=True))

    def inserted(self, t: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return times and inputs with the extremes in gaps, and before which samples they are."""
        places = self.after[self.turned] + 1
        times = np.insert(t, places, self.t[self.turned])
        return times, np.insert(u, places, self.u[self.turned]), places


def known_memory(
    u: npt.ArrayLike, breaks: npt.ArrayLike, bridges: Bridges | None = None
) -> BoolArray:
    """Return where the memory of a Preisach plane is known although the input has breaks.

    After a break only relays count as known that the input has switched since: those with alpha
    up to its greatest value or beta down to its least. After a turn in a gap those are unknown
    whose thresholds the extreme may have passed or not, until the input has switched them. The
    memory is known while both together cover less than 0.5 % of the plane over the range of the
    whole input.

    Parameters
    ----------
    u : (T,) array_like
        Inputs.
    breaks : (B,) array_like of int
        Samples after which the input is unknown for a while.
    bridges : Bridges, optional
        Gaps in which the input turned at an extreme that is known in part.
    """
    inputs, places = np.asarray(u, np.float64), np.asarray(breaks, np.int64)
    turned = () if bridges is None else bridges.turns()
    span = float(np.ptp(inputs))
    if span == 0 or not (places.size or turned):
        return np.ones(inputs.size, dtype=np.bool_)
    unknown = np.zeros(inputs.size)
    for begin, end in pairwise([*places + 1, inputs.size]):
        unknown[begin:end] = _after_break(inputs, begin, end)
    for first, extreme, doubt in turned:
        areas = _after_turn(inputs, first, extreme, doubt)
        unknown[first : first + areas.size] += areas
    return np.asarray(2 * unknown <= UNKNOWN * span**2)


def with_lost_rows(check: TimeCheck, u: npt.ArrayLike) -> TimeCheck:
    """Return the times with gaps where rows are lost of a table that has one row for each hold.

    In a record of a moving input (T,) a short gap hides nothing. In a table whose input steps from
    row to row, one lost row can hide a turn. A row is lost where an interval is a whole number of
    times the usual one, and the input steps if it changes beside its turns as elsewhere, by enough
    to matter to the memory. Other times are returned as they are.
    """
    inputs, steps = np.asarray(u, np.float64), np.diff(check.t) / check.interval
    whole = np.round(steps)
    off = np.abs(steps - whole) > UNEVEN
    lost = np.flatnonzero((whole > 1) & (whole <= GAP) & ~off)
    uneven = np.setdiff1d(np.flatnonzero(off | (whole == 0)), check.breaks)
    if not 0 < lost.size <= _MOST_LOST * steps.size or uneven.size > lost.size:
        return check
    if not _in_steps(inputs):
        return check
    longest = int(lost[np.argmax(steps[lost])])
    rows = int(whole[lost].sum()) - lost.size
    said = (
        f"{counted(rows, 'row')} {are(rows)} missing at {counted(lost.size, 'interval')} of 2 or "
        f"more times the usual {check.interval:.4g} s, the longest {whole[longest]:.0f} times "
        f"after sample {longest}; the input steps from row to row, so that one row can hide a turn"
    )
    share = uneven.size / max(steps.size - lost.size, 1)
    return replace(
        check,
        gaps=np.union1d(check.gaps, lost),
        uneven=share,
        of_breaks=(*check.of_breaks, said),
        of_steps=check.of_steps if share > 0.01 else (),
    )


def bridged(t: npt.ArrayLike, u: npt.ArrayLike, gaps: npt.ArrayLike) -> Bridges:
    """Find out for each gap whether the input crosses it one way, or turns in it, and where.

    It crosses a gap if on each side, for as long as the gap, the input is monotone but for its
    noise, in the direction in which it crosses the gap and with about that speed, or at rest. An
    extreme is estimated by a cubic and by the crossing of the tangents; the one is taken that is
    better at recorded turns. Without those, the input counts as concave or convex: the extreme
    lies between the samples beside the gap and the crossing of the tangents. No gap is bridged
    where noise hides reversals that change more than 0.5 % of the Preisach plane.

    An input that steps from row to row crosses a gap one way if it moved by more than the changes
    beside the gap allow with a step back. If one row is missing between a rise and a fall, its
    input is where both of its changes are as those beside the gap.

    Parameters
    ----------
    t, u : (T,) array_like
        Times in seconds, never decreasing, and inputs.
    gaps : (G,) array_like of int
        Samples after which a gap follows.
    """
    times, inputs = np.asarray(t, np.float64), np.asarray(u, np.float64)
    places: IntArray = np.asarray(gaps, np.int64)
    known = np.zeros(places.size, dtype=np.bool_)
    when, extreme, doubt = np.full((3, places.size), np.nan)
    least, span = _SURE * _noise(inputs), float(np.ptp(inputs))
    rows = places[:0]
    if places.size and _in_steps(np.delete(inputs, places)):
        rows = places[np.diff(times)[places] <= (GAP + UNEVEN) * np.median(np.diff(times))]
    record = None
    for k, place in enumerate(places.tolist()):
        if place in rows:
            found = _stepped(times, inputs, places, place)
        elif least**2 > UNKNOWN * span**2:
            continue
        elif _one_way(times, inputs, place, least):
            found = np.nan, np.nan, np.nan
        else:
            record = record or _Recorded(times, inputs, places, least)
            found = record.turn(place)
        if found is not None:
            known[k] = True
            when[k], extreme[k], doubt[k] = found
    return Bridges(places, known, when, extreme, doubt)


def between(t: FloatArray, u: FloatArray, wanted: FloatArray, bridges: Bridges) -> FloatArray:
    """Return inputs at wanted times within bridged gaps, on monotone cubics; NaN elsewhere.

    Parameters
    ----------
    t, u : (T,) array
        Times in seconds, never decreasing, and inputs.
    wanted : (N,) array
        Times, increasing.
    bridges : Bridges
        What is known about the gaps.
    """
    values = np.full(wanted.size, np.nan)
    inside = np.zeros(wanted.size, dtype=np.bool_)
    gaps = bridges.after[bridges.known]
    firsts = np.searchsorted(wanted, t[gaps], side="right")
    lasts = np.searchsorted(wanted, t[gaps + 1], side="left")
    for first, last in zip(firsts, lasts, strict=True):
        inside[first:last] = True
    if inside.any():
        from scipy.interpolate import PchipInterpolator  # takes a fifth of a second to import

        times, inputs, _ = bridges.inserted(t, u)
        apart = np.concatenate([[True], np.diff(times) > 0])
        values[inside] = PchipInterpolator(times[apart], inputs[apart])(wanted[inside])
    return values


def _in_steps(u: FloatArray) -> bool:
    """Whether an input steps from row to row, by more than a gap may leave unknown."""
    if u.size < _FEWEST:
        return False
    span, changes = float(np.ptp(u)), np.abs(np.diff(u))
    usual = float(np.median(changes))
    alike = np.quantile(changes, 0.1) >= _CORNERS * usual or usual >= _LARGE * span
    if 2 * usual <= UNKNOWN * span or not alike:
        return False
    turns = turning_points(u, 1e-9 * span)
    turns = turns[(turns > 0) & (turns < u.size - 1)]
    beside = np.minimum(changes[turns - 1], changes[turns])
    return bool(turns.size and np.median(beside) >= _CORNERS * usual)


def _stepped(
    t: FloatArray, u: FloatArray, gaps: IntArray, last: int
) -> tuple[float, float, float] | None:
    """Return time, value and doubt of the extreme after a sample of an input that steps.

    All are NaN where it goes one way; None if it may have done anything.
    """
    near = np.setdiff1d(np.arange(last - _BESIDE, last + _BESIDE + 1), gaps)
    near = near[(near >= 0) & (near < u.size - 1)]
    before, after = near[near < last], near[near > last]
    if before.size < 2 or after.size < 2:
        return None
    changes = np.abs(np.diff(u)[near])
    least, most = float(changes.min()), float(changes.max())
    count = round(float((t[last + 1] - t[last]) / np.median(np.diff(t))))
    moved = float(u[last + 1] - u[last])
    slack = 1e-9 * most
    if abs(moved) > (count - 1) * most - least + slack:
        return np.nan, np.nan, np.nan
    way = np.sign(u[last] - u[last - 1])
    if count != 2 or least < _CORNERS * most or way != np.sign(u[last + 1] - u[last + 2]):
        return None
    ends = way * u[last], way * u[last + 1]
    low, high = max(ends) + least, min(ends) + most
    if low > high + slack:
        return None
    middle = float(t[last] + t[last + 1]) / 2
    doubt = float(high - low) / 2
    return middle, float(way * (low + high) / 2), doubt if doubt > slack else 0.0


def _noise(u: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences that a slow input lacks."""
    if u.size < 5:
        return float(np.inf)
    return noise_of(np.diff(u, 4), 4)


def _beside(t: FloatArray, begin: int, end: int, fewest: int) -> tuple[int, int] | None:
    """Return the first sample beside a gap and the one after the last; None beyond the record.

    They reach as far from the samples ``begin`` and ``end`` as these are apart, and are at least
    ``fewest`` on each side.
    """
    long = t[end] - t[begin]
    if t[0] > t[begin] - long or t[-1] < t[end] + long:
        return None
    first = min(int(np.searchsorted(t, t[begin] - long)), begin + 1 - fewest)
    stop = max(int(np.searchsorted(t, t[end] + long, side="right")), end + fewest)
    return (first, stop) if first >= 0 and stop <= t.size else None


def _one_way(t: FloatArray, u: FloatArray, last: int, least: float) -> bool:
    """Whether the input goes one way around the gap after a sample, and no faster in it."""
    found = _beside(t, last, last + 1, _FEWEST)
    if found is None:
        return False
    first, stop = found
    way = 1.0 if u[stop - 1] >= u[first] else -1.0
    around = way * u[first:stop]
    if float((np.maximum.accumulate(around) - around).max()) > least:
        return False
    moved = abs(float(u[last + 1] - u[last]))
    long = float(t[last + 1] - t[last])
    beside = (
        abs(float(u[last] - u[first])) / float(t[last] - t[first]) * long,
        abs(float(u[stop - 1] - u[last + 1])) / float(t[stop - 1] - t[last + 1]) * long,
    )
    return moved <= _FASTER * max(beside) + least and moved >= _SLOWER * min(beside) - least


class _Recorded:
    """A record with gaps, and the turns in it that show how its input turns."""

    def __init__(self, t: FloatArray, u: FloatArray, gaps: IntArray, least: float) -> None:
        self.t, self.u, self.gaps, self.least = t, u, gaps, least
        turns = turning_points(u, max(least, 1e-9 * float(np.ptp(u))))
        self.turns = turns
        self.ways = np.sign(u[turns] - u[np.concatenate([[0], turns[:-1]])]) if turns.size else []

    def turn(self, last: int) -> tuple[float, float, float] | None:
        """Return time, value and doubt of the extreme in the gap after a sample; None if unknown.

        All are NaN where the input turned beside the gap and not in it.
        """
        curve = self._curve(last, last + 1)
        if curve is None:
            return None
        anchor = curve.turn() or self._nearest(last)
        if anchor is None:
            return None
        where, way = anchor
        ends = float(max(way * self.u[last], way * self.u[last + 1]))
        errors = self._trials(last, where, way)
        if not np.isfinite(errors).all():
            return None
        if len(errors) >= _FEWEST_TRIALS:
            largest = np.abs(errors).max(axis=0)
            best = int(np.argmin(largest))
            share, value = curve.greatest(best, way)
            doubt = _MARGIN * float(largest[best]) * curve.size
        elif curve.misfit <= self.least + _MISFIT * curve.change and curve.turn() is not None:
            share, corner = curve.greatest(_CORNER, way)
            value, doubt = (corner + ends) / 2, (corner - ends) / 2
        else:
            return None
        if value + doubt <= ends + self.least:
            return np.nan, np.nan, np.nan
        long = float(self.t[last + 1] - self.t[last])
        inside = min(max(share, 0.01), 0.99)  # an extreme at its end is in the gap too
        return float(self.t[last]) + inside * long, way * max(value, ends), doubt

    def _nearest(self, last: int) -> tuple[float, float] | None:
        """Place of the nearest recorded turn, from 0 to 1 within the gap, and whether upward."""
        long = self.t[last + 1] - self.t[last]
        where = (self.t[self.turns] - self.t[last]) / long
        away = np.abs(where - 0.5)
        if not away.size or away.min() > 1.5:  # further from the gap than the gap is long
            return None
        near = int(np.argmin(away))
        return float(where[near]), float(self.ways[near])

    def _trials(self, last: int, where: float, way: float) -> FloatArray:
        """(N, 2) errors of cubic and tangents in gaps made at recorded turns, over the slopes.

        They are NaN where the input turned the other way too in a gap as long as this.
        """
        alike = self.turns[self.ways == way]
        nearest = alike[np.argsort(np.abs(alike - last), kind="stable")]
        long = self.t[last + 1] - self.t[last]
        errors: list[list[float]] = []
        for place in nearest[: 4 * _TRIALS].tolist():
            begin = int(np.searchsorted(self.t, self.t[place] - where * long, side="right")) - 1
            end = int(np.searchsorted(self.t, self.t[begin] + long))
            if begin < 0 or end >= self.t.size or end - begin < 2:
                continue
            curve = self._curve(begin, end)
            hides = (self.gaps >= begin) & (self.gaps < end)
            if curve is None or curve.size == 0 or hides.any():
                continue
            hidden = way * self.u[begin : end + 1]
            other = hidden.min() < min(hidden[0], hidden[-1]) - self.least - 1e-9 * curve.change
            missed = [curve.greatest(kind, way)[1] - hidden.max() for kind in (_CUBIC, _CORNER)]
            errors.append([np.nan if other else float(one) / curve.size for one in missed])
            if len(errors) == _TRIALS:
                break
        return np.array(errors).reshape(-1, 2)

    def _curve(self, begin: int, end: int) -> _Curve | None:
        """Values and slopes at both ends of what is missing; None where they are not known."""
        found = _beside(self.t, begin, end, _FITTED)
        if found is None:
            return None
        first, stop = found
        long = float(self.t[end] - self.t[begin])
        sides = [
            _parabola((self.t[rows] - self.t[edge]) / long, self.u[rows])
            for rows, edge in ((slice(first, begin + 1), begin), (slice(end, stop), end))
        ]
        (left, rise, off), (right, fall, away) = sides
        return _Curve(left, right, rise, fall, max(off, away), float(np.ptp(self.u[first:stop])))


@dataclass(frozen=True)
class _Curve:
    """Values and slopes at both ends of a gap of length 1, and how well parabolas fit there."""

    left: float
    right: float
    rise: float
    fall: float
    misfit: float
    change: float

    @property
    def size(self) -> float:
        """Magnitudes of both slopes, by which errors of different turns are compared."""
        return abs(self.rise) + abs(self.fall)

    def turn(self) -> tuple[float, float] | None:
        """Place of the turn from 0 to 1, and 1 for a maximum or -1; None without one."""
        if self.rise * self.fall >= 0:
            return None
        way = 1.0 if self.rise > 0 else -1.0
        return self.greatest(_CUBIC, way)[0], way

    def greatest(self, kind: int, way: float) -> tuple[float, float]:
        """Place and value of the greatest input in the gap, times ``way``."""
        left, right, rise, fall = (way * x for x in (self.left, self.right, self.rise, self.fall))
        found = max((left, 0.0), (right, 1.0))
        if kind == _CORNER:
            if rise > fall:
                place = (right - fall - left) / (rise - fall)
                if 0 < place < 1:
                    found = max(found, (left + rise * place, place))
            return found[1], found[0]
        step = right - left
        cubic = np.array([rise + fall - 2 * step, 3 * step - 2 * rise - fall, rise, left])
        for root in np.roots(np.trim_zeros(np.polyder(cubic), "f")):
            if np.isreal(root) and 0 < root.real < 1:
                found = max(found, (float(np.polyval(cubic, root.real)), float(root.real)))
        return found[1], found[0]


def _parabola(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Value and slope at 0 of the parabola through values, and its largest distance from them."""
    matrix = np.vander(x, 3, increasing=True)
    found = np.linalg.lstsq(matrix, y, rcond=None)[0]
    return float(found[0]), float(found[1]), float(np.abs(matrix @ found - y).max())


def _after_break(u: FloatArray, begin: int, end: int) -> FloatArray:
    """Area of the plane that is unknown in the rows from a break to the next."""
    above, below = np.maximum.accumulate(u[begin:end]), np.minimum.accumulate(u[begin:end])
    return np.asarray((u.max() - above) * (below - u.min()))


def _after_turn(u: FloatArray, first: int, extreme: float, doubt: float) -> FloatArray:
    """Area of the plane that is unknown from a sample after a turn until the input has passed it.

    These are relays whose upper threshold the extreme may have passed, and whose lower one is above
    the last minimum before; the other way round for a minimum.
    """
    way = 1.0 if extreme >= max(u[first - 1], u[first]) else -1.0
    before, after = way * u[:first], way * u[first:]
    ends = max(before[-1], after[0])
    low, high = max(way * extreme - doubt, ends), way * extreme + doubt
    beyond = np.flatnonzero(before >= high)
    last = float(before[beyond[-1] :].min() if beyond.size else min(before.min(), after.min()))
    passed = np.flatnonzero((after >= high) | (after <= last))
    after = after[: passed[0]] if passed.size else after
    reached = np.maximum(np.maximum.accumulate(after), low)
    return np.asarray((high - reached) * (np.minimum.accumulate(after) - last))
