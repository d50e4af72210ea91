"""Sines of a plan, which measure the frequency response of an actuator.

Each sine begins with an input that saturates the actuator, so that its memory is known. Then the
offset is held, and the sine follows about the offset: first the discarded, then the measured
periods. A simulated actuator gets each sine as a waveform, linear between samples. A bench gets it
sample by sample: an input is held for a whole number of ticks, and the output is read at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_samples
from minorloop.errors import ParameterError
from minorloop.files import PathLike, check_name
from minorloop.lab.actuator import Actuator
from minorloop.lab.headers import split_header
from minorloop.lab.records import Quantity, Record
from minorloop.lab.tables import OpenTable

HELD = "input held"
"""Column that is 1 if the input of a row was held from the previous row, and 0 if it is linear."""
FEWEST_SAMPLES = 20
"""Least samples of a period: the correction for held inputs is then below 10 degrees."""
_MAX_SAMPLES = 2_000_000
"""Most samples of a sine."""
SLOW = 1.01
"""Ratio of real to planned duration of a sine above which the bench was too slow."""
_WHOLE = 1e-6
"""Largest relative distance of a number of ticks from a whole number by rounding."""


@runtime_checkable
class Driven(Protocol):
    """A plant to which a whole waveform can be applied, such as a twin."""

    def drive(self, t: npt.ArrayLike, u: npt.ArrayLike) -> Record:
        """Apply a waveform, linear between samples, and record input and output."""


@dataclass(frozen=True)
class Sine:
    """One sine with the inputs before it.

    Raises a `ParameterError` if a number is out of range, or must be whole and is not.
    """

    frequency: float
    """Frequency in Hz."""
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
    are evaluated."""
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
        if self.count > _MAX_SAMPLES:
            raise ParameterError(
                f"a sine of {self.frequency:g} Hz has {self.count} samples, more than "
                f"{_MAX_SAMPLES}; discard fewer periods or sample less often"
            )

    @property
    def count(self) -> int:
        """Number of samples, also of discarded periods."""
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
        """Seconds of the sine and of the inputs before it."""
        return 2 * self.hold + self.length

    @property
    def inputs(self) -> FloatArray:
        """Inputs of the samples, (count,)."""
        phase = np.arange(1, self.samples + 1) / self.samples
        period = self.offset + self.amplitude * np.sin(2 * np.pi * phase)
        return np.tile(period, self.discarded + self.measured)

    def ticks(self, tick: float) -> int:
        """Return the number of ticks of an actuator in a sample.

        Raises a `ParameterError` if the tick is too slow, or a sample does not take a whole number
        of ticks.

        ``tick``: duration of an exchange of the actuator, in seconds.
        """
        exact = self.interval / tick
        if exact < 1 - _WHOLE:
            raise ParameterError(
                f"a tick of {tick:g} s is too slow for {self.samples} samples in a period of "
                f"{1 / self.frequency:g} s; plan the sines with tick={tick:g}, or a lower "
                "frequency"
            )
        if abs(exact - round(exact)) > _WHOLE * exact:
            raise ParameterError(
                f"a period of {self.frequency:g} Hz with {self.samples} samples is "
                f"{exact * self.samples:.6g} ticks of {tick:g} s, and a sample must take a whole "
                f"number of ticks; plan the sines with tick={tick:g}"
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


def grid(
    frequencies: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    *,
    preamble: float,
    hold: float,
    settling: float = 0.0,
    tick: float | None = None,
    offset: float = 0.0,
    measured: int = 2,
    samples: int = 240,
) -> tuple[Sine, ...]:
    """Return every frequency at every amplitude.

    Raises a `ParameterError` if a number is out of range, or the tick is too slow for a frequency.

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
        Seconds of the sine to discard, rounded up to whole periods, at least three.
    tick : float, optional
        Duration of an exchange of the actuator, in seconds. Frequencies are rounded so that each
        sample takes a whole number of ticks.
    offset, measured, samples
        Fields of each `Sine`; with ``tick`` the largest possible number of samples.
    """
    if as_finite("settling", settling) < 0:
        raise ParameterError(f"settling is {settling:g} s; give a time >= 0")
    if tick is not None and as_finite("tick", tick) <= 0:
        raise ParameterError(f"tick is {tick:g} s; give a positive time")
    found = []
    for frequency in _all_positive("frequencies", frequencies):
        # Least discarded periods in a new plan
        discarded = max(3, int(np.ceil(min(settling * frequency, _MAX_SAMPLES))))
        for amplitude in _all_positive("amplitudes", amplitudes):
            sine = Sine(
                frequency=float(frequency),
                amplitude=float(amplitude),
                preamble=float(preamble),
                hold=hold,
                discarded=discarded,
                offset=offset,
                measured=measured,
                samples=samples,
            )
            found.append(sine if tick is None else sine.on_ticks(tick))
    return tuple(found)


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


def sine_columns(sines: tuple[Sine, ...], input: Quantity) -> dict[str, list[Any]]:
    """Return the columns of a CSV file, by their headers."""
    headers = _headers(input)
    return {headers[name]: [getattr(sine, name) for sine in sines] for name in headers}


def read_sines(table: OpenTable, path: PathLike) -> tuple[tuple[Sine, ...], Quantity] | None:
    """Return the sines of a file and their input; None if its headers are not those of sines.

    Raises a `RecordError` if a column cannot be used; a `ParameterError` if a number is out of
    range.
    """
    input = _input_of(table.headers)
    if input is None or _HEADERS["frequency"] not in table.headers:
        return None
    wanted = _headers(input)
    columns = table.read(list(wanted.values()))
    rows = zip(*(columns[header].tolist() for header in wanted.values()), strict=True)
    found = []
    for number, row in enumerate(rows, 1):
        try:
            found.append(Sine(*row))
        except ParameterError as error:
            raise ParameterError(f"sine {number} of {path}: {error}") from None
    return tuple(found), input


@dataclass(frozen=True, eq=False)
class MeasuredSine:
    """A sine and its measurement."""

    sine: Sine
    """The sine as planned."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (count,). Inputs and outputs of its samples."""
    held: bool
    """Whether inputs are held until their outputs are read; otherwise they change linearly."""
    slow: float = 1.0
    """Duration of the sine over the planned duration."""

    @property
    def before(self) -> FloatArray:
        """The inputs before the sine, which bring the actuator to a known memory."""
        return np.array([self.sine.preamble, self.sine.offset])


def sines_as_log(
    measured: Sequence[MeasuredSine], input: str, output: str
) -> dict[str, FloatArray]:
    """Return the samples of all sines as columns of a log; rows before a sine have frequency 0.

    ``input`` and ``output`` are their names and units.
    """
    rows, end = [], 0.0
    for one in measured:
        sine = one.sine
        begin = end + 2 * sine.hold
        t = begin + sine.interval * np.arange(1, sine.count + 1)
        before = np.array([end + sine.hold / 2, begin])
        held = float(one.held)
        rows.append((before, np.zeros(2), one.before, np.full(2, np.nan), np.full(2, held)))
        rows.append((t, np.full(t.size, sine.frequency), one.u, one.y, np.full(t.size, held)))
        end = float(t[-1])
    headers = ("time [s]", "frequency [Hz]", input, output, HELD)
    return dict(zip(headers, map(np.concatenate, zip(*rows, strict=True)), strict=True))


def apply_sine(
    actuator: Actuator, sine: Sine, watch: Callable[[float, float], None]
) -> tuple[float, FloatArray, FloatArray]:
    """Return the duration of a sine in seconds, and times and outputs of its samples (count,).

    Preamble and offset are held first. ``watch`` is called with time and output after each period.
    """
    for level in (sine.preamble, sine.offset):
        before = actuator.apply(level, sine.hold, sine.hold)
    if isinstance(actuator, Driven):
        times: FloatArray = sine.interval * np.arange(sine.count + 1, dtype=np.float64)
        record = actuator.drive(times, np.concatenate([[sine.offset], sine.inputs]))
        return sine.length, times[1:], np.asarray(record.y[1:])
    ticks = sine.ticks(actuator.tick)
    t: FloatArray = sine.interval * np.arange(1, sine.count + 1, dtype=np.float64)
    y = np.empty(sine.count)
    for k, u in enumerate(sine.inputs):
        for _ in range(ticks):
            y[k] = actuator.exchange(float(u))
        if (k + 1) % sine.samples == 0:
            watch(float(t[k]), float(y[k]))
    after = actuator.apply(sine.offset, actuator.tick, actuator.tick)
    if before.timing and after.timing:
        return after.timing.began - before.timing.ended, t, y
    return sine.length, t, y


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
