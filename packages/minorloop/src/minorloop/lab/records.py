"""A measured record: inputs and outputs against time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Samples, as_samples, frozen
from minorloop.errors import RecordError, SignalError
from minorloop.files import PathLike, check_name, check_writable, table_text, write_atomically
from minorloop.lab.columns import find_column, read_columns, read_headers, split_header, with_unit
from minorloop.lab.timebase import SECONDS

__all__ = ["SAMPLE", "Quantity", "Record", "Timing", "read_columns", "read_headers"]


@dataclass(frozen=True)
class Quantity:
    """A name with its unit; the unit is empty for a pure number or where it is not known.

    Raises
    ------
    ParameterError
        If the name or the unit has characters that cannot be printed.
    """

    name: str
    unit: str = ""

    def __post_init__(self) -> None:
        check_name("the name", self.name)
        check_name(f"the unit of {self.name}", self.unit)

    @classmethod
    def parse(cls, header: str) -> Quantity:
        """Split a header such as ``voltage [V]``."""
        return cls(*split_header(header))

    def __str__(self) -> str:
        return f"{self.name} [{self.unit}]" if self.unit else self.name


SAMPLE = Quantity("sample")
"""Takes the place of time where none was measured."""


@dataclass(frozen=True)
class Timing:
    """When a hold began and ended, by the clock of its record."""

    began: float
    """When the input was on: the middle of the exchange that set it, in seconds."""
    ended: float
    """When the hold ended, in seconds."""
    uncertainty: float
    """Largest error of a time since the input was on, in seconds: half the exchange that set the
    input and half the longest that read the output."""


@dataclass(frozen=True, eq=False)
class Record:
    """Inputs and outputs of an actuator against time.

    Parameters
    ----------
    t : (T,) array_like
        Time in seconds, never running backwards; or the sample number where ``time`` is
        ``SAMPLE``.
    u : (T,) or (channels, T) array_like
        Inputs, finite.
    y : (T,) or (channels, T) array_like
        Outputs; NaN marks a sample that was not measured.
    inputs, outputs : str, Quantity, or sequence of them
        Name and unit of each channel, such as ``voltage [V]``.
    time : Quantity
        What ``t`` is.
    timing : Timing, optional
        When the hold began and ended, and how well times are known; None where the times are exact,
        as those of a twin, or this was not measured.

    Raises
    ------
    RecordError
        If the shapes do not match, or a number cannot be used.
    """

    t: FloatArray
    u: Samples
    y: Samples
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    time: Quantity
    timing: Timing | None

    def __init__(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        y: npt.ArrayLike,
        inputs: str | Quantity | Sequence[str | Quantity] = "input",
        outputs: str | Quantity | Sequence[str | Quantity] = "output",
        time: Quantity = Quantity("time", "s"),
        timing: Timing | None = None,
    ) -> None:
        values = {"t": _samples(t, "t"), "u": _samples(u, "u"), "y": _samples(y, "y", gaps=True)}
        for name, value in values.items():
            object.__setattr__(self, name, frozen(value))
        object.__setattr__(self, "inputs", _quantities(inputs))
        object.__setattr__(self, "outputs", _quantities(outputs))
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "timing", timing)
        self._check()

    def __len__(self) -> int:
        return int(self.t.size)

    def __str__(self) -> str:
        names = ", ".join(str(q) for q in (*self.inputs, *self.outputs))
        return f"{len(self)} samples of {names}"

    @property
    def input(self) -> Quantity:
        """Name and unit of the first input."""
        return self.inputs[0]

    @property
    def output(self) -> Quantity:
        """Name and unit of the first output."""
        return self.outputs[0]

    @property
    def timed(self) -> bool:
        """Whether ``t`` is time in seconds and not a count of samples."""
        return self.time != SAMPLE

    @classmethod
    def from_csv(
        cls,
        path: PathLike,
        *,
        input: str,
        output: str,
        time: str | None = None,
        gaps: bool = False,
    ) -> Record:
        """Read one input and one output from a CSV file.

        Parameters
        ----------
        path : str or path
            A CSV file with one header line; see ``read_columns``.
        input, output : str
            Columns, by the whole header (``voltage [V]``) or the name (``voltage``).
        time : str, optional
            The column of time, in s unless its header says ms, us, min or h. Without it the samples
            are numbered 0, 1, 2, ...
        gaps : bool
            Whether the output may have empty cells and ``nan``, which give NaN.

        Raises
        ------
        RecordError
            If the file or a column in it cannot be used.
        """
        headers = read_headers(path)
        wanted = [name for name in (input, output, time) if name is not None]
        columns = read_columns(path, wanted, gaps=(output,) if gaps else ())
        found = {name: with_unit(name, find_column(name, headers, source=path)) for name in wanted}
        return cls._from_columns(columns, found, input, output, time)

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        *,
        input: str,
        output: str,
        time: str | None = None,
        gaps: bool = False,
    ) -> Record:
        """Read one input and one output from a data frame.

        Parameters
        ----------
        frame : pandas or polars data frame, or dict of arrays
            Anything whose ``frame[column]`` gives the values of a column.
        input, output, time, gaps
            As in ``from_csv``.

        Raises
        ------
        RecordError
            If a column is missing or has other values than numbers.
        """
        keys = {str(key): key for key in getattr(frame, "columns", frame)}
        wanted = [name for name in (input, output, time) if name is not None]
        found = {name: find_column(name, list(keys), source="the frame") for name in wanted}
        columns = {
            name: _numbers(frame[keys[header]], header, gaps=gaps and name == output)
            for name, header in found.items()
        }
        return cls._from_columns(columns, found, input, output, time)

    @classmethod
    def joined(cls, records: Sequence[Record]) -> Record:
        """Join records that follow each other on the same clock.

        Parameters
        ----------
        records : sequence of Record
            In the order of their times.

        Raises
        ------
        RecordError
            If there is none, their channels differ, or time runs backwards.
        """
        if not records:
            raise RecordError("there is no record to join; give at least one")
        first = records[0]
        for other in records[1:]:
            if (other.inputs, other.outputs, other.time) != (
                first.inputs,
                first.outputs,
                first.time,
            ):
                raise RecordError(f"'{first}' and '{other}' have different channels")
        t, u, y = (
            np.concatenate([getattr(record, name) for record in records], axis=-1) for name in "tuy"
        )
        return cls(t, u, y, first.inputs, first.outputs, first.time)

    def to_csv(self, path: PathLike, *, force: bool = False) -> None:
        """Write the record as CSV: time, inputs, outputs, with name and unit as headers.

        Reading the numbers gives the same float64.
        """
        check_writable(path, force=force)
        header = [str(q) for q in (self.time, *self.inputs, *self.outputs)]
        table = np.vstack([self.t, self.u, self.y])
        rows = zip(*(row.tolist() for row in table), strict=True)
        write_atomically(path, table_text(header, rows))

    @classmethod
    def _from_columns(
        cls,
        columns: dict[str, FloatArray],
        found: dict[str, str],
        input: str,
        output: str,
        time: str | None,
    ) -> Record:
        u, y = columns[input], columns[output]
        names = (found[input], found[output])
        if time is None:
            return cls(np.arange(u.size, dtype=np.float64), u, y, *names, time=SAMPLE)
        clock = Quantity.parse(found[time])
        if clock.unit not in SECONDS:
            units = ", ".join(unit for unit in SECONDS if unit)
            raise RecordError(f"time in column '{found[time]}' must be in one of {units}")
        with np.errstate(over="ignore"):  # infinite times are refused later
            t = columns[time] * SECONDS[clock.unit]
        return cls(t, u, y, *names, time=Quantity(clock.name, "s"))

    def _check(self) -> None:
        if self.t.ndim != 1 or self.t.size == 0:
            raise RecordError(f"t has shape {self.t.shape}; give (T,) times of at least one sample")
        for name, values, names in (("u", self.u, self.inputs), ("y", self.y, self.outputs)):
            channels = 1 if values.ndim == 1 else values.shape[0]
            if values.shape[-1] != self.t.size:
                raise RecordError(f"{name} has {values.shape[-1]} samples and t has {self.t.size}")
            if channels != len(names):
                raise RecordError(f"{name} has {channels} channels and {len(names)} names")
        steps = np.diff(self.t)
        if (steps < 0).any():
            row = int(np.argmax(steps < 0))
            raise RecordError(
                f"{self.time.name} runs backwards from {self.t[row]:g} to {self.t[row + 1]:g} "
                f"at sample {row + 1}; sort the record or leave the time column out"
            )


def _samples(values: npt.ArrayLike, name: str, *, gaps: bool = False) -> Samples:
    try:
        return as_samples(values, name=name, gaps=gaps)
    except SignalError as error:
        raise RecordError(str(error)) from None


def _quantities(names: str | Quantity | Sequence[str | Quantity]) -> tuple[Quantity, ...]:
    each = (names,) if isinstance(names, str | Quantity) else tuple(names)
    return tuple(Quantity.parse(name) if isinstance(name, str) else name for name in each)


def _numbers(column: Any, header: str, *, gaps: bool) -> FloatArray:
    """Return a column of a frame as numbers; an error names the first other cell."""
    where = f"column '{header}' of the frame"
    if np.iscomplexobj(column):
        raise RecordError(f"{where} is complex; give real numbers")
    try:
        values = np.asarray(column)
        numbers = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        index, cell = _first_text(np.asarray(column, dtype=object).ravel())
        raise RecordError(
            f"{where} has {cell!r} at index {index}; every cell must be a number"
        ) from None
    if numbers.ndim != 1:
        raise RecordError(f"{where} is not one column of numbers")
    if values.dtype.kind in "mM":
        raise RecordError(f"{where} holds dates; give time as numbers, in seconds")
    if numbers.size == 0:
        raise RecordError(f"{where} has no rows; there is nothing to read")
    usable = ~np.isinf(numbers) if gaps else np.isfinite(numbers)
    if not usable.all():
        index = int(np.argmin(usable))
        raise RecordError(
            f"{where} has {numbers[index]} at index {index}; every cell must be a finite number"
        )
    return numbers


def _first_text(cells: npt.NDArray[np.object_]) -> tuple[int, object]:
    for index, cell in enumerate(cells):
        try:
            float(cell)
        except (TypeError, ValueError):
            return index, cell
    return 0, cells[0] if cells.size else None
