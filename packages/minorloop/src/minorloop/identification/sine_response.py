"""Frequency response from measured sines: of the actuator, and behind an identified operator.

Gain and phase are those of the fundamental components. Before the operator they are from the input
u to the output y; after it from w, the output of the operator for u, to y. If the actuator is an
operator followed by linear dynamics, gains after the operator do not depend on the amplitude (Chen,
Tan and Shahinpoor 2005, section V).
"""

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_pair, as_samples, as_times
from minorloop.errors import ParameterError, RecordError, SignalError
from minorloop.files import PathLike
from minorloop.identification.frequency import (
    FrequencyResponse,
    SinePeriods,
    fundamental_of_sine,
    response_of,
)
from minorloop.lab._store_file import is_store
from minorloop.lab.columns import read_headers
from minorloop.lab.conversion import read_column
from minorloop.lab.logs import AUTO, read_log
from minorloop.lab.records import Record
from minorloop.lab.run import measured_sines
from minorloop.lab.sines import FEWEST_SAMPLES, HELD, SLOW, MeasuredSine, Sine, grid
from minorloop.lab.store import Store
from minorloop.modelfile import ModelFile
from minorloop.operators.operator import Operator

Drive: TypeAlias = Callable[[FloatArray, FloatArray], Record]
"""Drives a plant with inputs u at times t, linear between them, and returns its record."""


@dataclass(frozen=True)
class Preamble:
    """Inputs before every sine, which bring plant and operator to the same memory."""

    input: float
    """Input that saturates the plant, or wipes out its memory."""
    hold: float
    """Seconds for which this input is held, and then the bias."""
    bias: float = 0.0
    """Mean of the sine."""


def frequency_response(
    drive: Drive,
    frequencies: npt.ArrayLike,
    amplitudes: npt.ArrayLike,
    *,
    preamble: Preamble,
    settling: float,
    operator: Operator | None = None,
) -> FrequencyResponse:
    """Measure gains of the fundamental component.

    At each frequency and amplitude the plant gets the preamble, the bias, and then a sine about the
    bias. After ``settling`` seconds and at least three whole periods, two more are measured. The
    operator gets the same input as the plant.

    Raises a `ParameterError` if a frequency, amplitude or option is out of its range; a
    `SignalError` if the record is too short, or the input does not oscillate.

    Parameters
    ----------
    drive : callable
        ``drive(t, u)`` drives the plant with inputs u (T,) at times t (T,) in seconds, linear
        between them, and returns a `Record` of that duration.
    frequencies : (F,) array_like
        Frequencies in Hz.
    amplitudes : (A,) array_like
        Amplitudes of the input, in its unit.
    preamble : Preamble
        Inputs that bring plant and operator to the same memory, and the mean of the input.
    settling : float
        Seconds before the measured periods; five of the slowest time constants are enough.
    operator : Operator, optional
        Model of the hysteresis that comes before the dynamics.
    """
    before: dict[str, Any] = {
        "preamble": preamble.input,
        "hold": preamble.hold,
        "offset": preamble.bias,
    }
    rows = [
        [
            measured_periods(_driven(drive, sine), operator)
            for sine in grid(frequencies, amplitude, settling=settling, **before)
        ]
        for amplitude in np.atleast_1d(amplitudes)
    ]
    return response_of(rows, np.atleast_1d(frequencies), np.atleast_1d(amplitudes), preamble.bias)


def _driven(drive: Drive, sine: Sine) -> MeasuredSine:
    """Drive a plant with a sine and the inputs before it, and interpolate the record."""
    # Duration of a change of the input in the preamble, in seconds
    begin = np.array([0.0, sine.hold - min(1e-3, sine.hold / 2), sine.hold, 2 * sine.hold])
    t = np.append(begin, begin[-1] + sine.interval * np.arange(1, sine.count + 1))
    before = np.repeat([sine.preamble, sine.offset], 2)
    record = drive(t, np.concatenate([before, sine.inputs]))
    if record.u.ndim != 1 or record.y.ndim != 1:
        raise SignalError(
            "the plant has several channels; give a drive that records one input and one output"
        )
    clock = record.t - record.t[0]
    if clock[-1] < t[-2] or np.isnan(record.y).any():
        raise SignalError(
            f"the record lasts {clock[-1]:g} s and has {np.isnan(record.y).sum()} gaps; "
            f"{t[-1]:g} s without gaps are needed"
        )
    u, y = (np.interp(t[begin.size :], clock, x) for x in (record.u, record.y))
    return MeasuredSine(sine, u, y, held=False)


def measured_periods(one: MeasuredSine, operator: Operator | None = None) -> SinePeriods:
    """Return the measured periods of a sine of an experiment store.

    ``one``: the sine and its samples; ``operator``: model of the hysteresis; it gets all inputs
    since the preamble.
    """
    sine = one.sine
    count = sine.measured * sine.samples
    w = None
    if operator is not None:
        inputs = np.concatenate([one.before, one.u])
        w = operator.simulate(inputs, _side(sine.preamble, sine.offset))[-count:]
    u, y = one.u[-count:], one.y[-count:]
    about = sine.frequency, sine.amplitude, sine.offset, sine.measured
    return SinePeriods(*about, u, y, w, one.held)


def logged_periods(
    t: Any,
    u: Any,
    y: Any,
    frequency: Any,
    operator: Operator | None = None,
    *,
    periods: int = 2,
    held: Any = None,
) -> list[SinePeriods]:
    """Return the last whole periods of each sine in a log.

    Successive rows of one frequency are a sine. Rows of frequency 0 come before a sine, such as a
    saturating input; they drive the memory of the operator.

    Raises a `ParameterError` if ``periods`` is too small; a `SignalError` if there is no sine, a
    sine is shorter than the periods, or has too few samples or gaps.

    Parameters
    ----------
    t : (T,) array_like
        Times in seconds, increasing.
    u, y : (T,) array_like
        Inputs and outputs.
    frequency : (T,) array_like
        Frequency of the sine in each row, in Hz; 0 between sines.
    operator : Operator, optional
        Model of the hysteresis.
    periods : int
        Periods to use at the end of each sine, at least 2.
    held : (T,) array_like of bool, optional
        Whether the input of a row was held from the previous row until its output was read, as a
        bench does; by default inputs change linearly.
    """
    times, (inputs, outputs) = as_times(t), as_pair(u, y)
    hertz = as_samples(frequency, name="frequency")
    if inputs.shape != times.shape or hertz.shape != times.shape:
        raise SignalError("time, input, output and frequency differ in length; give one row each")
    holds = np.zeros(times.size) if held is None else as_samples(held, name="held")
    if holds.shape != times.shape or not np.isin(holds, (0, 1)).all():
        raise SignalError("held must have one row for each time, 1 where the input is held or 0")
    if periods < 2:
        raise ParameterError(f"periods is {periods}; give at least 2")
    edges = np.flatnonzero(np.diff(hertz)) + 1
    found: list[SinePeriods] = []
    since = 0
    for first, end in zip([0, *edges], [*edges, hertz.size], strict=True):
        if hertz[first] > 0:
            part = slice(since, end)
            w = None
            if operator is not None:
                begin = inputs[since]
                w = operator.simulate(inputs[part], _side(begin, float(inputs[first:end].mean())))
            rows = slice(first, end)
            tail = None if w is None else w[first - since :]
            log = times[rows], inputs[rows], outputs[rows], tail
            stepped = bool(holds[rows].all())
            found.append(_last_periods(log, float(hertz[first]), periods, len(found) + 1, stepped))
            # If no rows precede the next sine, this sine drives its memory.
            since = end if end < hertz.size and hertz[end] <= 0 else since
    if not found:
        raise SignalError("the log has no row with a positive frequency; there is no sine in it")
    return found


def at_every_amplitude(
    frequencies: Sequence[float], amplitudes: Sequence[float]
) -> tuple[list[float], str]:
    """Return the frequencies that sines have at every amplitude, and a note about the others.

    The frequencies increase; the note names the other frequencies, and is empty if there are none.

    Raises a `SignalError` if there is no such frequency.

    ``frequencies`` and ``amplitudes`` (N,): frequency in Hz and amplitude of each sine.
    """
    levels, place = _grouped(amplitudes)
    known = set(zip(place, frequencies, strict=True))
    every = sorted(set(frequencies))
    complete = [f for f in every if all((i, f) in known for i in range(len(levels)))]
    if not complete:
        shown = ", ".join(f"{level:g}" for level in levels[:4])
        more = ", ..." if len(levels) > 4 else ""
        raise SignalError(
            f"no frequency is measured at all of the {len(levels)} amplitudes ({shown}{more}), so "
            "no gains can be compared; give each frequency the same amplitudes, or make a separate "
            "run for each amplitude"
        )
    left = ", ".join(f"{f:g}" for f in every if f not in complete)
    return complete, f"{left} Hz left out: not measured at every amplitude" if left else ""


def sine_response(sines: Sequence[SinePeriods]) -> FrequencyResponse:
    """Return gains at the frequencies that were measured at every amplitude.

    Raises a `SignalError` if no frequency was measured at every amplitude, or a sine does not
    oscillate.

    ``sines``: sines, in any order; the last of several with one frequency and amplitude is used.
    """
    if not sines:
        raise SignalError("no sine is finished yet; resume the run first")
    amplitudes, place = _grouped([sine.amplitude for sine in sines])
    table = {(place[k], sine.frequency): sine for k, sine in enumerate(sines)}
    complete, left = at_every_amplitude(
        [sine.frequency for sine in sines], [sine.amplitude for sine in sines]
    )
    notes = [left] if left else []
    offsets = [sine.offset for sine in sines]
    if np.ptp(offsets) > 0.05 * max(amplitudes):
        notes.append(
            f"the offsets differ, from {min(offsets):.4g} to {max(offsets):.4g}; gains at "
            "different offsets cannot be compared"
        )
    grid = [[table[i, f] for f in complete] for i in range(len(amplitudes))]
    return response_of(grid, complete, amplitudes, float(np.mean(offsets)), notes)


def _last_periods(
    log: tuple[FloatArray, FloatArray, FloatArray, FloatArray | None],
    frequency: float,
    periods: int,
    number: int,
    held: bool,
) -> SinePeriods:
    """Return the last periods of a sine at evenly spaced times; held inputs stay held."""
    t, u, y, w = log
    step = float(np.median(np.diff(t))) if t.size > 1 else np.inf
    known = (float(t[-1] - t[0]) + min(step, 1 / frequency)) * frequency
    named = f"sine {number} ({frequency:g} Hz)"
    if known < periods * (1 - 1e-9):
        raise SignalError(
            f"{named} lasts {known:.3g} periods and {periods} whole periods are needed; record it "
            "for longer"
        )
    if step * frequency > (1 + 1e-6) / FEWEST_SAMPLES:
        raise SignalError(
            f"{named} has {1 / (step * frequency):.3g} samples in a period; give at least "
            f"{FEWEST_SAMPLES}"
        )
    samples = round(1 / (step * frequency))
    if not held:  # held inputs keep their samples: fewer would be held for longer
        # Most samples of a period after interpolation of a log
        samples = min(samples, 4096)
    places = t[-1] - np.arange(periods * samples)[::-1] / (samples * frequency)
    if np.isnan(y[t >= places[0]]).any():
        raise SignalError(f"{named} has gaps in its last {periods} periods; record it again")
    # Share of an interval by which times of a log may be rounded
    ends = np.searchsorted(t, places - 1e-3 * step)  # rows at the ends of the holds

    def even(x: FloatArray) -> FloatArray:
        return np.asarray(x[ends] if held else np.interp(places, t, x))

    even_u, even_w = even(u), None if w is None else even(w)
    swing = abs(fundamental_of_sine(even_u, periods))
    about = frequency, swing, float(even_u.mean()), periods
    return SinePeriods(*about, even_u, np.interp(places, t, y), even_w, held)


def _grouped(values: Sequence[float]) -> tuple[list[float], list[int]]:
    """Return the different amplitudes in order, and the place of each value among them."""
    groups: list[list[int]] = []
    for k in np.argsort(values, kind="stable").tolist():
        # Amplitudes of a log whose ratio is below this count as one
        if groups and values[k] < 1.05 * values[groups[-1][0]]:
            groups[-1].append(k)
        else:
            groups.append([k])
    place = {k: i for i, group in enumerate(groups) for k in group}
    levels = [float(np.median([values[k] for k in group])) for group in groups]
    return levels, [place[k] for k in range(len(values))]


def _side(preamble: float, offset: float) -> str:
    """Return the start of the operator's memory after a saturating input."""
    return "negative" if preamble <= offset else "positive"


def _findings(operator: Any, measured: Sequence[MeasuredSine]) -> Iterator[str]:
    """Yield notes on a preamble that does not saturate the operator, and on a slow bench.

    Only an operator with ``levels`` is checked.
    """
    levels = getattr(operator, "levels", None)
    for preamble in (one.sine.preamble for one in measured):
        if levels is not None and levels[0] < preamble < levels[-1]:
            yield (
                f"the preamble of {preamble:g} does not saturate the model, whose levels reach "
                f"from {levels[0]:g} to {levels[-1]:g}; it does not wipe out earlier memory"
            )
            break
    slowest = max((one.slow for one in measured), default=1.0)
    if slowest > SLOW:
        yield (
            f"the bench took up to {slowest - 1:.1%} longer than planned, so frequencies are lower "
            "by this share; give it a slower tick"
        )


def response_of_file(
    path: PathLike,
    model: ModelFile | None = None,
    *,
    input: str | None = None,
    output: str | None = None,
    time: str | None = AUTO,
    frequency: str = "frequency",
    periods: int = 2,
    progress: Callable[[str], None] | None = None,
) -> FrequencyResponse:
    """Return gain and phase of the sines in an experiment store or a log.

    Raises a `RecordError` if the file or a column cannot be used; a `ParameterError` if columns are
    missing, or belong to no store, or units differ; a `SignalError` as of `sine_response`.

    Parameters
    ----------
    path : str or path
        The store; or a table with columns of time, input, output and frequency, and optionally
        ``input held``, 1 where the input was held since the row before.
    model : ModelFile, optional
        Model of the hysteresis, as `minorloop.modelfile.read` returns it.
    input, output, time : str
        Columns of a table, as of `minorloop.read`; none for a store.
    frequency : str
        Column of the frequency in Hz, 0 in rows outside sines.
    periods : int
        Periods of a table to evaluate at the end of each sine.
    progress : callable, optional
        Called with the share that has been read, as text.

    """
    operator: Any = None if model is None else model.operator
    measured: list[MeasuredSine] = []
    if is_store(path):
        if (input, output) != (None, None) or time not in (AUTO, None):
            raise ParameterError(
                f"{path} is an experiment store, which has one input and one output; leave "
                "input, output and time out"
            )
        with Store.open(path) as store:
            measured = measured_sines(store)
            names = store.setup.input, store.setup.output
        sines = [measured_periods(one, operator) for one in measured]
    else:
        if not os.path.exists(path):
            raise RecordError(f"{path} does not exist; give an experiment store or a CSV file")
        if input is None or output is None:
            missing = "input (--input)" if input is None else "output (--output)"
            raise ParameterError(f"{missing} is missing; name a column of {path}")
        record = read_log(path, input=input, output=output, time=time, sd=None, progress=progress)
        if record.origin.why_untimed:
            raise RecordError(record.origin.why_untimed)
        hertz = read_column(path, frequency, "Hz", "frequencies are")
        held = read_column(path, HELD) if HELD in read_headers(path) else None
        if not record.timed:
            raise ParameterError(f"{path} has no column of time; name it with time= (--time)")
        log = record.t, record.u, record.y, hertz
        sines = logged_periods(*log, operator, periods=periods, held=held)
        names = str(record.input), str(record.output)
    if model is not None:
        model.check_units(names, "the sines")
    response = sine_response(sines)
    notes = (*response.notes, *_findings(operator, measured))
    return replace(response, names=names, notes=notes)
