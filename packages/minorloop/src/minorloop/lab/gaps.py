"""Bridge the gaps of a record: find gaps over which the memory of its input continues.

The memory is known if an input crosses a gap in one direction. If an input moves by equal steps
from row to row and one row is lost, the steps show where it turned.
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
"""Least samples on each side of a gap that show the motion of the input."""
_FASTER, _SLOWER = 2.5, 0.5
"""Largest speed across a gap over the greater speed beside it, and least over the lesser. A half
period of a sine without its middle third has twice the speed there, a ramp the same speed. An input
that jumps in the gap is faster than the first, an input that turns twice slower than the second."""
_CORNERS = 0.5
"""Least share of the usual change from row to row that a stepping input has beside most of its
turns; and least change if all changes are alike. A sine with more than nine samples in a period
changes less at its turns."""
_LARGE = 0.1
"""Share of the range from which different changes count as steps; noise is less."""
_BESIDE = 5
"""Number of changes on each side of a lost row that show the size of the steps there."""


@dataclass(frozen=True, eq=False)
class Bridges:
    """Knowledge about the input in each gap."""

    after: IntArray
    """Shape (G,). Samples after which a gap follows."""
    known: BoolArray
    """Shape (G,). Whether the input crosses the gap in one direction, or its extreme is known."""
    t: FloatArray
    u: FloatArray
    """``t`` and ``u``: shape (G,). Time and value of the extreme in the gap; NaN if the input did
    not turn."""

    @property
    def unknown(self) -> IntArray:
        """Samples before a gap over which the memory does not continue."""
        return self.after[~self.known]

    @property
    def turned(self) -> BoolArray:
        """Whether the input turned at a known extreme in each gap."""
        return np.isfinite(self.u)

    def inserted(self, t: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return times and inputs with the extremes in gaps, and the samples after the extremes."""
        places = self.after[self.turned] + 1
        times = np.insert(t, places, self.t[self.turned])
        return times, np.insert(u, places, self.u[self.turned]), places


def known_memory(u: npt.ArrayLike, breaks: npt.ArrayLike) -> BoolArray:
    """Return (T,) whether the memory of a Preisach plane is known, for an input with breaks.

    After a break, a relay counts as known if the input has switched it since: its alpha is at most
    the greatest input or its beta at least the least input. The memory is known while the other
    relays cover less than 0.5 % of the plane over the range of the whole input.

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
    """Return the times with gaps at lost rows, for a table with one row for each hold.

    In a record of a moving input (T,) a short gap does not hide a turn. If the input steps from row
    to row, one lost row can hide a turn. A row is lost if an interval is a multiple of the usual
    interval. The input steps if it changes beside its turns as much as elsewhere, and by enough to
    matter to the memory. Otherwise the times are returned unchanged.
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
    """Find out for each gap whether the input crosses it in one direction, or where it turns.

    The input crosses a gap in one direction if on each side, for as long as the gap, it is monotone
    except for noise, in the same direction and at about the same speed as across the gap, or at
    rest. No gap is crossed if noise hides reversals that change more than 0.5 % of the plane.

    An input that steps from row to row crosses a gap in one direction if it moved by more than the
    changes beside the gap allow with a step back. If one row is missing between a rise and a fall,
    its input is the one whose two changes equal those beside the gap.

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

    Both are NaN if the input goes in one direction; None if its path is unknown.
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
    # The relays between both ends are unknown.
    if not -slack <= high - low <= _UNKNOWN / 2 * float(np.ptp(u)):
        return None
    return float(t[last] + t[last + 1]) / 2, float(way * (low + high) / 2)


def _noise(u: FloatArray) -> float:
    """Return the standard deviation of the noise, from differences that a slow input lacks."""
    if u.size < 5:
        return float(np.inf)
    return noise_of(np.diff(u, 4), 4)


def _one_way(t: FloatArray, u: FloatArray, last: int, least: float) -> bool:
    """Whether the input goes in one direction around the gap after a sample, and no faster in it.

    Each side is as long as the gap, and has at least ``_FEWEST`` samples.
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
