"""Bridge the gaps of a record: find those over which the memory of its input continues.

An input that goes one way across a gap leaves nothing open. One that steps by equal steps from row
to row shows where it turned if one row is lost.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.errors import are, counted
from minorloop.lab.holds import turning_points
from minorloop.lab.noise import noise_of
from minorloop.lab.timebase import GAP, UNEVEN, TimeCheck

_UNKNOWN = 0.005
"""Share of the Preisach plane whose state may be unknown after a gap."""

_FEWEST = 3
"""Least samples on each side of a gap that show how the input moves."""
_FASTER, _SLOWER = 2.5, 0.5
"""Most and least speed across a gap, over the greater and the lesser of the speeds beside it. A
sine over half a period whose middle third is missing has twice the speed there; a ramp has the
same; an input that jumps in the gap is beyond the first, one that turns twice is below the second.
"""
_CORNERS = 0.5
"""Share of the usual change from row to row by which an input that steps also changes beside most
of its turns, and least change where all are alike; a sine with more than nine samples in a period
changes less at its turns."""
_LARGE = 0.1
"""Share of the range from which changes are steps although they differ; noise is less."""
_BESIDE = 5
"""Changes on each side of a lost row that show by how much the input steps there."""


@dataclass(frozen=True, eq=False)
class Bridges:
    """What is known about the input in each gap."""

    after: IntArray
    """Shape (G,). Samples after which a gap follows."""
    known: BoolArray
    """Shape (G,). Whether the input goes one way across the gap, or its extreme there is known."""
    t: FloatArray
    u: FloatArray
    """``t`` and ``u``: shape (G,). Time and value of the extreme in the gap, where the input
    turned; NaN elsewhere."""

    @property
    def unknown(self) -> IntArray:
        """Samples after which a gap follows that the memory does not cross."""
        return self.after[~self.known]

    @property
    def turned(self) -> BoolArray:
        """In which gaps the input turned at a known extreme."""
        return np.isfinite(self.u)

    def inserted(self, t: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return times and inputs with the extremes in gaps, and before which samples they are."""
        places = self.after[self.turned] + 1
        times = np.insert(t, places, self.t[self.turned])
        return times, np.insert(u, places, self.u[self.turned]), places


def known_memory(u: npt.ArrayLike, breaks: npt.ArrayLike) -> BoolArray:
    """Return where the memory of a Preisach plane is known although the input has breaks.

    After a break only relays count as known that the input has switched since: those with alpha
    up to its greatest value or beta down to its least. The memory is known while the others cover
    less than 0.5 % of the plane over the range of the whole input.

    ``u`` (T,): inputs; ``breaks`` (B,) of int: samples after which the input is unknown for a
    while.
    """
    inputs, places = np.asarray(u, np.float64), np.asarray(breaks, np.int64)
    unknown = np.zeros(inputs.size)
    for begin, end in pairwise([*places + 1, inputs.size]):
        above = np.maximum.accumulate(inputs[begin:end])
        below = np.minimum.accumulate(inputs[begin:end])
        unknown[begin:end] = (inputs.max() - above) * (below - inputs.min())
    return np.asarray(2 * unknown <= _UNKNOWN * np.ptp(inputs) ** 2)


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
    # Largest share of intervals with lost rows; with more, the hold times of a plan may differ
    if not 0 < lost.size <= 0.2 * steps.size or uneven.size > lost.size:
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
    """Find out for each gap whether the input crosses it one way, or where it turns in it.

    It crosses a gap if on each side, for as long as the gap, the input is monotone but for its
    noise, in the direction in which it crosses the gap and with about that speed, or at rest. No
    gap is crossed where noise hides reversals that change more than 0.5 % of the Preisach plane.

    An input that steps from row to row crosses a gap one way if it moved by more than the changes
    beside the gap allow with a step back. If one row is missing between a rise and a fall, its
    input is where both of its changes are as those beside the gap.

    ``t`` and ``u`` (T,): times in seconds, never decreasing, and inputs; ``gaps`` (G,) of int:
    samples after which a gap follows.
    """
    times, inputs = np.asarray(t, np.float64), np.asarray(u, np.float64)
    places: IntArray = np.asarray(gaps, np.int64)
    known = np.zeros(places.size, dtype=np.bool_)
    when, extreme = np.full((2, places.size), np.nan)
    # Standard deviations of noise from which a reversal is one of the input
    least, span = 6.0 * _noise(inputs), float(np.ptp(inputs))
    rows = places[:0]
    if places.size and _in_steps(np.delete(inputs, places)):
        rows = places[np.diff(times)[places] <= (GAP + UNEVEN) * np.median(np.diff(times))]
    for k, place in enumerate(places.tolist()):
        if place in rows:
            found = _stepped(times, inputs, places, place)
            known[k] = found is not None
            when[k], extreme[k] = found or (np.nan, np.nan)
        elif least**2 <= _UNKNOWN * span**2:
            known[k] = _one_way(times, inputs, place, least)
    return Bridges(places, known, when, extreme)


def _in_steps(u: FloatArray) -> bool:
    """Whether an input steps from row to row, by more than a gap may leave unknown."""
    if u.size < _FEWEST:
        return False
    span, changes = float(np.ptp(u)), np.abs(np.diff(u))
    usual = float(np.median(changes))
    alike = np.quantile(changes, 0.1) >= _CORNERS * usual or usual >= _LARGE * span
    if 2 * usual <= _UNKNOWN * span or not alike:
        return False
    turns = turning_points(u, 1e-9 * span)
    turns = turns[(turns > 0) & (turns < u.size - 1)]
    beside = np.minimum(changes[turns - 1], changes[turns])
    return bool(turns.size and np.median(beside) >= _CORNERS * usual)


def _stepped(t: FloatArray, u: FloatArray, gaps: IntArray, last: int) -> tuple[float, float] | None:
    """Return time and value of the extreme after a sample of an input that steps.

    Both are NaN where it goes one way; None if it may have done anything.
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
        return np.nan, np.nan
    way = np.sign(u[last] - u[last - 1])
    if count != 2 or way != np.sign(u[last + 1] - u[last + 2]):
        return None
    low, high = max(way * u[last : last + 2]) + least, min(way * u[last : last + 2]) + most
    # The relays between both ends may be switched or not.
    if not -slack <= high - low <= _UNKNOWN / 2 * float(np.ptp(u)):
        return None
    return float(t[last] + t[last + 1]) / 2, float(way * (low + high) / 2)


def _noise(u: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences that a slow input lacks."""
    if u.size < 5:
        return float(np.inf)
    return noise_of(np.diff(u, 4), 4)


def _one_way(t: FloatArray, u: FloatArray, last: int, least: float) -> bool:
    """Whether the input goes one way around the gap after a sample, and no faster in it.

    It is looked at on both sides for as long as the gap, and at ``_FEWEST`` samples or more.
    """
    long = float(t[last + 1] - t[last])
    first = min(int(np.searchsorted(t, t[last] - long)), last + 1 - _FEWEST)
    stop = max(int(np.searchsorted(t, t[last + 1] + long, side="right")), last + 1 + _FEWEST)
    inside = t[0] <= t[last] - long and t[last + 1] + long <= t[-1]
    if not inside or first < 0 or stop > t.size:
        return False
    way = 1.0 if u[stop - 1] >= u[first] else -1.0
    around = way * u[first:stop]
    if float((np.maximum.accumulate(around) - around).max()) > least:
        return False
    moved = abs(float(u[last + 1] - u[last]))
    beside = (
        abs(float(u[last] - u[first])) / float(t[last] - t[first]) * long,
        abs(float(u[stop - 1] - u[last + 1])) / float(t[stop - 1] - t[last + 1]) * long,
    )
    return moved <= _FASTER * max(beside) + least and moved >= _SLOWER * min(beside) - least
