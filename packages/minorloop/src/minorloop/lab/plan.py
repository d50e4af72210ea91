"""A plan: inputs to apply, one segment after the other.

A segment is a level that is held until the output settles, or a sine with the inputs before it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples, frozen
from minorloop.errors import ParameterError, RecordError, SignalError, counted
from minorloop.files import PathLike, check_writable, first_difference, table_text, write_atomically
from minorloop.lab.actuator import rounded_up
from minorloop.lab.columns import opened
from minorloop.lab.headers import split_header
from minorloop.lab.records import Quantity
from minorloop.lab.sines import Sine, read_sines, sine_columns
from minorloop.lab.timebase import SECONDS
from minorloop.values import as_duration

_LONGEST = Quantity("hold", "s")
"""Header of the column of longest holds."""
_SHORTEST = Quantity("shortest hold", "s")
"""Header of the column of shortest holds."""
FEWEST = 4
"""Least samples of a window, for a slope and its uncertainty."""
_ENOUGH = 8
"""Least readings of a slow meter in a hold: fewer cannot distinguish movement from noise."""
_MAX_POINTS = 1_000_000
"""Most levels of a plan."""
_MAX_SAMPLES = 2_000_000
"""Most samples of a hold."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Inputs to hold one after the other, each until the output has settled; or sines.

    A level is held for at least ``shortest`` and at most ``longest``. Between these, the hold ends
    as soon as the slope of the output over the last ``window`` is known to be below ``tolerance``.

    Raises a `ParameterError` if the plan is empty, a number is out of range, or the times
    contradict each other.

    Parameters
    ----------
    inputs : (N,) array_like
        Levels of the input, in its unit; NaN for a level that is chosen during the run.
    longest : float or (N,) array_like
        Longest hold of each level, in seconds.
    shortest : float or (N,) array_like, optional
        Shortest hold of each level, in seconds; by default a quarter of the longest. An output that
        reverses looks settled at the reversal: hold longer than until then.
    window : float, optional
        Trailing time for the slope, in seconds; by default a tenth of the least of ``longest``.
    tolerance : float, optional
        Slope of a settled output, in the unit of the output per second. By default, it is the slope
        that moves the output in another hold by 0.2 % of the span of all outputs so far.
    sample_interval : float, optional
        Time between samples, in seconds; by default 1/200 of the least of ``longest``.
    input : str or Quantity
        Name and unit of the input, such as ``voltage [V]``.
    sines : sequence of Sine
        One sine for each level; the level is its offset, and the hold its duration; see `of_sines`.
        Empty in a plan of holds.

    Examples
    --------
    >>> len(ml.Plan([0.0, 1.0, 0.5], longest=60.0))
    3
    """

    inputs: FloatArray
    longest: FloatArray
    shortest: FloatArray
    window: float
    tolerance: float | None
    sample_interval: float
    input: Quantity
    sines: tuple[Sine, ...]

    def __init__(
        self,
        inputs: npt.ArrayLike,
        longest: npt.ArrayLike,
        shortest: npt.ArrayLike | None = None,
        *,
        window: float | None = None,
        tolerance: float | None = None,
        sample_interval: float | None = None,
        input: str | Quantity = "input",
        sines: Sequence[Sine] = (),
    ) -> None:
        u = _levels(inputs)
        most = _each("longest hold", longest, u.size)
        least = most / 4 if shortest is None else _each("shortest hold", shortest, u.size)
        brief = float(most.min())
        interval = brief / 200 if sample_interval is None else sample_interval
        interval = _positive("sample interval", interval)
        span = min(max(brief / 10, 10 * interval), brief) if window is None else window
        fields = {
            "inputs": frozen(u),
            "longest": frozen(most),
            "shortest": frozen(least),
            "window": _positive("window", span),
            "tolerance": None if tolerance is None else _positive("tolerance", tolerance),
            "sample_interval": interval,
            "input": Quantity.parse(str(input)),
            "sines": tuple(sines),
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)
        self._check()

    @classmethod
    def of_sines(cls, sines: Sequence[Sine], input: str | Quantity = "input") -> Plan:
        """Return a plan of sines.

        Raises a `ParameterError` if there are none, or too many.

        Parameters
        ----------
        sines : sequence of Sine
            Sines in order, such as those of `minorloop.lab.sines.grid`.
        input : str or Quantity
            Name and unit of the input, such as ``voltage [V]``.
        """
        durations = [sine.duration for sine in sines]
        brief = min(durations, default=1.0)
        settings: dict[str, Any] = {"window": brief, "sample_interval": brief / 10}
        offsets = [sine.offset for sine in sines]
        return cls(offsets, durations, input=input, sines=sines, **settings)

    def __len__(self) -> int:
        return int(self.inputs.size)

    @property
    def open(self) -> bool:
        """Whether the run chooses some levels."""
        return bool(np.isnan(self.inputs).any())

    def __str__(self) -> str:
        what = counted(len(self), "sine" if self.sines else "level")
        return f"{what} of {self.input}, {as_duration(self.duration)} at most"

    @property
    def duration(self) -> float:
        """Longest duration of the plan, in seconds."""
        return float(self.longest.sum())

    @classmethod
    def from_csv(cls, path: PathLike, *, input: str | None = None, **settings: Any) -> Plan:
        """Read a plan from a CSV file, as ``minorloop plan --save`` writes it.

        Raises a `RecordError` if the file or a column in it cannot be used; a `ParameterError` if a
        number is out of range.

        Parameters
        ----------
        path : str or path
            A file with a column ``hold [s]`` (or ms, min, h), optionally a column
            ``shortest hold [s]``, and one of the input; or one of sines.
        input : str, optional
            The column of the input; needed if there are several other columns.
        **settings
            ``window``, ``tolerance``, ``sample_interval``, and ``shortest`` in place of the column;
            None has no effect. A plan of sines has none of them.
        """
        settings = {name: value for name, value in settings.items() if value is not None}
        with opened(path) as table:
            headers = table.headers
            if table.above:
                raise RecordError(f"{path} does not begin with its headers; a plan has them first")
            if (found := read_sines(table, path)) is not None:
                for name in settings:
                    raise ParameterError(f"{name} is for plans of holds, and {path} has sines")
                return cls.of_sines(*found)
            hold, least = (_time_column(str(name), headers) for name in (_LONGEST, _SHORTEST))
            if hold is None:
                raise RecordError(
                    f"{path} has no column '{_LONGEST}'; a plan says how long to hold"
                )
            if input is None:
                others = [header for header in headers if header not in (hold, least)]
                if len(others) != 1:
                    shown = ", ".join(f"'{header}'" for header in others[:12]) or "none"
                    raise RecordError(
                        f"{path} has {len(others)} columns that could be the input ({shown}); name "
                        "one"
                    )
                input = others[0]
            header = table.find(input)
            wanted = [name for name in (header, hold, least) if name is not None]
            columns = table.read(wanted, gaps=(header,))
        if least is not None:
            settings.setdefault("shortest", _seconds(columns[least], least, path))
        longest = _seconds(columns[hold], hold, path)
        return cls(columns[header], longest, input=header, **settings)

    def to_csv(self, path: PathLike, *, force: bool = False) -> None:
        """Write sines, or inputs, longest and shortest holds, as CSV, as of `Record.to_csv`."""
        check_writable(path, force=force)
        columns: dict[str, list[Any]] = {
            str(self.input): self.inputs.tolist(),
            str(_LONGEST): self.longest.tolist(),
            str(_SHORTEST): self.shortest.tolist(),
        }
        if self.sines:
            columns = sine_columns(self.sines, self.input)
        write_atomically(path, table_text(columns, zip(*columns.values(), strict=True)))

    def to_json(self) -> str:
        """Return the whole plan as JSON; equal plans give equal text."""
        known: dict[str, Any] = {
            "input": str(self.input),
            "window": self.window,
            "tolerance": self.tolerance,
            "sample_interval": self.sample_interval,
            "inputs": [None if math.isnan(u) else u for u in self.inputs.tolist()],
            "longest": self.longest.tolist(),
            "shortest": self.shortest.tolist(),
        }
        sines = [asdict(sine) for sine in self.sines]
        return json.dumps({**known, "sines": sines} if sines else known)

    @classmethod
    def from_json(cls, text: str) -> Plan:
        """Return the plan that ``to_json`` wrote.

        Raises a `ParameterError` if the text is not a plan.

        Parameters
        ----------
        text : str
            The JSON text.
        """
        try:
            fields = json.loads(text)
            fields["inputs"] = [math.nan if u is None else u for u in fields["inputs"]]
            fields["sines"] = [Sine(**sine) for sine in fields.get("sines", ())]
            return cls(**fields)
        except (KeyError, TypeError, ValueError, RecursionError) as error:
            raise ParameterError(f"that is not a plan: {error}") from None

    def difference(self, other: Plan) -> str:
        """Return the first difference from another plan, in words; empty if there is none.

        Parameters
        ----------
        other : Plan
            The other plan.
        """
        return first_difference(json.loads(self.to_json()), json.loads(other.to_json()))

    def slowed(self, seconds: float) -> Plan:
        """Return the same plan with a sample interval and a window for a slow meter.

        It is this plan if the meter is fast enough, or too slow for any interval.

        Parameters
        ----------
        seconds : float
            How long the meter takes for one reading.
        """
        brief = float(self.longest.min())
        if self.sines or not self.sample_interval < seconds <= brief / (1.1 * _ENOUGH):
            return self
        interval = rounded_up(seconds)
        window = max(self.window, min(10 * interval, brief))
        return Plan(
            self.inputs,
            self.longest,
            self.shortest,
            window=window,
            tolerance=self.tolerance,
            sample_interval=interval,
            input=self.input,
        )

    def check_answers(self, seconds: float) -> None:
        """Refuse a plan that needs more readings than a meter can give.

        Raises a `ParameterError` if a hold or the window is too short for the readings that a
        verdict needs.

        Parameters
        ----------
        seconds : float
            How long the meter takes for one reading.
        """
        hold = float(self.longest.min())
        if min(self.window / FEWEST, hold / _ENOUGH) >= seconds * (1 - 1e-9):
            return
        interval = rounded_up(max(seconds, self.sample_interval))
        asked = ", as the plan asks (interval)" if self.sample_interval > seconds else ""
        raise ParameterError(
            f"the meter takes {seconds:.3g} s for an answer, and a verdict needs {_ENOUGH} of them "
            f"in a hold and {FEWEST} in the window: the plan has a hold of {hold:g} s and a window "
            f"of {self.window:g} s; the shortest hold possible is "
            f"{rounded_up(_ENOUGH * interval):g} s, with {interval:g} s between samples{asked}"
        )

    def _check(self) -> None:
        late = self.shortest > self.longest
        if late.any():
            i = int(np.argmax(late))
            raise ParameterError(
                f"level {i} is held {self.shortest[i]:g} s at least and {self.longest[i]:g} s at "
                "most; give a shortest hold that is no longer than the longest"
            )
        if self.window > self.longest.min():
            raise ParameterError(
                f"window is {self.window:g} s and a hold is {self.longest.min():g} s; "
                "give a window that fits into every hold"
            )
        if self.window < FEWEST * self.sample_interval * (1 - 1e-9):
            raise ParameterError(
                f"a window of {self.window:g} s holds fewer than {FEWEST} samples "
                f"{self.sample_interval:g} s apart; widen it or sample more often"
            )
        if self.longest.max() > _MAX_SAMPLES * self.sample_interval:
            raise ParameterError(
                f"a hold of {self.longest.max():g} s takes more than {_MAX_SAMPLES} samples "
                f"{self.sample_interval:g} s apart; sample less often"
            )


def _levels(inputs: npt.ArrayLike) -> FloatArray:
    try:
        levels = as_samples(inputs, name="inputs", gaps=True)
    except SignalError as error:
        raise ParameterError(str(error)) from None
    if levels.ndim != 1 or not 0 < levels.size <= _MAX_POINTS:
        raise ParameterError(
            f"inputs have shape {levels.shape}; a plan has (N,) levels of one input, "
            f"1 to {_MAX_POINTS} of them"
        )
    return levels + 0.0  # without negative zeros, which SQLite cannot store


def _each(name: str, times: npt.ArrayLike, count: int) -> FloatArray:
    """Return one time for each level, (count,)."""
    try:
        values = np.array(np.broadcast_to(np.asarray(times, dtype=np.float64), (count,)))
    except (TypeError, ValueError):
        raise ParameterError(
            f"{name} is {times!r}; give one number of seconds, or one for each of {count} levels"
        ) from None
    good = np.isfinite(values) & (values > 0)
    if not good.all():
        index = int(np.argmin(good))
        raise ParameterError(
            f"{name} {index} is {values[index]:g}; give a positive number of seconds"
        )
    return values


def _positive(name: str, value: float) -> float:
    number = as_finite(name, value)
    if number <= 0:
        raise ParameterError(f"{name} is {value}; give a positive number")
    return number


def _time_column(name: str, headers: list[str]) -> str | None:
    """Return the header of this time, with any unit."""
    wanted = split_header(name)[0]
    found = [header for header in headers if split_header(header)[0] == wanted]
    return name if name in headers else next(iter(found), None)


def _seconds(times: FloatArray, header: str, path: PathLike) -> FloatArray:
    unit = split_header(header)[1]
    if unit not in SECONDS:
        units = ", ".join(unit for unit in SECONDS if unit)
        raise RecordError(f"column '{header}' of {path} must be in one of {units}")
    with np.errstate(over="ignore"):  # infinite times are refused later
        return np.asarray(times * SECONDS[unit])
