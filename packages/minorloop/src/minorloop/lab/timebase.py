"""Check the times of a record, and use them: gaps, clock jumps, uneven samples, lag in seconds."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, as_finite
from minorloop.errors import ParameterError, RecordError, are, counted
from minorloop.lab.headers import split_ending, split_header

SECONDS = {
    "": 1.0,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "μs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    "d": 86400.0,
}
"""Units of time that a record may have, in seconds."""
_NAMES = (
    *("t", "time", "timestamp", "date", "datetime", "date/time", "date time", "clock"),
    *("zeit", "zeitstempel", "datum", "datum/uhrzeit", "uhrzeit"),
    *("temps", "horodatage", "tiempo", "fecha", "tempo"),
)
"""Names of a column of time, in small letters."""
_DATES = ("date", "datum", "fecha")
"""Names of a column of the day, if another column has the time."""
GAP = 5.0
"""A step of more sample intervals than this is a gap."""
UNEVEN = 0.1
"""Samples are uneven if steps differ by more than this share of the interval from it."""
_HOUR, _DAY = 3600.0, 86400.0
"""Step of a clock that changes to or from summer time, and of a time of day at midnight."""
_LONG = 2 * _DAY
"""Seconds from which a record in seconds may be in milliseconds: minutes then look like days."""
_MOST_SAMPLES = 50_000_000
"""Most samples of a resampled record: its times, inputs and outputs take 1.2 GB."""


@dataclass(frozen=True, eq=False)
class TimeCheck:
    """Times that never decrease, and findings about them."""

    t: FloatArray
    """Shape (T,). Times in seconds; if the clock was set, they continue with the usual interval."""
    interval: float
    """Usual time between samples, the median."""
    gaps: IntArray
    """Shape (G,). Samples after which a gap follows."""
    jumps: IntArray
    """Shape (J,). Samples after which the clock was set back, so that another part of a record may
    follow. If the clock was changed by an hour or set to the date, the record continues instead."""
    uneven: float
    """Share of the other steps that differ from the interval by more than a tenth of it."""
    of_breaks: tuple[str, ...] = ()
    of_steps: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    """``of_breaks``, ``of_steps`` and ``others``: findings about gaps and jumps, about uneven
    steps, and other findings, one sentence each."""

    @property
    def notes(self) -> tuple[str, ...]:
        """All findings."""
        return self.of_breaks + self.of_steps + self.others

    @property
    def breaks(self) -> IntArray:
        """Samples after which the input is unknown for a time."""
        return np.union1d(self.gaps, self.jumps)


def time_column(
    headers: Sequence[str], *, source: object = "the file", but: Sequence[str] = ()
) -> str | None:
    """Return the column of time, by its name or unit; None without one.

    Raises a `RecordError` if several columns could be time.

    ``headers``: headers of the columns; ``source``: their source, for the message; ``but``: columns
    with another use, by their headers or names.
    """
    split = {header: split_time(header) for header in headers}
    split = {h: parts for h, parts in split.items() if h not in but and parts[0] not in but}
    named = [header for header, (name, _) in split.items() if name.casefold() in _NAMES]
    timed = [header for header, (_, unit) in split.items() if unit and unit in SECONDS]
    both = [header for header in named if header in timed]
    of_day = [header for header in named if split[header][0].casefold() not in _DATES]
    found = both or of_day or named or timed
    if len(found) > 1:
        shown = " and ".join(f"'{header}'" for header in found[:4])
        raise RecordError(
            f"{source} has {len(found)} columns that could be time, {shown}; name one with time= "
            "(--time)"
        )
    return found[0] if found else None


def split_time(header: str) -> tuple[str, str]:
    """Return name and unit of a column of time; ``t_ms`` is in ms, ``[hh:mm:ss]`` is not a unit."""
    name, unit = split_header(header)
    if re.fullmatch(r"[dmyhsfjt:.,/ -]{4,}", unit.casefold()):
        return name, ""
    stem, last = split_ending(name, SECONDS)  # min, h and d are units after the name of a time
    return (stem, last) if not unit and stem.casefold() in _NAMES else (name, unit)


def check_times(t: npt.ArrayLike, *, name: str = "time", unit: str = "s") -> TimeCheck:
    """Find gaps, clock jumps and uneven sampling; return times that never decrease.

    Raises a `RecordError` if the times are not finite, or the clock stops or is set back at more
    than one step in ten.

    ``t`` (T,): times in seconds; ``name`` and ``unit``: name and unit of the column, for messages.
    """
    times = np.array(t, dtype=np.float64)
    if times.ndim != 1 or times.size < 2:
        raise RecordError(f"{name} has {counted(times.size, 'sample')}; give at least two")
    if not np.isfinite(times).all():
        row = int(np.argmin(np.isfinite(times)))
        raise RecordError(f"{name} is {times[row]} at sample {row}; every time must be finite")
    steps = np.diff(times)
    forward = steps[steps > 0]
    interval = float(np.median(forward)) if forward.size else 0.0
    was_set = _was_set(steps, interval)
    back = np.flatnonzero((steps < 0) & ~was_set)
    if not forward.size or np.mean(steps <= 0) > 0.5 or back.size > 0.1 * steps.size:
        raise RecordError(
            f"{name} stands still or runs backwards at {np.count_nonzero(steps <= 0)} of "
            f"{steps.size} steps; {_why_no_clock(steps)}give another column, or leave it out"
        )
    notes = [_clock_set(steps, was_set, interval)] if was_set.any() else []
    if back.size:
        first = int(back[0])
        notes.append(
            f"the clock was set back {counted(back.size, 'time')}, first by {-steps[first]:.4g} s "
            f"after sample {first}; time continues there with the usual interval of "
            f"{interval:.4g} s"
        )
    if back.size or was_set.any():
        steps[back] = steps[was_set] = interval
        times = np.concatenate([times[:1], times[0] + np.cumsum(steps)])
    gaps = np.flatnonzero(steps > GAP * interval)
    if gaps.size > max(0.02 * steps.size, 1):
        gaps = gaps[:0]  # sampled by events, not evenly
    if gaps.size:
        largest = int(gaps[np.argmax(steps[gaps])])
        lost = round(float(np.sum(np.round(steps[gaps] / interval) - 1)))
        notes.append(
            f"{counted(gaps.size, 'gap')} in {name}: about {counted(lost, 'sample')} {are(lost)} "
            f"missing, the longest gap is {steps[largest]:.4g} s after sample {largest}"
        )
    usual = np.delete(steps, np.concatenate([gaps, back]))
    uneven = float(np.mean(np.abs(usual - interval) > UNEVEN * interval)) if usual.size else 0.0
    repeated, of_steps = int(np.count_nonzero(steps == 0)), tuple[str, ...]()
    if repeated > 0.01 * steps.size:
        of_steps = (
            f"{name} repeats itself at {repeated} of {steps.size} steps, as times do that are "
            f"rounded to {float(forward.min()):.4g} s: write more digits, or number the samples",
        )
    elif uneven > 0.01:
        of_steps = (
            f"samples are uneven: {uneven:.0%} of the steps differ from the usual interval of "
            f"{interval:.4g} s by more than {UNEVEN:.0%}",
        )
    others = _implausible(interval, float(times[-1] - times[0]), name, unit)
    return TimeCheck(times, interval, gaps, back, uneven, tuple(notes), of_steps, tuple(others))


def _clock_set(steps: FloatArray, was_set: BoolArray, interval: float) -> str:
    """Say how often and by how much a clock was set to another time of day or date."""
    first, count = int(np.argmax(was_set)), int(np.count_nonzero(was_set))
    size, how = abs(steps[first]), "to or from the date"
    if size <= _DAY:
        how = "a time of day at midnight" if size > 2 * _HOUR else "to or from summer time"
    return (
        f"the clock was set {counted(count, 'time')}, first by {steps[first] - interval:.10g} s "
        f"after sample {first}, as {how}; time and memory continue there with the usual interval "
        f"of {interval:.4g} s"
    )


def _was_set(steps: FloatArray, interval: float) -> BoolArray:
    """Return whether each step is a change of the clock by an hour, to the date or at midnight."""
    off = np.abs(steps - interval)
    hour = (np.abs(off - _HOUR) <= interval) & (off > GAP * interval)
    midnight = (steps < 0) & (np.abs(off - _DAY) <= interval)
    # A step of three years is that of a clock that counted from its start and was set to the date,
    # or back
    found = hour | midnight | (off > max(1e8, GAP * interval))
    return found if np.count_nonzero(found) <= max(0.01 * steps.size, 1) else np.zeros_like(found)


def _why_no_clock(steps: FloatArray) -> str:
    """Return the reason why a column is not a time, or a remedy."""
    forward = steps[steps > 0]
    if forward.size and (steps >= 0).all():
        return (
            f"times that repeat are rounded, here to {float(forward.min()):.4g} s: write more "
            "digits, "
        )
    return "it cannot be the time of this record, or has too few digits: "


def _implausible(interval: float, seconds: float, name: str, unit: str) -> list[str]:
    if 1e-7 <= interval <= 86400:
        if seconds < _LONG or unit not in ("", "s"):
            return []
        return [
            f"{name} is in {unit or 'seconds, because it has no unit'}, so the record "
            f"lasts {seconds / 86400:.3g} days with a sample every {interval:.3g} s: if it is in "
            "ms, correct the unit in the header"
        ]
    return [
        f"the usual interval is {interval:.3g} s with {name} in {unit or 's'}, which no log has; "
        "correct the unit in the header"
    ]


def parse_lag(text: str) -> float | None:
    """Return a lag with a unit of time, such as ``3 ms``, in seconds; None without a unit.

    Raises a `ParameterError` if the unit is not one of time, or the lag is negative.
    """
    match = re.fullmatch(r"\s*([-+\d.eE]+?)\s*([a-zA-Zµμ]+)\s*", text)
    if not match:
        return None
    try:
        value = float(match[1])
    except ValueError:
        return None
    if match[2] not in SECONDS:
        units = ", ".join(unit for unit in SECONDS if unit.isascii() and unit)
        raise ParameterError(f"lag is {text!r}; give it in one of {units}, or in rows")
    lag = value * SECONDS[match[2]]
    if not 0 <= lag < np.inf:
        raise ParameterError(f"lag is {text!r}; give a lag >= 0")
    return lag


def delayed(t: npt.ArrayLike, y: npt.ArrayLike, lag: float, *, gap: float = np.inf) -> FloatArray:
    """Return the output (T,) ``lag`` seconds after each sample, by linear interpolation.

    It is NaN if not known.

    ``t`` and ``y`` (T,): times in seconds, never decreasing, and outputs; NaN if not measured;
    ``lag``: in seconds, >= 0; ``gap``: between samples further apart than this, the output is not
    known.
    """
    times, values = np.asarray(t, np.float64), np.asarray(y, np.float64)
    if as_finite("lag", lag) < 0:
        raise ParameterError(f"lag is {lag}; give a lag >= 0, in seconds")
    return values.copy() if lag == 0 else _at(times, values, times + lag, gap)


def resample(
    t: npt.ArrayLike, u: npt.ArrayLike, y: npt.ArrayLike, interval: float, *, gap: float = np.inf
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, inputs and outputs with an even interval, by linear interpolation.

    ``t``, ``u`` and ``y`` (T,): times in seconds, never decreasing; inputs; outputs, NaN if not
    measured; ``interval``: new interval in seconds; ``gap``: between samples further apart than
    this, outputs are NaN.
    """
    times, inputs = np.asarray(t, np.float64), np.asarray(u, np.float64)
    if not as_finite("interval", interval) > 0:
        raise ParameterError(f"interval is {interval}; give a time > 0, in seconds")
    count = float(times[-1] - times[0]) / interval
    if count > _MOST_SAMPLES:
        raise ParameterError(
            f"an interval of {interval:g} s gives {count:.3g} samples; give one of at least "
            f"{float(times[-1] - times[0]) / _MOST_SAMPLES:g} s"
        )
    even = times[0] + interval * np.arange(int(count + 1e-6) + 1)
    return even, np.interp(even, times, inputs), _at(times, np.asarray(y, np.float64), even, gap)


def _at(t: FloatArray, y: FloatArray, moments: FloatArray, gap: float) -> FloatArray:
    """Interpolate at ``moments``; NaN outside, next to a missing sample and within gaps."""
    after = np.clip(np.searchsorted(t, moments, side="left"), 1, t.size - 1)
    before = after - 1
    step = t[after] - t[before]
    share = np.divide(moments - t[before], step, out=np.zeros_like(moments), where=step > 0)
    found = y[before] + share * (y[after] - y[before])
    found = np.where(share >= 1, y[after], np.where(share <= 0, y[before], found))
    outside = (moments < t[0]) | (moments > t[-1] + 1e-9 * (t[-1] - t[0]))
    inside_gap = (step > gap) & (share > 0) & (share < 1)
    return np.where(outside | inside_gap, np.nan, found)
