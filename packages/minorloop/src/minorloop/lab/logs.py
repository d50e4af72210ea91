"""Read a log from a file: one input, one output, and time that is checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, Samples
from minorloop.errors import ParameterError, RecordError, are, counted
from minorloop.files import PathLike
from minorloop.lab.columns import (
    Labels,
    SparseColumnError,
    deviation_column,
    find_column,
    read_columns,
    read_headers,
    read_table,
    split_header,
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
    other_clocks,
    resample,
    split_time,
    time_column,
)

__all__ = ["AUTO", "Log", "Named", "read_log", "read_times"]

AUTO: Literal["auto"] = "auto"
Named: TypeAlias = str | None
"""Name of a column, ``"auto"`` to find it, or None for none."""

_MOST_NEW = 4
_DATE = 1e8
"""Times without a unit beyond this many seconds are dates; they are counted from the first."""


@dataclass(frozen=True, eq=False)
class Log:
    """A record as it was logged, what each row has beside it, and what was found in its times.

    Parameters
    ----------
    record : Record
        The samples; times never run backwards.
    check : TimeCheck, optional
        What was found in the times; None without a column of time.
    time_column : str, optional
        Where these are from.
    curves, groups : (T,) array, optional
        Label of the curve, and of the group, of each row.
    sd : (T,) array, optional
        Standard deviation of each output, NaN where it is not known; None if none is.
    sd_column : str
        Where these are from.
    of_file : tuple of str
        What was found in the file itself, one sentence each.
    chosen : tuple of str
        Which columns were chosen that nobody named, one sentence each.
    rows : (T,) array of int, optional
        Rows of the file that the samples are, counted from 0; None if they are all.
    settled : bool
        Whether each sample is a settled point, as in an experiment store.
    first, last : int
        Samples that are used: from ``first`` up to but not ``last``; None for all the others.
    identified_by : callable, optional
        Identifies the samples of a run that chose its own inputs, with the options of `identify`.
    """

    record: Record
    check: TimeCheck | None = None
    time_column: str | None = None
    curves: Labels | None = None
    groups: Labels | None = None
    sd: FloatArray | None = None
    sd_column: str = "sd"
    of_file: tuple[str, ...] = ()
    chosen: tuple[str, ...] = ()
    rows: IntArray | None = None
    settled: bool = False
    first: int = 0
    last: int | None = None
    identified_by: Callable[[Log, Mapping[str, Any]], Any] | None = None

    @classmethod
    def of(cls, record: Record) -> Log:
        """Return a record whose times, if it has some, are checked.

        Parameters
        ----------
        record : Record
            The samples.

        Raises
        ------
        RecordError
            If the clock stands still or is set back too often.
        """
        if not record.timed:
            return cls(record)
        check = check_times(record.t, name=f"column '{record.time}'", unit=record.time.unit)
        return cls(record, with_lost_rows(check, record.u))

    @classmethod
    def of_points(cls, record: Record, sd: Sequence[float] | None) -> Log:
        """Return settled points, with the standard deviation of each if they are given.

        Parameters
        ----------
        record : Record
            The points.
        sd : (T,) array_like, optional
            Standard deviation of each output, NaN where it is not known.
        """
        known = None if sd is None else _known(np.array(sd), record.y)
        return cls(record, sd=known, settled=True)

    def __len__(self) -> int:
        return len(self.record)

    def only(self, first: int | None, last: int | None) -> Log:
        """Return the log of which some rows are used: from ``first`` up to but not ``last``.

        Parameters
        ----------
        first, last : int, optional
            Counted from 0, or from the end if negative, as in a slice; None for the ends.

        Raises
        ------
        ParameterError
            If there are no such rows.
        """
        total = len(self)
        begin, end, _ = slice(first, last).indices(total)
        beyond = any(row is not None and not -total <= row <= total for row in (first, last))
        if beyond or end <= begin:
            raise ParameterError(
                f"rows {first} to {last} are given, and there are {total}; give two numbers from 0 "
                f"to {total}, the first below the last"
            )
        return replace(self, first=begin, last=end)

    @property
    def part(self) -> slice:
        """Samples that are used."""
        return slice(self.first, self.last)

    @property
    def whole(self) -> bool:
        """Whether all samples are used."""
        return self.first == 0 and self.last in (None, len(self))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found in the file and its times, one sentence each."""
        return self.of_file + (self.check.notes if self.check else ())

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
            else "if no row is missing there, read the record without time (--time none); if the "
            "input was saturated there, name a column of curves (--curves)"
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

        Parameters
        ----------
        lag : float
            In seconds, >= 0.

        Raises
        ------
        ParameterError
            If the log has no time.
        """
        record, check = self.with_known_memory(), self.check
        if check is None:
            raise ParameterError(
                f"the lag is {lag:g} s and the record has no time; name its column (--time), or "
                "give the lag in rows"
            )
        y = delayed(record.t, record.y, lag, gap=_between_samples(check))
        return _replaced(record, record.t, record.u, y)


def read_log(
    path: PathLike,
    *,
    input: str,
    output: str,
    time: Named = AUTO,
    curves: str | None = None,
    groups: str | None = None,
    sd: Named = AUTO,
    strict: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Log:
    """Read an input, an output, and what each row has beside them, from a file.

    Raises a `RecordError` if the file, a column or the times cannot be used; a `ParameterError` if
    a column is given twice.

    Parameters
    ----------
    path : str or path
        The file; see `minorloop.lab.columns.read_columns`.
    input, output : str
        Columns, by the whole header or the name, which may have the unit that a header lacks; the
        output may have gaps.
    time : str, optional
        Column of time, in the unit of its header, or date and time as ISO 8601. ``"auto"``: the one
        with the name or unit of a time, if there is one and its times can be used. None: the
        samples are counted.
    curves, groups : str, optional
        Columns of labels, such as specimens.
    sd : str, optional
        Column of the standard deviation of the output, in its unit; it may have gaps. ``"auto"``:
        the column ``sd`` with this unit, if there is one. None: outputs count alike.
    strict : bool
        Whether a column of time that is found must be usable.
    progress : callable, optional
        Called with the share that has been read, as text.
    """
    headers = read_headers(path)
    deviation = _deviation(path, headers, output, sd)

    def read(time: str | None) -> Log:
        columns = _Columns(input, output, time, curves, groups, deviation)
        return _read(path, headers, columns, progress)

    if time != AUTO:
        return read(time)
    try:
        found = time_column(headers, source=path, but=(input, output))
        log = read(found)
    except RecordError as error:
        if strict:
            raise
        log = read(None)
        return replace(log, chosen=(*log.chosen, f"time: none, because {error}"))
    if found is None:
        return log
    others = other_clocks(headers, found, but=(input, output))
    if clocks := [header for header in others if _is_clock(path, header)]:
        named = ", ".join(f"'{header}'" for header in clocks)
        note = f"'{found}' is the time; {named} could be too: name the right one with --time"
        return replace(log, of_file=(*log.of_file, note))
    said = f"time: column '{found}'; name another one, or none, with time= (--time)"
    return replace(log, chosen=(*log.chosen, said))


@dataclass(frozen=True)
class _Columns:
    """Names of columns, as they were given; None for none."""

    input: str
    output: str
    time: str | None
    curves: str | None
    groups: str | None
    sd: str | None


def _deviation(path: PathLike, headers: Sequence[str], output: str, sd: Named) -> str | None:
    """Return the column of standard deviations of the output, if any.

    Raises a `RecordError` if the one that is named has another unit.
    """
    if sd is None:
        return None
    measured = with_unit(output, _found(path, headers, output))
    if sd == AUTO:
        return deviation_column(headers, measured)
    header = with_unit(sd, find_column(sd, headers, source=path))
    if split_header(header)[1] not in ("", split_header(measured)[1]):
        raise RecordError(
            f"column '{header}' of {path} is no standard deviation of '{measured}'; give one in "
            "the unit of the output"
        )
    return sd


def _found(path: PathLike, headers: Sequence[str], name: str) -> str:
    """Return the header of a column; an error names the sheet that was read, if there are more."""
    try:
        return find_column(name, headers, source=path)
    except RecordError as error:
        which = "".join(f"; {text}" for text in _of_file(path) if is_sheet(path))
        raise RecordError(f"{error}{which}") from None


def _read(
    path: PathLike,
    headers: Sequence[str],
    wanted: _Columns,
    progress: Callable[[str], None] | None,
) -> Log:
    """Read columns in one pass."""
    input, output, time, sd = wanted.input, wanted.output, wanted.time, wanted.sd
    given = [name for name in (input, output, time) if name is not None]
    found = [_found(path, headers, name) for name in given]
    names = [with_unit(*pair) for pair in zip(given, found, strict=True)]
    for place, header in enumerate(found):
        if header in found[:place]:
            options = ("--input", "--output", "--time")
            raise ParameterError(
                f"{options[found.index(header)]} and {options[place]} are both '{header}'; give "
                "two columns"
            )
    dates = () if time is None else (time,)
    deviations = () if sd is None else (sd,)
    labels = [name for name in (wanted.curves, wanted.groups) if name is not None]

    def read(*gaps: str) -> tuple[dict[str, FloatArray], dict[str, Labels]]:
        names = [*given, *deviations]
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
    if time is None:
        clock, check, t = SAMPLE, None, np.arange(u.size, dtype=np.float64)
    else:
        clock, check = _checked(columns[time], names[2])
        check = with_lost_rows(check, u)
        t = check.t
    return Log(
        Record(t, u, y, names[0], names[1], time=clock),
        check,
        time,
        curves=None if wanted.curves is None else texts[wanted.curves],
        groups=None if wanted.groups is None else texts[wanted.groups],
        sd=None if sd is None else _known(columns[sd], y),
        sd_column=sd or "sd",
        of_file=said,
        rows=kept,
    )


def _is_clock(path: PathLike, header: str) -> bool:
    """Whether a column has a time in every row, and never runs backwards."""
    try:
        values = read_columns(path, [header])[header]
    except RecordError:
        return False
    return bool(values.size > 1 and values[0] < values[-1] and (values[1:] >= values[:-1]).all())


def _filled(t: FloatArray, u: FloatArray, name: str) -> tuple[BoolArray, FloatArray, str]:
    """Fill the cells of an input that another logger recorded, on straight lines in time.

    Raises a `RecordError` if fewer than two rows have an input, or time runs backwards.

    Returns
    -------
    (T,) array of bool, (T,) array, str
        Which rows to keep, those that are not in a gap of the input; the inputs; and what is to be
        said.
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

    Raises a `RecordError` as for ``read_log``.
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
