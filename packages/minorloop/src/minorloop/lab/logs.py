"""Read a log from a file: one input, one output, and time that is checked."""

from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeAlias

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, Samples
from minorloop.errors import ParameterError, RecordError, counted
from minorloop.files import PathLike
from minorloop.lab.columns import opened, row_number
from minorloop.lab.gaps import with_lost_rows
from minorloop.lab.headers import deviation_column, split_header, with_unit
from minorloop.lab.records import SAMPLE, Origin, Quantity, Record
from minorloop.lab.tables import OpenTable, SparseColumnError
from minorloop.lab.timebase import GAP, SECONDS, TimeCheck, check_times, split_time, time_column

AUTO: Literal["auto"] = "auto"
Named: TypeAlias = str | None
"""Name of a column, ``"auto"`` to find it, or None for none."""


def read_log(
    path: PathLike,
    *,
    input: str,
    output: str,
    time: Named = AUTO,
    curves: str | None = None,
    groups: str | None = None,
    sd: Named = AUTO,
    progress: Callable[[str], None] | None = None,
) -> Record:
    """Read an input, an output, and further columns such as time and labels, from a file.

    Raises a `RecordError` if the file, a column or the times cannot be used; a `ParameterError` if
    a column is given twice.

    Parameters
    ----------
    path : str or path
        The file; see `minorloop.lab.columns.opened`.
    input, output : str
        Columns, by the whole header or the name, which may add a unit to a header without one; the
        output may have gaps.
    time : str, optional
        Column of time, in the unit of its header, or date and time as ISO 8601. ``"auto"``: the
        column with the name or unit of a time, if there is one and its times can be used. None: the
        samples are counted.
    curves, groups : str, optional
        Columns of labels, such as specimens.
    sd : str, optional
        Column of the standard deviation of the output, in its unit; it may have gaps. ``"auto"``:
        the column ``sd`` with this unit, if there is one. None: outputs count alike.
    progress : callable, optional
        Called with the share that has been read, as text.
    """
    with opened(path, progress or (lambda share: None)) as table:
        found, why = _sought(table, time, (input, output))
        named = {"input": input, "output": output, "time": found}
        headers = _headers(table, {key: name for key, name in named.items() if name is not None})
        deviation = _deviation(table, headers["output"], sd)
        clock = [] if found is None else [found]
        columns = table.read(
            [input, output, *clock, *([] if deviation is None else [deviation])],
            [name for name in (curves, groups) if name is not None],
            gaps=[output] if deviation is None else [output, deviation],
            dates=clock,
            tried=[input, *clock],
        )
    said, kept, check, quantity = table.notes, None, None, SAMPLE
    try:
        if found is not None:
            _usable(columns[found])
            columns, kept, filled = _merged(columns, found, input, output, headers["input"])
            said += filled
            quantity, check = _checked(columns[found], headers["time"])
            check = with_lost_rows(check, _usable(columns[input]))
    except RecordError as error:
        if time != AUTO:
            raise
        found, why = None, str(error)
    if isinstance(columns[input], SparseColumnError):
        raise SparseColumnError(
            f"{columns[input]}, or, where two loggers were merged into one table, name the column "
            "of time (--time), by which the input is then interpolated"
        )
    u, y = _usable(columns[input]), columns[output]
    return Record(
        u,
        y,
        np.arange(u.size, dtype=np.float64) if check is None else check.t,
        headers["input"],
        headers["output"],
        quantity,
        curves=None if curves is None else columns[curves],
        groups=None if groups is None else columns[groups],
        sd=None if deviation is None else _known_deviations(columns[deviation], y),
        origin=Origin(
            check, found, deviation or "", said, _chosen(time, found, why), why, rows=kept
        ),
    )


def _sought(table: OpenTable, time: Named, others: tuple[str, ...]) -> tuple[str | None, str]:
    """Return the column of time, if any, and the reason if a found column is not used."""
    if time != AUTO:
        return time, ""
    try:
        return time_column(table.headers, source=table.file, but=others), ""
    except RecordError as error:
        return None, str(error)


def _chosen(time: Named, found: str | None, why: str) -> tuple[str, ...]:
    """Report an automatic choice of the column of time, or the reason for none."""
    if found is not None and time == AUTO:
        return (f"time: column '{found}'; name another one, or none, with time= (--time)",)
    return (f"time: none, because {why}",) if why else ()


def _headers(table: OpenTable, named: Mapping[str, str]) -> dict[str, str]:
    """Return headers with units of columns, by the options that name them.

    Raises a `ParameterError` if two options name the same column.
    """
    found: dict[str, str] = {}
    for option, name in named.items():
        header = table.find(name)
        for other, others in named.items():
            if other in found and table.find(others) == header:
                raise ParameterError(
                    f"{other} (--{other}) and {option} (--{option}) are both '{header}'; give two "
                    "columns"
                )
        found[option] = with_unit(name, header)
    return found


def _deviation(table: OpenTable, measured: str, sd: Named) -> str | None:
    """Return the column of standard deviations of the output, if any.

    Raises a `RecordError` if the named column has another unit.
    """
    if sd == AUTO:
        return deviation_column(table.headers, measured)
    if sd is not None:
        header = with_unit(sd, table.find(sd))
        if split_header(header)[1] not in ("", split_header(measured)[1]):
            raise RecordError(
                f"column '{header}' of {table.file} is not a standard deviation of '{measured}'; "
                "give one in the unit of the output"
            )
    return sd


def _usable(column: FloatArray | RecordError) -> FloatArray:
    """Return a column, or raise the error in its place."""
    if isinstance(column, RecordError):
        raise column
    return column


def _merged(
    columns: dict[str, Any], time: str, input: str, output: str, header: str
) -> tuple[dict[str, Any], IntArray | None, tuple[str, ...]]:
    """Return columns with a filled input, if two loggers were merged; their rows; and a note."""
    if not isinstance(sparse := columns[input], SparseColumnError):
        return columns, None, ()
    rows, u, filled = _filled(columns[time], sparse.values, header)
    columns[input] = u
    measured = np.isfinite(columns[output])
    if 2 * np.count_nonzero(measured) > measured.size - np.count_nonzero(measured):
        rows &= measured  # the output was read about as often as the input
    return {name: x[rows] for name, x in columns.items()}, np.flatnonzero(rows), (filled,)


def _filled(t: FloatArray, u: FloatArray, name: str) -> tuple[BoolArray, FloatArray, str]:
    """Fill the empty cells of an input from another logger, by linear interpolation in time.

    Raises a `RecordError` if fewer than two rows have an input, or time runs backwards.

    Returns
    -------
    (T,) array of bool, (T,) array, str
        Whether to keep each row (not in a gap of the input); the inputs; and a note.
    """
    read = np.isfinite(u)
    if np.count_nonzero(read) < 2 or (np.diff(t) < 0).any():
        raise RecordError(
            f"{name} is empty in {np.count_nonzero(~read)} of {u.size} rows, as if two loggers "
            "were merged into one table; it is interpolated only if at least two rows have it and "
            "the rows are in the order of time: sort them"
        )
    clock = t[read]
    steps = np.diff(clock)
    long = np.flatnonzero(steps > GAP * np.median(steps))
    place = np.searchsorted(clock, t, side="left")
    keep = read | ~np.isin(place - 1, long)
    keep &= (t >= clock[0]) & (t <= clock[-1])
    said = (
        f"{name} is empty in {np.count_nonzero(~read)} of {u.size} rows, as if two loggers were "
        "merged into one table; it is interpolated linearly in time between its readings"
    )
    if not keep.all():
        said += f", and {counted(int((~keep).sum()), 'row')} without readings near are left out"
    return keep, np.interp(t, clock, u[read]), said


def read_times(path: PathLike, time: str) -> tuple[Quantity, TimeCheck]:
    """Read a column of time; return its name, with the unit s, and its checked times.

    Raises a `RecordError` as for ``read_log``.
    """
    with opened(path) as table:
        return _times(table, time)


def _times(table: OpenTable, time: str) -> tuple[Quantity, TimeCheck]:
    """Return name and checked times as `read_times`, from an open table."""
    header = with_unit(time, table.find(time))
    return _checked(table.read([time], dates=[time])[time], header)


def with_times(
    record: Record, path: PathLike, input: str, time: Named, *, strictly: bool, reset: bool
) -> Record:
    """Return the inputs of a file with its times, found as by `read_log` if they are used.

    Raises a `RecordError` if the named column of time cannot be used.

    ``record``: the inputs, without times; ``path``, ``input`` and ``time``: the file, the column of
    its input, and that of its time, as of `read_log`; ``strictly``: whether no time may repeat;
    ``reset``: whether the memory is reset before each curve, at which times may restart.
    """
    with opened(path) as table:
        found, why = _sought(table, time, (input,))
        try:
            if found is not None:
                clock, check = _times(table, found)
                origin = Origin(with_lost_rows(check, np.asarray(record.u)), found)
                timed = record.replace(t=check.t, time=clock, origin=origin)
                timed = timed.with_memory_reset() if reset else timed
                if timed.check is not None:
                    check_order(path, found, timed.check, strictly=strictly)
                record = timed
        except RecordError as error:
            if time != AUTO:
                raise
            found, why = None, str(error)
    return record.with_origin(chosen=_chosen(time, found, why), why_untimed=why)


def _known_deviations(sd: FloatArray, y: Samples) -> FloatArray | None:
    """Return the standard deviations, or None if no measured output has one."""
    return sd if np.isfinite(sd[np.isfinite(y)]).any() else None


def _checked(values: FloatArray, header: str) -> tuple[Quantity, TimeCheck]:
    clock = Quantity(*split_time(header))
    if clock.unit not in SECONDS:
        units = ", ".join(unit for unit in SECONDS if unit and unit.isascii())
        raise RecordError(f"time in column '{clock}' must be in one of {units}, or a date and time")
    with np.errstate(over="ignore"):  # infinite times are refused
        t = values * SECONDS[clock.unit]
    # Times without a unit beyond this many seconds are dates; they are counted from the first
    if clock.unit == "" and t.size and t[0] > 1e8:
        t = t - t[0]
    return Quantity(clock.name, "s"), check_times(t, name=f"column '{clock}'", unit=clock.unit)


def check_order(
    path: PathLike,
    column: str,
    check: TimeCheck,
    *,
    strictly: bool = True,
    part: slice = slice(None),
    rows: IntArray | None = None,
) -> None:
    """Refuse times in a part of the samples that decrease, or that repeat if ``strictly``.

    Raises a `RecordError` with the row of the file: ``rows`` (T,) are the rows of the samples,
    counted from 0; None if the samples are all rows.
    """
    back = np.zeros(check.t.size - 1, dtype=np.bool_)
    back[check.jumps] = True
    wrong = back | (np.diff(check.t) <= 0) if strictly else back.copy()
    used = range(check.t.size)[part]
    wrong[: used.start] = wrong[used.stop - 1 :] = False
    if not wrong.any():
        return
    step = int(np.argmax(wrong))
    row = row_number(path, step + 1 if rows is None else int(rows[step + 1]))
    with opened(path) as table:
        where = f"column '{table.find(column)}' of {path}"
    if back[step]:
        raise RecordError(
            f"{where} runs backwards in row {row}; give the rows in the order of time"
        )
    raise RecordError(
        f"{where} has the same time in row {row} as in the previous row; remove one of the rows, "
        "or write more digits"
    )
