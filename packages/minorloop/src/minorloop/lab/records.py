"""A measured record: inputs and outputs against time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    LARGEST,
    BoolArray,
    FloatArray,
    IntArray,
    Samples,
    as_samples,
    check_magnitude,
    frozen,
)
from minorloop.errors import ParameterError, RecordError, SignalError, are, counted
from minorloop.figures import Drawn
from minorloop.files import PathLike, check_name, check_writable, table_text, write_atomically
from minorloop.lab.faults import FEWEST, Fault, usable, without_codes
from minorloop.lab.gaps import Bridges, bridged, known_memory, with_lost_rows
from minorloop.lab.headers import split_header
from minorloop.lab.timebase import GAP, SECONDS, UNEVEN, TimeCheck, check_times, delayed, resample
from minorloop.operators.memory import Start, StartOfCurve


@dataclass(frozen=True)
class Quantity:
    """A name with its unit; the unit is empty for a pure number or where it is not known.

    Raises a `ParameterError` if the name or the unit has characters that cannot be printed.
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
"""Replaces the time if it was not measured."""


@dataclass(frozen=True)
class Timing:
    """Begin and end of a hold, by the clock of its record."""

    began: float
    """Time when the input was on: the middle of the exchange that set it, in seconds."""
    ended: float
    """Time when the hold ended, in seconds."""
    uncertainty: float
    """Largest error of a time since the input was on, in seconds: half the exchange that set the
    input plus half the longest exchange that read the output."""


@dataclass(frozen=True, eq=False)
class Origin:
    """Information from the file of a record in addition to its samples."""

    check: TimeCheck | None = None
    """Check of the column of time."""
    time_column: str | None = None
    """The column of time."""
    sd_column: str = ""
    """The column of standard deviations; empty if they are not from a column."""
    notes: tuple[str, ...] = ()
    """Findings about the file itself, one sentence each."""
    chosen: tuple[str, ...] = ()
    """Automatic choices of columns, one sentence each."""
    why_untimed: str = ""
    """Reason why an automatic column of time was not used; empty if it was used."""
    rows: IntArray | None = None
    """Rows of the samples in the file, counted from 0; None if the samples are all rows."""
    settled: bool = False
    """Whether each sample is a settled point, as in an experiment store."""
    identified_by: Callable[..., Any] | None = None
    """Identifies the samples of a run that chose its own inputs, as `minorloop.identify`."""


@dataclass(frozen=True, eq=False)
class Record(Drawn):
    """Inputs and outputs of an actuator, with time, labels and uncertainty of each row.

    Raises a `RecordError` if the shapes do not match, a number cannot be used, or the clock often
    runs backwards; a `ParameterError` if there are no rows from ``first`` to ``last``.

    Parameters
    ----------
    u : (T,) or (channels, T) array_like
        Inputs, finite.
    y : (T,) or (channels, T) array_like
        Outputs; NaN marks a sample that was not measured.
    t : (T,) array_like, optional
        Time in seconds, or in the unit of its name if it is a column of a data frame. Where the
        clock was set back, it continues with the usual interval. By default the samples are
        counted.
    inputs, outputs : str, Quantity, or sequence of them, optional
        Name and unit of each channel, such as ``voltage [V]``; by default those of a column of a
        data frame or of xarray.
    time : Quantity
        Name and unit of ``t``; ``SAMPLE`` for the number of the sample.
    timing : Timing, optional
        Begin and end of the hold, and uncertainty of times; None if times are exact, as of a twin,
        or this was not measured.
    curves : (T,) array_like, optional
        Label of the curve of each row, such as its number. Where the label changes, the memory is
        reset. Curves are also groups, unless ``groups`` are given.
    groups : (T,) array_like, optional
        Label of the group of each row, such as its specimen. Each group is predicted by a fit to
        the others, and bands include the scatter of three or more groups.
    sd : float or (T,) array_like, optional
        Standard deviation of the measured outputs, in their unit, if it is known. Only the prior
        uses a single number. With an array, each output has the weight 1 / (sd^2 + m^2), where m is
        the error of the model itself, from its residual; NaN if it is not known, which counts as
        the greatest.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first sample.
    start_of_curve : {"negative", "positive", "demagnetised", "as-left"} or Memory, optional
        Memory before each curve, also the first; ``start`` by default. ``"as-left"``: the memory
        that the previous curve left.
    skip : int
        Rows at the start of the record, and of each curve, that set the memory and are not fitted.
    first, last : int
        Samples to use: from ``first`` up to but not ``last``; None for all further samples.
    origin : Origin
        Information from the file of the record.

    Examples
    --------
    >>> record = ml.Record([0.0, 1.0, 0.0], [0.1, 0.9, 0.2], None, "voltage [V]")
    >>> len(record), record.input.unit
    (3, 'V')
    """

    u: Samples
    y: Samples
    t: FloatArray
    inputs: tuple[Quantity, ...]
    outputs: tuple[Quantity, ...]
    time: Quantity
    timing: Timing | None
    curves: npt.NDArray[Any] | None
    groups: npt.NDArray[Any] | None
    sd: float | FloatArray | None
    start: Start
    start_of_curve: StartOfCurve | None
    skip: int
    first: int
    last: int | None
    origin: Origin

    def __init__(
        self,
        u: npt.ArrayLike,
        y: npt.ArrayLike,
        t: npt.ArrayLike | None = None,
        inputs: str | Quantity | Sequence[str | Quantity] | None = None,
        outputs: str | Quantity | Sequence[str | Quantity] | None = None,
        time: Quantity | None = None,
        timing: Timing | None = None,
        *,
        curves: npt.ArrayLike | None = None,
        groups: npt.ArrayLike | None = None,
        sd: float | npt.ArrayLike | None = None,
        start: Start = "negative",
        start_of_curve: StartOfCurve | None = None,
        skip: int = 0,
        first: int = 0,
        last: int | None = None,
        origin: Origin = Origin(),
    ) -> None:
        rows = {"u": _samples(u, "u"), "y": _samples(y, "y", gaps=True)}
        if t is None:
            clock, time = np.arange(rows["u"].shape[-1], dtype=np.float64), time or SAMPLE
        elif time is None:
            clock, time = _clock(t)
        else:
            clock = _samples(t, "t")
        labels = {"curves": curves, "groups": groups}
        values = {
            **{name: frozen(value) for name, value in {**rows, "t": clock}.items()},
            "inputs": _quantities(_named(u, "input") if inputs is None else inputs),
            "outputs": _quantities(_named(y, "output") if outputs is None else outputs),
            "time": time,
            "timing": timing,
            **{name: None if x is None else np.asarray(x) for name, x in labels.items()},
            "sd": np.asarray(sd, dtype=np.float64) if np.ndim(sd) else sd,  # type: ignore[arg-type]
            "start": start,
            "start_of_curve": start_of_curve,
            "skip": skip,
            "first": first,
            "last": last,
            "origin": origin,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        self._check()

    def __len__(self) -> int:
        return int(self.t.size)

    def __str__(self) -> str:
        names = ", ".join(str(q) for q in (*self.inputs, *self.outputs))
        return f"{len(self)} samples of {names}"

    def summary(self) -> list[tuple[str, str]]:
        """Return rows of a short table: samples, and the range of each channel."""
        rows = [("samples", f"{len(self)}")]
        for names, values in ((self.inputs, self.u), (self.outputs, self.y)):
            for name, channel in zip(names, np.atleast_2d(values), strict=True):
                known = channel[np.isfinite(channel)]
                text = f"{known.min():.6g} to {known.max():.6g}" if known.size else "not measured"
                rows.append((str(name), text))
        return rows

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

    def replace(self, **changes: Any) -> Record:
        """Return the record with other values of some of its parameters.

        Parameters
        ----------
        **changes
            Parameters of `Record`.
        """
        return replace(self, **changes)

    def with_origin(self, **changes: Any) -> Record:
        """Return the record with other values of some fields of its origin.

        Parameters
        ----------
        **changes
            Fields of `Origin`.
        """
        return self.replace(origin=replace(self.origin, **changes))

    @cached_property
    def checked(self) -> tuple[FloatArray, FloatArray, tuple[Fault, ...]]:
        """Inputs (T,) to fit, outputs (T,) with NaN in place of codes, and the faults of the codes.

        Raises a `SignalError` if there are several channels, fewer than three outputs, an input or
        output that never changes, or a number whose square is beyond a float64.
        """
        for name, values in (("u", self.u), ("y", self.y)):
            if values.ndim != 1:
                raise SignalError(f"{name} has shape {values.shape}; give one record, (T,)")
        outputs, coded = without_codes(self.u, self.y)
        finite = outputs[np.isfinite(outputs)]
        if finite.size < FEWEST:
            raise SignalError(
                f"{counted(finite.size, 'output')} {are(finite.size)} finite; at least {FEWEST} "
                "are needed"
            )
        for name, values in (("input", self.u), ("output", finite)):
            check_magnitude(name, values)
            if 0 < np.ptp(values) < 1 / LARGEST:
                raise SignalError(
                    f"the {name} changes only by {np.ptp(values):g}; scale it to above "
                    f"{1 / LARGEST:g}"
                )
            if np.ptp(values) == 0:
                raise SignalError(
                    f"the {name} is {values[0]:g} throughout; record a changing {name}"
                )
        return self.u, outputs, coded

    @cached_property
    def check(self) -> TimeCheck | None:
        """Check of the times; None without times.

        Raises a `RecordError` if the clock has stopped or is set back too often.
        """
        if self.origin.check is not None or not self.timed:
            return self.origin.check
        check = check_times(self.t, name=f"column '{self.time}'", unit=self.time.unit)
        return with_lost_rows(check, self.u)

    def only(self, first: int | None, last: int | None) -> Record:
        """Return the record that uses only rows from ``first`` up to but not ``last``.

        Raises a `ParameterError` if there are no such rows.

        Parameters
        ----------
        first, last : int, optional
            Counted from 0, or from the end if negative, as in a slice; None for the ends.
        """
        total = len(self)
        rows = [
            None if row is None else row + total if -total <= row < 0 else row
            for row in (first, last)
        ]
        begin, end = rows[0] or 0, rows[1]
        return self.replace(first=begin, last=end)

    @property
    def part(self) -> slice:
        """Slice of the used samples."""
        return slice(self.first, self.last)

    @property
    def whole(self) -> bool:
        """Whether all samples are used."""
        return self.first == 0 and self.last in (None, len(self))

    def cut(self) -> Record:
        """Return a record of only the used rows."""
        if self.whole:
            return self
        part = self.part
        beside = {
            name: values[part]
            for name in ("curves", "groups", "sd")
            if np.ndim(values := getattr(self, name))
        }
        rows = {name: getattr(self, name)[..., part] for name in ("t", "u", "y")}
        origin = replace(self.origin, check=None)
        return self.replace(**rows, **beside, first=0, last=None, origin=origin)

    @property
    def weighted(self) -> bool:
        """Whether each output has its own standard deviation."""
        return isinstance(self.sd, np.ndarray)

    @property
    def notes(self) -> tuple[str, ...]:
        """Findings about the file and its times, one sentence each."""
        return self.origin.notes + (self.check.notes if self.check else ())

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults of the first output, found from its readings alone."""
        return usable(np.atleast_2d(self.y)[0])[1]

    @cached_property
    def bridges(self) -> Bridges:
        """Knowledge about the input in each gap."""
        gaps = np.zeros(0, dtype=np.int64) if self.check is None else self.check.gaps
        return bridged(self.t, self.u, gaps)

    @property
    def breaks(self) -> IntArray:
        """Samples after which the memory is unknown."""
        none = np.zeros(0, dtype=np.int64)
        return none if self.check is None else np.union1d(self.bridges.unknown, self.check.jumps)

    @property
    def of_memory(self) -> tuple[str, ...]:
        """Gaps after which the memory is known or unknown, in one sentence; empty without gaps."""
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
            said.append(
                f"in {_gaps(turned, count)} the input turned, at an extreme that follows from the "
                "steps beside it"
            )
        crossed = count - turned - unknown
        if crossed:
            where = f"{crossed} other{'s' if crossed > 1 else ''}" if said else _gaps(count, count)
            said.append(f"in {where} the input cannot have turned and the memory continues")
        return ("; ".join(said),)

    def left_out(self, *, dynamics: bool = False) -> tuple[str, ...]:
        """Number of rows that `with_known_memory` leaves out, reason and remedy; empty if none.

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
            "part without a gap (--record rows=A:B)"
            if dynamics
            else "if no row is missing there, read the record without time (--time none); if the "
            "input was saturated there, name a column of curves (--record curves=COLUMN)"
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
        """Number of measured rows that `with_known_memory` leaves out, and of all measured rows."""
        measured = np.isfinite(self.y)
        return int(np.count_nonzero(measured & ~self._known)), int(measured.sum())

    @cached_property
    def _known(self) -> BoolArray:
        """(T,) whether the memory is known."""
        return known_memory(self.u, self.breaks)

    def with_memory_reset(self) -> Record:
        """Return the record without its breaks, because each curve begins with a known memory."""
        if self.check is None:
            return self
        none = np.zeros(0, dtype=np.int64)
        return self.with_origin(check=replace(self.check, gaps=none, jumps=none, of_breaks=()))

    def with_known_memory(self) -> Record:
        """Return the record without outputs where gaps leave the memory unknown.

        If the input turned in a gap, the nearer of the rows beside the extreme gets the extreme as
        its input, and no output.
        """
        gaps = self.bridges
        if self._known.all() and not gaps.turned.any():
            return self
        u, y = self.u.copy(), np.where(self._known, self.y, np.nan)
        for after, extreme in zip(gaps.after[gaps.turned], gaps.u[gaps.turned], strict=True):
            row = after + int(abs(extreme - u[after + 1]) < abs(extreme - u[after]))
            u[row], y[row] = extreme, np.nan
        return self.replace(u=u, y=y)

    def evenly_sampled(self) -> Record:
        """Return the record at its usual interval, for a lag in rows, without labels.

        A record that would become more than four times as long is returned unchanged.
        """
        check = self.check
        if check is None or (not check.breaks.size and check.uneven == 0):
            return self
        duration = float(self.t[-1] - self.t[0])
        # Largest ratio of the lengths of a record after and before even sampling
        if duration > 4 * len(self) * check.interval:
            return self.with_known_memory()
        y = np.where(self._known, self.y, np.nan)
        measured = np.count_nonzero(np.isfinite(y))
        t, _, y = resample(self.t, self.u, y, check.interval, gap=_between_samples(check))
        if 2 * np.count_nonzero(np.isfinite(y)) < measured:  # read at single samples
            return self.with_known_memory()
        times, inputs, _ = self.bridges.inserted(self.t, self.u)
        rows = {"t": t, "u": np.interp(t, times, inputs), "y": y}
        sd = None if self.weighted else self.sd
        return self.replace(**rows, curves=None, groups=None, sd=sd, first=0, last=None)

    def without_lag(self, lag: float) -> Record:
        """Return the record with each output ``lag`` seconds after its input.

        Raises a `ParameterError` if the record has no time.

        Parameters
        ----------
        lag : float
            Lag in seconds, >= 0.
        """
        record, check = self.with_known_memory(), self.check
        if check is None:
            raise ParameterError(
                f"the lag is {lag:g} s and the record has no time; name its column (--time), or "
                "give the lag in rows"
            )
        y = delayed(record.t, record.y, lag, gap=_between_samples(check))
        return record.replace(y=y)

    @classmethod
    def joined(cls, records: Sequence[Record]) -> Record:
        """Join successive records on the same clock.

        Raises a `RecordError` if there are none, their channels differ, or time decreases.

        Parameters
        ----------
        records : sequence of Record
            In the order of their times.
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
        u, y, t = (
            np.concatenate([getattr(record, name) for record in records], axis=-1) for name in "uyt"
        )
        return cls(u, y, t, first.inputs, first.outputs, first.time)

    def to_csv(self, path: PathLike, *, force: bool = False) -> None:
        """Write the record as CSV: time, inputs, outputs, with name and unit as headers.

        The numbers in the file are exact: they are read as the same float64.

        Parameters
        ----------
        path : str or path
            The file.
        force : bool
            Whether an existing file may be replaced.
        """
        check_writable(path, force=force)
        header = [str(q) for q in (self.time, *self.inputs, *self.outputs)]
        table = np.vstack([self.t, self.u, self.y])
        rows = zip(*(row.tolist() for row in table), strict=True)
        write_atomically(path, table_text(header, rows))

    def _check(self) -> None:
        if self.t.ndim != 1 or self.t.size == 0:
            raise RecordError(
                f"the record has times of shape {self.t.shape}; give inputs and outputs (T,) of at "
                "least one sample"
            )
        if self.u.ndim == self.y.ndim == 1 and self.u.size != self.y.size:
            raise RecordError(
                f"u has {self.u.size} samples and y has {self.y.size}; give one output "
                "for every input, NaN if not measured"
            )
        for name, values, names in (("u", self.u, self.inputs), ("y", self.y, self.outputs)):
            channels = 1 if values.ndim == 1 else values.shape[0]
            if values.shape[-1] != self.t.size:
                shape = f", of shape {values.shape}; give (channels, T)" * (values.ndim > 1)
                raise RecordError(
                    f"{name} has {values.shape[-1]} samples and t has {self.t.size}{shape}"
                )
            if channels != len(names):
                raise RecordError(
                    f"{name} has {channels} channels and {len(names)} names; give a name for each "
                    "row, or one channel of shape (T,)"
                )
        end = len(self) if self.last is None else self.last
        if not 0 <= self.first < end <= len(self):
            raise ParameterError(
                f"rows {self.first} to {self.last} are given, and there are {len(self)}; give two "
                f"numbers from 0 to {len(self)}, the first below the last"
            )
        if (np.diff(self.t) < 0).any():
            check = check_times(self.t, name=f"column '{self.time}'", unit=self.time.unit)
            origin = replace(self.origin, check=with_lost_rows(check, self.u))
            object.__setattr__(self, "t", frozen(check.t))
            object.__setattr__(self, "origin", origin)


def _samples(values: npt.ArrayLike, name: str, *, gaps: bool = False) -> Samples:
    try:
        return as_samples(values, name=name, gaps=gaps)
    except SignalError as error:
        raise RecordError(str(error)) from None


def _quantities(names: str | Quantity | Sequence[str | Quantity]) -> tuple[Quantity, ...]:
    each = (names,) if isinstance(names, str | Quantity) else tuple(names)
    return tuple(Quantity.parse(name) if isinstance(name, str) else name for name in each)


def _named(values: object, default: str) -> Quantity:
    """Return name and unit of a column of a data frame or of xarray; arrays have none."""
    name = getattr(values, "name", None)
    if not isinstance(name, str) or not name:
        return Quantity(default)
    unit = getattr(values, "attrs", {}).get("units", "")
    return Quantity(name, unit) if unit else Quantity.parse(name)


def _clock(t: npt.ArrayLike) -> tuple[FloatArray, Quantity]:
    """Return times in seconds, and their name; a column may have another unit.

    Raises a `RecordError` if this is not a unit of time.
    """
    times, clock = _samples(t, "t"), _named(t, "time")
    if clock.unit not in SECONDS:
        units = ", ".join(unit for unit in SECONDS if unit and unit.isascii())
        raise RecordError(f"time '{clock}' must be in one of {units}")
    return times * SECONDS[clock.unit], Quantity(clock.name, "s")


def _between_samples(check: TimeCheck) -> float:
    """Return the longest step across which an output may be interpolated, in seconds."""
    shortest = float(np.diff(check.t)[check.gaps].min(initial=np.inf))
    return min(GAP * check.interval, (1 - UNEVEN) * shortest)


def _gaps(some: int, count: int) -> str:
    """Return a number of gaps in words: the only gap, all gaps, or some of them."""
    if some < count:
        return f"{some} of {count} gaps"
    return "the gap" if count == 1 else "all gaps"
