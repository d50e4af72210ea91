"""Reduce a raw log to settled points: one row for each hold, with its uncertainty.

The holds are found in the input. Each is judged and extrapolated as during a run, by
`minorloop.lab.settling`. If the input passes an extreme between two holds, a row without an output
is inserted, so that the extreme drives the memory of a model.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from minorloop.arrays import (
    BoolArray,
    FloatArray,
    as_finite,
    check_kind,
    check_magnitude,
    check_option,
)
from minorloop.errors import ParameterError, RecordError, are, counted
from minorloop.figures import Drawn
from minorloop.files import PathLike, check_writable, table_text, write_atomically
from minorloop.lab.conversion import Conversion
from minorloop.lab.faults import Fault, codes, input_without_spikes, listed, usable, without_spikes
from minorloop.lab.gaps import known_memory
from minorloop.lab.holds import FoundHold, find_holds, turning_points
from minorloop.lab.records import Quantity, Record
from minorloop.lab.settling import ENOUGH, FEWEST_STILL, SPAN_SHARE, judge, trend
from minorloop.lab.timebase import GAP

_Flip: TypeAlias = Literal["output", "input", "both"]
"""Quantity whose sign is changed."""

_WINDOW = 10
"""A slope is taken over the last of this number of parts of a hold."""
_FEWEST, _LEAST_HELD = 3, 0.1
"""Least holds of a log, and least share of its samples in them."""
_WHOLE = 0.01
"""Largest deviation of readings from whole steps, in steps."""


@dataclass(frozen=True)
class ReducedPoint:
    """One hold of a log, or an extreme of the input between two holds."""

    t: float
    """End of the hold, in seconds or samples."""
    input: float
    """Mean of the input, in its unit."""
    begin: int
    stop: int
    """``begin`` and ``stop``: first sample of the hold, and the sample after the last."""
    value: float = np.nan
    sd: float = np.nan
    """``value`` and ``sd``: settled output and its standard deviation, in the unit of the output;
    NaN at an extreme. The standard deviation of a hold that has not settled is NaN, because its
    distance from the settled output is unknown."""
    verdict: str = "passed"
    """``settled``, ``extrapolated`` or ``unsettled``, as in `minorloop.lab.settling.Settling`;
    ``unread`` if no reading of the end of a hold can be used; ``passed`` at an extreme of the input
    between holds."""
    held: float = 0.0
    """Duration of the hold, in seconds or samples; 0 at an extreme."""
    end: float = np.nan
    """Output at the end of the hold, not extrapolated."""
    common_sd: float = np.nan
    """Standard deviation of the conversion: an error common to all points."""
    known: bool = True
    """Whether the memory is known: after a break it is unknown until the input has set it."""


@dataclass(frozen=True, eq=False)
class Reduction(Drawn):
    """Settled points of a raw log."""

    points: tuple[ReducedPoint, ...]
    """Holds and passed extremes, in order."""
    faults: tuple[Fault, ...]
    """Faults of the log; faulty readings are not used."""
    advice: tuple[str, ...]
    """Further findings and remedies, one sentence each."""
    log: Record
    """The log with the output converted; NaN where a reading cannot be used."""

    def __len__(self) -> int:
        return len(self.points)

    def __str__(self) -> str:
        counts = {name: self.count(name) for name in ("settled", "extrapolated", "unsettled")}
        if unread := self.count("unread"):
            counts["unread"] = unread
        verdicts = ", ".join(f"{count} {name}" for name, count in counts.items())
        return f"{sum(counts.values())} holds in {len(self.log)} samples: {verdicts}"

    def summary(self) -> list[tuple[str, str]]:
        """Return rows of a short table: holds, verdicts and uncertainties."""
        holds = [point for point in self.points if point.verdict != "passed"]
        unit = self.log.output.unit
        sds = [p.sd for p in holds if np.isfinite(p.sd)]
        common = [p.common_sd for p in holds if p.common_sd > 0]
        clock = "s" if self.log.timed else "samples"
        rows = [(name, f"{self.count(name)}") for name in ("settled", "extrapolated", "unsettled")]
        if unread := self.count("unread"):
            rows.append(("unread", f"{unread}"))
        rows.append((f"held [{clock}]", f"{np.median([p.held for p in holds]):.4g} (median)"))
        if sds:
            rows.append((str(Quantity("sd", unit)), f"{np.median(sds):.3g} (median)"))
        if common:
            name = str(Quantity("sd common to all points", unit))
            rows.append((name, f"{np.median(common):.3g} (median)"))
        return rows

    @property
    def remedy(self) -> str:
        """Remedy for holds that have not settled."""
        return _remedy(self.log, [p for p in self.points if p.verdict == "unsettled"])

    @property
    def notes(self) -> tuple[str, ...]:
        """Faults and advice, one sentence each."""
        return (*map(str, self.faults), *self.advice)

    def count(self, verdict: str) -> int:
        """Return the number of points with a verdict."""
        return sum(point.verdict == verdict for point in self.points)

    def record(self, *, unsettled: bool = False) -> Record:
        """Return the points as a record that can be identified.

        ``unsettled``: whether to give the outputs of holds that have not settled. Otherwise they
        are NaN: such a hold drives the memory and is not fitted.
        """
        t, u = (np.array([getattr(p, name) for p in self.points]) for name in ("t", "input"))
        y = np.array([self._output(point, unsettled) for point in self.points])
        return Record(u, y, t, self.log.inputs, self.log.outputs, self.log.time)

    def columns(self, *, unsettled: bool = False) -> dict[str, list[Any]]:
        """Return the columns of a table of the points by header; unsettled is as of `record`."""
        y, time = self.log.output, self.log.time
        outputs = [self._output(point, unsettled) for point in self.points]
        columns: dict[str, list[Any]] = {
            str(time): [p.t for p in self.points],
            str(self.log.input): [p.input for p in self.points],
            str(y): [_cell(value) for value in outputs],
            str(Quantity("sd", y.unit)): [_cell(p.sd) for p in self.points],
            "settled": [int(p.verdict == "settled") for p in self.points],
            "verdict": [p.verdict for p in self.points],
            str(Quantity("held", time.unit)): [p.held for p in self.points],
            str(Quantity("end of hold", y.unit)): [_cell(p.end) for p in self.points],
        }
        if any(p.common_sd > 0 for p in self.points):
            name = str(Quantity("common sd", y.unit))
            columns[name] = [_cell(p.common_sd) for p in self.points]
        return columns

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers of samples and of points of each verdict, and the points."""
        verdicts = ("settled", "extrapolated", "unsettled", "unread", "passed")
        counts = {verdict: self.count(verdict) for verdict in verdicts}
        holds = {"samples": len(self.log), "holds": len(self) - counts["passed"]}
        return {**holds, **counts, "points": self.columns(unsettled=True)}

    def to_csv(self, path: PathLike, *, unsettled: bool = False, force: bool = False) -> None:
        """Write the table of ``columns``."""
        check_writable(path, force=force)
        columns = self.columns(unsettled=unsettled)
        write_atomically(path, table_text(columns, zip(*columns.values(), strict=True)))

    @staticmethod
    def _output(point: ReducedPoint, unsettled: bool) -> float:
        usable = point.known and (unsettled or point.verdict != "unsettled")
        return point.value if usable else np.nan


def reduce(
    record: Record,
    *,
    conversion: Conversion | None = None,
    flip: _Flip | None = None,
    limits: tuple[float, float] | None = None,
    tolerance: float | None = None,
    input_tolerance: float | None = None,
    shortest: float = 0.0,
) -> Reduction:
    """Reduce a raw log to settled points with their uncertainty.

    Raises a `RecordError` if there are fewer than three holds, or holds are less than a tenth of
    the log, or no hold has a usable output; a `SignalError` if a number is beyond 1e150; a
    `ParameterError` if the record is not a `Record`, or an option is out of range.

    Parameters
    ----------
    record : Record
        One input and one output as sampled; without time, samples are counted. The input is unknown
        during its breaks in time.
    conversion : Conversion, optional
        Conversion of the readings of the sensor to the output; see `minorloop.lab.conversion`.
    flip : {"output", "input", "both"}, optional
        Quantity whose sign to change; the output after its conversion.
    limits : (float, float), optional
        Range of the sensor, in the unit of its readings; readings at or beyond it are not used.
    tolerance : float, optional
        Slope of a settled output, in the unit of the output per second. By default, the slope that
        moves it by 0.2 % of its span in another hold.
    input_tolerance : float, optional
        Changes of the input up to this size are noise; estimated by default.
    shortest : float
        Shortest hold, in seconds (samples if the record has no time). Shorter holds do not count.

    Examples
    --------
    >>> u = np.repeat([0.0, 1.0, 0.5, 0.2], 50)
    >>> y = 2 * u + 1e-4 * np.random.default_rng(0).normal(size=200)
    >>> [point.input for point in ml.reduce(ml.Record(u, y)).points]
    [0.0, 1.0, 0.5, 0.2]
    """
    check_kind("record", record, Record)
    if flip is not None:
        check_option("flip", flip, get_args(_Flip))
    _check(record, tolerance, shortest)
    u = -record.u if flip in ("input", "both") else record.u
    for fault in codes(u, "input"):
        raise RecordError(f"{record.input}: {fault}")
    u, of_input = input_without_spikes(u, str(record.input))
    holds = _held(record, u, input_tolerance, shortest)
    readings, of_output = usable(record.y, limits)
    check_magnitude("output", readings)
    readings, spiked = without_spikes(readings, holds)
    measured = record.replace(u=u, y=readings)
    log, common, lost = _converted(measured, conversion, flip in ("output", "both"))
    faults = [*of_input, *of_output, *spiked, *lost]
    step, notes = _resolution(readings), []
    if step:
        notes.append(
            f"readings of {record.output} are whole steps of {step:.3g}, the resolution of the "
            "sensor; sd contains it: averaging does not reduce it if the noise is less"
        )
    values = np.unique(log.y[np.isfinite(log.y)]) if step else np.zeros(0)
    known, bridged = _known(record, u, holds)
    points = [
        replace(point, known=bool(known[point.stop - 1]))
        for point in _points(log, holds, common, tolerance, values)
    ]
    if not any(np.isfinite(point.value) for point in points):
        raise RecordError(
            f"none of the {len(holds)} holds has a usable output: "
            + ("; ".join(map(str, faults)) or "the output was not measured there")
        )
    advice = (*notes, *bridged, *_advice(log, points))
    return Reduction(tuple(points), tuple(faults), advice, log)


def _check(record: Record, tolerance: float | None, shortest: float) -> None:
    """Refuse a record of several channels or without a clock, and options out of range."""
    if record.u.ndim != 1 or record.y.ndim != 1:
        raise RecordError(
            f"the log has {counted(len(record.inputs), 'input')} and "
            f"{counted(len(record.outputs), 'output')}; give one of each"
        )
    if len(record) > 1 and not (np.diff(record.t) > 0).any():
        raise RecordError(f"all times are {record.t[0]:g}; give the times of the samples, or none")
    if as_finite("shortest", shortest) < 0:
        raise ParameterError(f"shortest is {shortest}; give a duration >= 0")
    if tolerance is not None and not as_finite("tolerance", tolerance) > 0:
        raise ParameterError(f"tolerance is {tolerance}; give a slope > 0")


def _held(
    record: Record, u: FloatArray, input_tolerance: float | None, shortest: float
) -> list[FoundHold]:
    """Return the holds of an input (T,); raise an error if there are too few."""
    if np.ptp(u) == 0:
        raise RecordError(
            f"{record.input} is {u[0]:g} throughout; a log needs at least {_FEWEST} holds at "
            "different inputs"
        )
    holds = [
        hold
        for hold in find_holds(u, tolerance=input_tolerance)
        if record.t[hold.end - 1] - record.t[hold.begin] >= shortest
    ]
    share = sum(hold.end - hold.begin for hold in holds) / len(record)
    if len(holds) >= _FEWEST and share >= _LEAST_HELD:
        return holds
    if few := _too_few(u):
        raise RecordError(few)
    least = f" of {shortest:g} s or more" if shortest else ""
    raise RecordError(
        f"{counted(len(holds), 'hold')}{least} found in {len(record)} samples of {record.input}, "
        f"with {share:.0%} of the samples; at least {_FEWEST} holds with {_LEAST_HELD:.0%} are "
        "needed: if the input never rests, identify the record as it is; if it is "
        "noisier than its steps, give the size of the noise (input_tolerance)"
    )


def _converted(
    record: Record, conversion: Conversion | None, flip: bool
) -> tuple[Record, FloatArray, tuple[Fault, ...]]:
    """Return the record with converted readings, NaN where the conversion does not cover them.

    Also return the standard deviation of the conversion for each reading, and faults.
    """
    sign, readings = (-1.0 if flip else 1.0), record.y
    if conversion is None:
        return record.replace(y=sign * readings), np.zeros(readings.size), ()
    y = conversion.convert(readings)
    log = record.replace(y=sign * y, outputs=conversion.quantity(record.output))
    lost = np.flatnonzero(np.isfinite(readings) & ~np.isfinite(y))
    if not lost.size:
        return log, conversion.sd(readings), ()
    text = f"{counted(lost.size, 'reading')} cannot be converted: {listed(lost, readings)}"
    remedy = (
        f"the conversion covers {conversion.covered}: check the geometry or the "
        "calibration and its unit (--convert)"
    )
    return log, conversion.sd(readings), (Fault.at(lost, readings, "range", text, remedy),)


def _known(record: Record, u: FloatArray, holds: list[FoundHold]) -> tuple[BoolArray, list[str]]:
    """Return (T,) whether the memory is known, and a note on gaps over which it continues.

    It is unknown after the clock was set back, and after a long gap, which may hide a hold. In a
    gap of less than half a usual hold the input moves to the next hold, or rests.
    """
    t, check = record.t, record.check
    if check is None or not check.breaks.size:
        return np.ones(u.size, dtype=np.bool_), []
    usual = np.median([t[hold.end - 1] - t[hold.begin] for hold in holds])
    gap = t[check.breaks + 1] - t[check.breaks]
    # A gap of less than half a usual hold cannot hide a hold
    hiding = (gap <= GAP * np.median(np.diff(t))) | (gap >= 0.5 * usual)
    within = int(np.count_nonzero(~hiding))
    note = (
        f"{counted(within, 'gap')} {are(within)} shorter than half a usual hold and cannot hide "
        "one: the memory continues there"
    )
    return known_memory(u, check.breaks[hiding]), [note] * bool(within)


def _too_few(u: FloatArray) -> str:
    """Return a sentence if an input has holds with too few samples to be found, otherwise ""."""
    # Holds have at least three samples, because a step cannot be distinguished from the noise of
    # two; a share of such samples makes the record a log
    counts = [hold.end - hold.begin for hold in find_holds(u, fewest=3)]
    if len(counts) < _FEWEST or sum(counts) < 0.6 * u.size:
        return ""
    usual = np.median(counts)
    if usual >= FEWEST_STILL:
        return ""
    return (
        f"the holds have about {usual:.0f} samples each, and at least {FEWEST_STILL} are needed to "
        f"find one, {ENOUGH} to judge whether its output has settled: sample faster; if these "
        "are settled outputs already, identify the record as it is"
    )


def _cell(value: float) -> float | str:
    """Return a number for a table; an empty cell for NaN."""
    return value if np.isfinite(value) else ""


def _points(
    log: Record,
    holds: list[FoundHold],
    common: FloatArray,
    tolerance: float | None,
    values: FloatArray,
) -> list[ReducedPoint]:
    steps = np.diff(log.t)
    interval = float(np.median(steps[steps > 0]))
    change = SPAN_SHARE * _span(log, holds)
    noise = max(float(np.median([hold.sd for hold in holds])), 1e-9 * float(np.ptp(log.u)))
    points: list[ReducedPoint] = []
    for before, hold in zip([None, *holds], [*holds, None], strict=True):
        points += _passed(log, before, hold, 6 * noise)
        if hold is not None:
            slope = change / _duration(log.t, hold, interval) if tolerance is None else tolerance
            point = _judged(log, hold, common, slope, interval)
            rounding = _rounding(values, point.value)
            points.append(replace(point, sd=float(np.hypot(point.sd, rounding))))
    return points


def _resolution(readings: FloatArray) -> float:
    """Return the step of the readings of a sensor, 0 if they show none."""
    known = readings[np.isfinite(readings)]
    values = np.unique(known)
    # Readings show the resolution of a sensor only with four samples for each distinct reading
    if values.size < 3 or values.size * 4 > known.size:
        return 0.0
    steps = np.diff(values)
    # Distances of readings below this share of the greatest are rounding
    if steps.min() <= 1e-15 * steps.max():
        return 0.0
    count = steps / steps.min()
    return float(steps.min()) if np.abs(count - np.round(count)).max() < _WHOLE else 0.0


def _rounding(values: FloatArray, value: float) -> float:
    """Return the standard deviation of an error that is uniform over a step between values.

    ``values`` are the possible readings, increasing; empty for a sensor without steps.
    """
    if values.size < 2 or not np.isfinite(value):
        return 0.0
    place = int(np.searchsorted(values, value))
    return float(np.diff(values[max(place - 2, 0) : place + 2]).min() / np.sqrt(12))


def _judged(
    log: Record, hold: FoundHold, common: FloatArray, slope: float, interval: float
) -> ReducedPoint:
    part = slice(hold.begin, hold.end)
    t, y = log.t[part] - log.t[hold.begin] + interval, log.y[part]
    held = _duration(log.t, hold, interval)
    # If the end was not measured, it is unknown whether the output has settled.
    read = bool((np.isfinite(y) & (t > (1 - 1 / _WINDOW) * held)).any())
    y = y if read else np.full(y.size, np.nan)
    found = judge(t, y, tolerance=slope, window=held / _WINDOW)
    line = trend(t, y, held / _WINDOW)
    usual = common[part][np.isfinite(y) & np.isfinite(common[part])]
    return ReducedPoint(
        t=float(log.t[hold.end - 1]),
        input=hold.level,
        value=found.value,
        sd=found.sd if found.verdict != "unsettled" else np.nan,
        verdict=found.verdict if read else "unread",
        held=held,
        end=line.value if line else found.value,
        common_sd=float(usual[-1]) if usual.size else np.nan,
        begin=hold.begin,
        stop=hold.end,
    )


def _passed(
    log: Record, before: FoundHold | None, after: FoundHold | None, threshold: float
) -> list[ReducedPoint]:
    """Return the extremes that the input passes between two holds."""
    begin, end = before.end if before else 0, after.begin if after else len(log)
    if end <= begin:
        return []
    ends = [[hold.level] if hold else [] for hold in (before, after)]
    path = np.concatenate([ends[0], log.u[begin:end], ends[1]])
    places = turning_points(path, threshold)
    if before is None:
        places = np.union1d(places, [0])
    if after is None:
        places = np.union1d(places, [path.size - 1])
    lead = len(ends[0])
    rows = [row for row in (places - lead + begin).tolist() if begin <= row < end]
    return [ReducedPoint(float(log.t[k]), float(log.u[k]), k, k + 1) for k in rows]


def _duration(t: FloatArray, hold: FoundHold, interval: float) -> float:
    return float(t[hold.end - 1] - t[hold.begin]) + interval


def _span(log: Record, holds: list[FoundHold]) -> float:
    """Return the span of the outputs at the ends of the holds."""
    ends = []
    for hold in holds:
        last = log.y[hold.begin + (hold.end - hold.begin) * (_WINDOW - 1) // _WINDOW : hold.end]
        if np.isfinite(last).any():
            ends.append(float(np.nanmedian(last)))
    return float(np.ptp(ends)) if ends else 0.0


def _listed(numbers: list[int]) -> str:
    return f"hold {', '.join(map(str, numbers[:8]))}" + (", ..." if len(numbers) > 8 else "")


def _remedy(log: Record, points: list[ReducedPoint]) -> str:
    """Return a remedy for holds that have not settled."""
    counts = [np.count_nonzero(np.isfinite(log.y[p.begin : p.stop])) for p in points]
    usual = float(np.median(counts)) if counts else ENOUGH
    if usual >= ENOUGH:
        return "hold longer"
    return (
        f"they have about {usual:.0f} readings each, too few to judge: sample faster, {ENOUGH} "
        "readings per hold or more"
    )


def _advice(log: Record, points: list[ReducedPoint]) -> list[str]:
    holds = [point for point in points if point.verdict != "passed"]
    unsettled, unread = (
        [k for k, point in enumerate(holds, 1) if point.verdict == verdict]
        for verdict in ("unsettled", "unread")
    )
    notes = []
    if unsettled:
        notes.append(
            f"{len(unsettled)} of {len(holds)} holds did not settle ({_listed(unsettled)}): an "
            "output that has not settled is left out, and its input only drives the memory; "
            f"{_remedy(log, [holds[k - 1] for k in unsettled])}, or keep them anyway "
            "(--keep-unsettled)"
        )
    if unread:
        notes.append(
            f"no reading of the end of {len(unread)} of {len(holds)} holds can be used "
            f"({_listed(unread)}): their inputs only drive the memory; check the sensor and its "
            "range, and measure these holds again"
        )
    unknown = sum(not point.known for point in holds)
    if unknown:
        notes.append(
            f"{unknown} of {len(holds)} holds came after a break in time, before the memory was "
            "known "
            "again, and were left out"
        )
    passed = len(points) - len(holds)
    if passed:
        notes.append(
            f"{counted(passed, 'extreme')} of {log.input.name} between, before or after the holds "
            f"{are(passed)} kept without an output, to drive the memory"
        )
    if not log.timed:
        notes.append(
            "no time column was given (--time): durations are counted in samples, and slopes are "
            "per sample"
        )
    return notes
