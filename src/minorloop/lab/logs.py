"""Read a log from a file: one input, one output, and time that is checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, Samples
from minorloop.errors import ParameterError, RecordError, are, counted
from minorloop.files import PathLike
from minorloop.lab.columns import (
    Labels,
    SparseColumnError,
    find_column,
    read_columns,
    read_headers,
    read_table,
    with_unit,
)
from minorloop.lab.gaps import Bridges, between, bridged, known_memory, with_lost_rows
from minorloop.lab.records import SAMPLE, Quantity, Record
from minorloop.lab.sheets import is_sheet, read_sheet
from minorloop.lab.text_tables import LATIN, encoding_of
from minorloop.lab.timebase import (
    GAP,
    SECONDS,
    UNEVEN,
    TimeCheck,
    check_times,
    delayed,
    resample,
    split_time,
)

__all__ = ["Log", "read_log", "read_times"]

_MOST_NEW = 4
_DATE = 1e8
"""Times without a unit beyond this many seconds are dates; they are counted from the first."""


@dataclass(frozen=True, eq=False)
class Log:
    """A record as it was logged, and what was found in its times.

    Parameters
    ----------
    record : Record
        The samples; times never run backwards.
    check : TimeCheck, optional
        What was found in the times; None without a column of time.
    labels : dict of str to (T,) array
        Columns of labels, by the names they were asked for.
    sd : (T,) array, optional
        Standard deviation of each output, NaN where it is not known; None if none is.
    of_file : tuple of str
        What was found in the file itself, one sentence each.
    rows : (T,) array of int, optional
        Rows of the file that the samples are, counted from 0; None if they are all.
    """

    record: Record
    check: TimeCheck | None = None
    labels: Mapping[str, Labels] = field(default_factory=dict)
    sd: FloatArray | None = None
    of_file: tuple[str, ...] = ()
    rows: IntArray | None = None

    @classmethod
    def of_points(cls, record: Record, sd: Sequence[float] | None) -> Log:
        """Return settled points, with the standard deviation of each if they are given."""
        return cls(record, sd=None if sd is None else _known(np.array(sd), record.y))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found in the file and its times, one sentence each."""
        return self.of_file + (self.check.notes if self.check else ())

    @property
    def irregular(self) -> tuple[str, ...]:
        """What was found about gaps and clock jumps, and about uneven steps of raw samples."""
        if self.check is None:
            return ()
        return self.check.of_breaks + (self.check.of_steps if self.sd is None else ())

    @cached_property
    def bridges(self) -> Bridges:
        """What is known about the input in each gap."""
        gaps = np.zeros(0, dtype=np.int64) if self.check is None else self.check.gaps
        return bridged(self.record.t, self.record.u, gaps)

    @property
    def breaks(self) -> IntArray:
        """Samples after which the memory is unknown."""
        none = np.zeros(0, dtype=np.int64)
        return none if self.check is None else np.union1d(self.bridges.unknown, self.check.jumps)

    @property
    def of_memory(self) -> tuple[str, ...]:
        """After which gaps the memory is known or unknown, in one sentence; empty without gaps."""
        gaps = self.bridges
        count, turned, unknown = gaps.after.size, int(gaps.turned.sum()), gaps.unknown.size
        if not count:
            return ()
        said = []
        if unknown:
            said.append(
                f"after {_gaps(unknown, count)} the memory is unknown until the input has been "
                "near both ends of its range or at one of them"
            )
        if turned:
            furthest = float(np.nanmax(gaps.doubt))
            said.append(
                f"in {_gaps(turned, count)} the input turned: its extreme is estimated from both "
                f"sides, to {furthest:.2g} {self.record.input.unit}".rstrip()
            )
        crossed = count - turned - unknown
        if crossed:
            where = f"{crossed} other{'s' if crossed > 1 else ''}" if said else _gaps(count, count)
            said.append(f"in {where} the input cannot have turned and the memory continues")
        return ("; ".join(said),)

    def left_out(self, *, dynamics: bool = False) -> tuple[str, ...]:
        """How many rows `with_known_memory` leaves out, why and what to do; empty if none.

        Parameters
        ----------
        dynamics : bool
            Whether dynamics are identified, which need times and cannot have curves.
        """
        lost, measured = self._lost
        if not lost:
            return ()
        advice = (
            "fill in the input where rows are missing, correct the times, or give the longest "
            "part without a gap (--rows A:B)"
            if dynamics
            else "if no row is missing there, leave --time out; if the input was saturated there, "
            "name a column of curves (--curves)"
        )
        return (
            f"{lost} of {counted(measured, 'measured row')} {are(lost)} not fitted, because the "
            f"memory is unknown after a gap or a step back of the clock; {advice}",
        )

    @property
    def mostly_left_out(self) -> bool:
        """Whether `with_known_memory` leaves out more than half of the measured rows."""
        lost, measured = self._lost
        return 2 * lost > measured

    @property
    def _lost(self) -> tuple[int, int]:
        """How many measured rows `with_known_memory` leaves out, and of how many."""
        measured = np.isfinite(self.record.y)
        return int(np.count_nonzero(measured & ~self._known)), int(measured.sum())

    @cached_property
    def _known(self) -> BoolArray:
        """(T,) whether the memory is known."""
        return known_memory(self.record.u, self.breaks, self.bridges)

    def with_memory_reset(self) -> Log:
        """Return the log without its breaks, because each curve begins with a known memory."""
        if self.check is None:
            return self
        none = np.zeros(0, dtype=np.int64)
        return replace(self, check=replace(self.check, gaps=none, jumps=none, of_breaks=()))

    def with_known_memory(self) -> Record:
        """Return the record without outputs where gaps leave the memory unknown.

        Where the input turned in a gap, the row beside it that is nearer to the extreme has the
        extreme as its input and no output.
        """
        record, gaps = self.record, self.bridges
        if self._known.all() and not gaps.turned.any():
            return record
        u, y = record.u.copy(), np.where(self._known, record.y, np.nan)
        for after, extreme, _ in gaps.turns():
            row = after - int(abs(extreme - u[after - 1]) < abs(extreme - u[after]))
            u[row], y[row] = extreme, np.nan
        return _replaced(record, record.t, u, y)

    def evenly_sampled(self) -> Record:
        """Return the record at its usual interval, as a lag in rows needs it.

        A record that would become more than four times as long is returned as it is.
        """
        record, check = self.record, self.check
        if check is None or (not check.breaks.size and check.uneven == 0):
            return record
        duration = float(record.t[-1] - record.t[0])
        if duration > _MOST_NEW * len(record) * check.interval:
            return self.with_known_memory()
        y = np.where(self._known, record.y, np.nan)
        measured = np.count_nonzero(np.isfinite(y))
        t, u, y = resample(record.t, record.u, y, check.interval, gap=_between_samples(check))
        if 2 * np.count_nonzero(np.isfinite(y)) < measured:  # read at single samples
            return self.with_known_memory()
        smooth = between(record.t, record.u, t, self.bridges)
        return _replaced(record, t, np.where(np.isnan(smooth), u, smooth), y)

    def without_lag(self, lag: float) -> Record:
        """Return the record with each output ``lag`` seconds after its input.

        Raises
        ------
        ParameterError
            If the log has no time.
        """
        record, check = self.with_known_memory(), self.check
        if check is None:
            raise ParameterError(
                f"the lag is {lag:g} s and the record has no time; name its column, or give the "
                "lag in rows"
            )
        y = delayed(record.t, record.y, lag, gap=_between_samples(check))
        return _replaced(record, record.t, record.u, y)


def read_log(
    path: PathLike,
    *,
    input: str,
    output: str,
    time: str | None = None,
    labels: Sequence[str] = (),
    sd: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Log:
    """Read an input, an output, time and labels from a file, in one pass.

    Parameters
    ----------
    path : str or path
        The file; see `minorloop.lab.columns.read_columns`.
    input, output : str
        Columns, by the whole header or the name, which may have the unit that a header lacks; the
        output may have gaps.
    time : str, optional
        Column of time, in the unit of its header, or date and time as ISO 8601; without it, the
        samples are counted.
    labels : sequence of str
        Columns of labels, such as specimens.
    sd : str, optional
        Column of the standard deviation of the output, in its unit; it may have gaps.
    progress : callable, optional
        Called with the share that has been read, as text.

    Raises
    ------
    RecordError
        If the file, a column or the times cannot be used.
    ParameterError
        If a column is given twice.
    """
    headers = read_headers(path)
    wanted = [name for name in (input, output, time) if name is not None]
    try:
        found = [find_column(name, headers, source=path) for name in wanted]
    except RecordError as error:
        which = "".join(f"; {text}" for text in _of_file(path) if is_sheet(path))
        raise RecordError(f"{error}{which}") from None
    names = [with_unit(*pair) for pair in zip(wanted, found, strict=True)]
    for place, header in enumerate(found):
        if header in found[:place]:
            options = ("--input", "--output", "--time")
            raise ParameterError(
                f"{options[found.index(header)]} and {options[place]} are both '{header}'; give "
                "two columns"
            )
    dates = () if time is None else (time,)
    deviations = () if sd is None else (sd,)

    def read(*gaps: str) -> tuple[dict[str, FloatArray], dict[str, Labels]]:
        names = [*wanted, *deviations]
        return read_table(path, names, labels, gaps=gaps, dates=dates, progress=progress)

    said, kept = _of_file(path), None
    try:
        columns, texts = read(output, *deviations)
    except SparseColumnError as error:
        if time is None:
            raise SparseColumnError(
                f"{error}, or, where two loggers were merged into one table, name the column of "
                "time (--time), by which the input is then interpolated"
            ) from None
        columns, texts = read(input, output, *deviations)
        rows, columns[input], filled = _filled(columns[time], columns[input], names[0])
        measured = np.isfinite(columns[output])
        if 2 * np.count_nonzero(measured) > measured.size - np.count_nonzero(measured):
            rows &= measured  # the output is read about as often as the input
        kept = np.flatnonzero(rows)
        columns = {name: values[rows] for name, values in columns.items()}
        texts, said = {name: values[rows] for name, values in texts.items()}, (*said, filled)
    u, y = columns[input], columns[output]
    noise = None if sd is None else _known(columns[sd], y)
    if time is None:
        t = np.arange(u.size, dtype=np.float64)
        return Log(Record(t, u, y, names[0], names[1], time=SAMPLE), None, texts, noise, said)
    clock, check = _checked(columns[time], names[2])
    check = with_lost_rows(check, u)
    record = Record(check.t, u, y, names[0], names[1], time=clock)
    return Log(record, check, texts, noise, said, kept)


def _filled(t: FloatArray, u: FloatArray, name: str) -> tuple[BoolArray, FloatArray, str]:
    """Fill the cells of an input that another logger recorded, on straight lines in time.

    Returns
    -------
    (T,) array of bool, (T,) array, str
        Which rows to keep, those that are not in a gap of the input; the inputs; and what is to be
        said.

    Raises
    ------
    RecordError
        If fewer than two rows have an input, or time runs backwards.
    """
    read = np.isfinite(u)
    if np.count_nonzero(read) < 2 or (np.diff(t) < 0).any():
        raise RecordError(
            f"{name} is empty in {np.count_nonzero(~read)} of {u.size} rows, as where two loggers "
            "were merged into one table; it is interpolated where at least two rows have it and "
            "the rows are in the order of time: sort them"
        )
    clock = t[read]
    steps = np.diff(clock)
    long = np.flatnonzero(steps > GAP * np.median(steps))
    place = np.searchsorted(clock, t, side="left")
    keep = read | ~np.isin(place - 1, long)
    keep &= (t >= clock[0]) & (t <= clock[-1])
    said = (
        f"{name} is empty in {np.count_nonzero(~read)} of {u.size} rows, as where two loggers were "
        "merged into one table; it is taken there from straight lines in time between its readings"
    )
    if not keep.all():
        said += f", and {counted(int((~keep).sum()), 'row')} without readings near are left out"
    return keep, np.interp(t, clock, u[read]), said


def read_times(path: PathLike, time: str) -> tuple[Quantity, TimeCheck]:
    """Read a column of time; return its name, in seconds, and its times with what was found.

    Raises
    ------
    RecordError
        As for ``read_log``.
    """
    header = with_unit(time, find_column(time, read_headers(path), source=path))
    return _checked(read_columns(path, [time], dates=[time])[time], header)


def _known(sd: FloatArray, y: Samples) -> FloatArray | None:
    """Return the standard deviations, or None where no measured output has one."""
    return sd if np.isfinite(sd[np.isfinite(y)]).any() else None


def _of_file(path: PathLike) -> tuple[str, ...]:
    if is_sheet(path):
        which = read_sheet(path).which
        return (which,) if which else ()
    if encoding_of(path) != LATIN:
        return ()
    return (f"{path} is not UTF-8 and was read as Windows-1252; check units such as µm and °C",)


def _checked(values: FloatArray, header: str) -> tuple[Quantity, TimeCheck]:
    clock = Quantity(*split_time(header))
    if clock.unit not in SECONDS:
        units = ", ".join(unit for unit in SECONDS if unit and unit.isascii())
        raise RecordError(f"time in column '{clock}' must be in one of {units}, or a date and time")
    with np.errstate(over="ignore"):  # infinite times are refused
        t = values * SECONDS[clock.unit]
    if clock.unit == "" and t.size and t[0] > _DATE:
        t = t - t[0]
    return Quantity(clock.name, "s"), check_times(t, name=f"column '{clock}'", unit=clock.unit)


def _between_samples(check: TimeCheck) -> float:
    """Return the longest step across which an output may be interpolated, in seconds."""
    shortest = float(np.diff(check.t)[check.gaps].min(initial=np.inf))
    return min(GAP * check.interval, (1 - UNEVEN) * shortest)


def _gaps(some: int, count: int) -> str:
    """Return in words which gaps: one, all or some of them."""
    if some < count:
        return f"{some} of {count} gaps"
    return "the gap" if count == 1 else "all gaps"


def _replaced(record: Record, t: FloatArray, u: FloatArray, y: FloatArray) -> Record:
    return Record(t, u, y, record.inputs, record.outputs, record.time)
