"""Read a log from a file: one input, one output, and time that is checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, Samples
from minorloop.errors import ParameterError, RecordError, counted
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
from minorloop.lab.gaps import with_lost_rows
from minorloop.lab.records import SAMPLE, Origin, Quantity, Record
from minorloop.lab.sheets import is_sheet, read_sheet
from minorloop.lab.text_tables import LATIN, encoding_of
from minorloop.lab.timebase import (
    GAP,
    SECONDS,
    TimeCheck,
    check_times,
    other_clocks,
    split_time,
    time_column,
)

AUTO: Literal["auto"] = "auto"
Named: TypeAlias = str | None
"""Name of a column, ``"auto"`` to find it, or None for none."""

_DATE = 1e8
"""Times without a unit beyond this many seconds are dates; they are counted from the first."""


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
) -> Record:
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

    def read(time: str | None) -> Record:
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
        return log.with_origin(chosen=(*log.origin.chosen, f"time: none, because {error}"))
    if found is None:
        return log
    others = other_clocks(headers, found, but=(input, output))
    if clocks := [header for header in others if _is_clock(path, header)]:
        named = ", ".join(f"'{header}'" for header in clocks)
        note = f"'{found}' is the time; {named} could be too: name the right one with --time"
        return log.with_origin(notes=(*log.origin.notes, note))
    said = f"time: column '{found}'; name another one, or none, with time= (--time)"
    return log.with_origin(chosen=(*log.origin.chosen, said))


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
) -> Record:
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
    return Record(
        u,
        y,
        t,
        names[0],
        names[1],
        clock,
        curves=None if wanted.curves is None else texts[wanted.curves],
        groups=None if wanted.groups is None else texts[wanted.groups],
        sd=None if sd is None else known_deviations(columns[sd], y),
        origin=Origin(check, time, sd or "", said, rows=kept),
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


def known_deviations(sd: FloatArray, y: Samples) -> FloatArray | None:
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
