"""A plan of sines: frequencies and amplitudes to measure the frequency response of an actuator.

Each sine begins with an input that saturates the actuator, so that its memory is known. Then the
offset is held, and the sine follows about the offset: first the periods that are discarded, then
those that are measured.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples
from minorloop.errors import ParameterError, RecordError
from minorloop.files import PathLike, check_name, check_writable, table_text, write_atomically
from minorloop.lab.columns import opened, read_headers
from minorloop.lab.headers import split_header
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity

__all__ = ["FEWEST_SAMPLES", "Sine", "SinePlan", "is_sine_plan"]

FEWEST_SAMPLES = 20
"""Least samples of a period: the correction for held inputs is then below 10 degrees."""
FEWEST_PERIODS = 3
"""Periods that are discarded at least in a new plan."""
MAX_SINES = 10_000
"""Most sines of a plan."""
MAX_SAMPLES = 2_000_000
"""Most samples of a sine."""
_WHOLE = 1e-6
"""Largest relative distance of a number of ticks from a whole number, because of rounding."""


@dataclass(frozen=True)
class Sine:
    """One sine with the inputs before it.

    Raises
    ------
    ParameterError
        If a number is out of range, or not whole where it must be.
    """

    frequency: float
    """In Hz."""
    amplitude: float
    offset: float
    """``amplitude`` and ``offset``: amplitude and mean of the sine, in the unit of the input."""
    preamble: float
    """Input that saturates the actuator before the sine, in the same unit."""
    hold: float
    """Seconds for which the preamble is held, and then the offset."""
    discarded: int
    measured: int
    """``discarded`` and ``measured``: periods that are applied but not evaluated, and periods that
    are."""
    samples: int
    """Samples of a period."""

    def __post_init__(self) -> None:
        for name in ("frequency", "amplitude", "hold"):
            if as_finite(name, getattr(self, name)) <= 0:
                raise ParameterError(f"{name} is {getattr(self, name):g}; give a positive number")
        for name in ("offset", "preamble"):
            as_finite(name, getattr(self, name))
        for name, what, fewest in (
            ("discarded", "discarded periods", 0),
            ("measured", "measured periods", 2),
            ("samples", "samples per period", FEWEST_SAMPLES),
        ):
            value = getattr(self, name)
            if not float(value).is_integer() or value < fewest:
                raise ParameterError(
                    f"{what} are {value:g}; give a whole number of at least {fewest}"
                )
            object.__setattr__(self, name, int(value))
        if self.count > MAX_SAMPLES:
            raise ParameterError(
                f"a sine of {self.frequency:g} Hz has {self.count} samples, more than "
                f"{MAX_SAMPLES}; discard fewer periods or sample less often"
            )

    @property
    def count(self) -> int:
        """Number of samples, those of discarded periods included."""
        return (self.discarded + self.measured) * self.samples

    @property
    def interval(self) -> float:
        """Seconds between samples."""
        return 1 / (self.frequency * self.samples)

    @property
    def length(self) -> float:
        """Seconds from the first to the last period, without the inputs before."""
        return (self.discarded + self.measured) / self.frequency

    @property
    def duration(self) -> float:
        """Seconds in all."""
        return 2 * self.hold + self.length

    @property
    def inputs(self) -> FloatArray:
        """Inputs of the samples, (count,)."""
        phase = np.arange(1, self.samples + 1) / self.samples
        period = self.offset + self.amplitude * np.sin(2 * np.pi * phase)
        return np.tile(period, self.discarded + self.measured)

    def ticks(self, tick: float) -> int:
        """Return how many ticks of an actuator a sample takes.

        Raises a `ParameterError` if the tick is too slow, or a sample does not take a whole number
        of ticks.

        Parameters
        ----------
        tick : float
            How long an exchange of the actuator takes, in seconds.
        """
        exact = self.interval / tick
        if exact < 1 - _WHOLE:
            raise ParameterError(
                f"a tick of {tick:g} s is too slow for {self.samples} samples in a period of "
                f"{1 / self.frequency:g} s; plan the sines with --tick {tick:g}, or a lower "
                "frequency"
            )
        if abs(exact - round(exact)) > _WHOLE * exact:
            raise ParameterError(
                f"a period of {self.frequency:g} Hz with {self.samples} samples is "
                f"{exact * self.samples:.6g} ticks of {tick:g} s, and a sample must take a whole "
                f"number of ticks; plan the sines with --tick {tick:g}"
            )
        return round(exact)

    def on_ticks(self, tick: float) -> Sine:
        """Return the sine of the nearest frequency whose samples take whole numbers of ticks.

        The tick is as of `ticks`. Raises a `ParameterError` if it is too slow for the frequency.
        """
        period = round(1 / (self.frequency * tick))
        if period < FEWEST_SAMPLES:
            raise ParameterError(
                f"a tick of {tick:g} s is too slow for {self.frequency:g} Hz: a period needs "
                f"{FEWEST_SAMPLES} ticks; give up to {1 / (FEWEST_SAMPLES * tick):.3g} Hz, or a "
                "faster tick"
            )
        each = max(1, round(period / self.samples))
        samples = round(period / each)
        known = asdict(self) | {"samples": samples, "frequency": 1 / (samples * each * tick)}
        return Sine(**known)


_HEADERS = {
    "frequency": "frequency [Hz]",
    "amplitude": "{name} amplitude{unit}",
    "offset": "{name} offset{unit}",
    "preamble": "{name} preamble{unit}",
    "hold": "preamble hold [s]",
    "discarded": "discarded periods",
    "measured": "measured periods",
    "samples": "samples per period",
}
_AMPLITUDE = " amplitude"


@dataclass(frozen=True)
class SinePlan:
    """Sines to apply one after the other.

    Raises
    ------
    ParameterError
        If there are none, or too many.
    """

    sines: tuple[Sine, ...]
    """The sines, in order."""
    input: Quantity
    """Name and unit of the input."""

    def __post_init__(self) -> None:
        if not 0 < len(self.sines) <= MAX_SINES:
            raise ParameterError(f"there are {len(self.sines)} sines; give 1 to {MAX_SINES}")

    def __len__(self) -> int:
        return len(self.sines)

    def __iter__(self) -> Iterator[Sine]:
        return iter(self.sines)

    @property
    def duration(self) -> float:
        """Seconds in all."""
        return sum(sine.duration for sine in self.sines)

    @classmethod
    def grid(
        cls,
        frequencies: npt.ArrayLike,
        amplitudes: npt.ArrayLike,
        *,
        preamble: float,
        hold: float,
        settling: float = 0.0,
        offset: float = 0.0,
        measured: int = 2,
        samples: int = 240,
        tick: float | None = None,
        input: str | Quantity = "input",
    ) -> SinePlan:
        """Return a plan with every frequency at every amplitude.

        Raises a `ParameterError` if a number is out of range, or the tick is too slow for a
        frequency.

        Parameters
        ----------
        frequencies : (F,) array_like
            In Hz.
        amplitudes : (A,) array_like
            Amplitudes, in the unit of the input.
        preamble : float
            Input that saturates the actuator, before each sine.
        hold : float
            Seconds for which the preamble is held, and then the offset.
        settling : float
            Seconds of the sine that are discarded, rounded up to whole periods; three at least.
        offset : float
            Mean of the sines.
        measured : int
            Periods that are measured, 2 at least.
        samples : int
            Samples of a period; with ``tick`` as many as are possible.
        tick : float, optional
            How long an exchange of the actuator takes, in seconds. Frequencies are rounded so that
            each sample takes a whole number of ticks.
        input : str or Quantity
            Name and unit of the input, such as ``voltage [V]``.
        """
        if as_finite("settling", settling) < 0:
            raise ParameterError(f"settling is {settling:g} s; give a time >= 0")
        if tick is not None and as_finite("tick", tick) <= 0:
            raise ParameterError(f"tick is {tick:g} s; give a positive time")
        found = []
        for frequency in _all_positive("frequencies", frequencies):
            discarded = max(FEWEST_PERIODS, int(np.ceil(min(settling * frequency, MAX_SAMPLES))))
            for amplitude in _all_positive("amplitudes", amplitudes):
                levels = float(amplitude), float(offset), float(preamble)
                sine = Sine(float(frequency), *levels, hold, discarded, measured, samples)
                found.append(sine if tick is None else sine.on_ticks(tick))
        return cls(tuple(found), Quantity.parse(str(input)))

    @classmethod
    def from_csv(cls, path: PathLike) -> SinePlan:
        """Read a plan from a CSV file, as ``minorloop plan sines --save`` writes it.

        Raises a `RecordError` if the file or a column in it cannot be used; a `ParameterError` if a
        number is out of range.
        """
        with opened(path) as table:
            input = _input_of(table.headers)
            if input is None:
                raise RecordError(f"{path} has no column of an amplitude; plan sines writes one")
            columns = table.read(list(_headers(input).values()))
        rows = zip(*(values.tolist() for values in columns.values()), strict=True)
        found = []
        for number, row in enumerate(rows, 1):
            try:
                found.append(Sine(*row))
            except ParameterError as error:
                raise ParameterError(f"sine {number} of {path}: {error}") from None
        return cls(tuple(found), input)

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of the CSV file, by their headers."""
        return {
            header: [getattr(sine, name) for sine in self.sines]
            for name, header in _headers(self.input).items()
        }

    def to_csv(self, path: PathLike, *, force: bool = False) -> None:
        """Write the plan as CSV."""
        check_writable(path, force=force)
        columns = self.columns()
        write_atomically(path, table_text(columns, zip(*columns.values(), strict=True)))

    def to_dict(self) -> dict[str, Any]:
        """Return the plan, ready for JSON."""
        return {"input": str(self.input), "sines": [asdict(sine) for sine in self.sines]}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> SinePlan:
        """Return the plan that ``to_dict`` gave.

        Raises a `ParameterError` if it is not such a plan.
        """
        try:
            sines = tuple(Sine(**sine) for sine in content["sines"])
            return cls(sines, Quantity.parse(content["input"]))
        except (KeyError, TypeError, ValueError) as error:
            raise ParameterError(f"that is not a plan of sines: {error}") from None

    def holds(self) -> Plan:
        """Return the plan of an experiment store: one level for each sine, its offset."""
        longest = [sine.duration for sine in self.sines]
        settings = {"window": min(longest), "sample_interval": min(longest) / 10}
        return Plan([s.offset for s in self.sines], longest, input=self.input, **settings)


def is_sine_plan(path: PathLike) -> bool:
    """Whether the headers of a file are those of a plan of sines.

    Raises a `RecordError` if the file cannot be read.
    """
    headers = read_headers(path)
    return _HEADERS["frequency"] in headers and _input_of(headers) is not None


def _headers(input: Quantity) -> dict[str, str]:
    """Return the headers of the columns, by the names of the fields of a sine."""
    unit = f" [{input.unit}]" if input.unit else ""
    named = {"name": check_name("the input", input.name), "unit": unit}
    return {field.name: _HEADERS[field.name].format(**named) for field in fields(Sine)}


def _input_of(headers: list[str]) -> Quantity | None:
    """Return the input from the header of its amplitude; None if there is none."""
    for header in headers:
        name, unit = split_header(header)
        if name.endswith(_AMPLITUDE):
            return Quantity(name.removesuffix(_AMPLITUDE), unit)
    return None


def _all_positive(name: str, values: npt.ArrayLike) -> FloatArray:
    numbers = as_samples(np.atleast_1d(values), name=name)
    if numbers.ndim != 1 or not numbers.size or not (numbers > 0).all():
        raise ParameterError(f"{name} are {values!r}; give positive numbers")
    return numbers
