"""Frequency response from measured sines: of the actuator, and behind an identified operator.

Gain and phase are those of the fundamental components. Before the operator they are from the input
u to the output y; after it from w, the output of the operator for u, to y. If the actuator is an
operator followed by linear dynamics, the latter do not depend on the amplitude (Chen, Tan and
Shahinpoor 2005, section V).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.arrays import FloatArray, as_pair, as_samples, as_times
from minorloop.errors import ParameterError, SignalError
from minorloop.identification.frequency import (
    FrequencyResponse,
    SinePeriods,
    fundamental_of_sine,
    response_of,
)
from minorloop.operators.operator import Operator

if TYPE_CHECKING:
    from minorloop.lab.sines import MeasuredSine

__all__ = [
    "SinePeriods",
    "at_every_amplitude",
    "logged_periods",
    "measured_periods",
    "sine_response",
]

FEWEST_SAMPLES = 20
"""Least samples of a period in a log."""
_MOST_SAMPLES = 4096
"""Most samples of a period to which a log is interpolated."""
_ROUNDING = 1e-3
"""Share of an interval by which times of a log may be rounded."""
_SAME_AMPLITUDE = 1.05
"""Amplitudes of a log whose ratio is below this count as one."""


def measured_periods(one: MeasuredSine, operator: Operator | None = None) -> SinePeriods:
    """Return the measured periods of a sine of an experiment store.

    Parameters
    ----------
    one : MeasuredSine
        The sine and its samples.
    operator : Operator, optional
        Model of the hysteresis; it gets all inputs since the preamble.
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

    Rows of one frequency that follow each other are a sine. Rows of frequency 0 come before it,
    such as a saturating input; they drive the memory of the operator.

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
        Periods to use at the end of each sine, 2 at least.
    held : (T,) array_like of bool, optional
        Whether the input of a row was held since the row before, until its output was read, as a
        bench does; linear in between if not given.
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
            # Without rows before the next sine, this one drives its memory.
            since = end if end < hertz.size and hertz[end] <= 0 else since
    if not found:
        raise SignalError("the log has no row with a positive frequency; there is no sine in it")
    return found


def at_every_amplitude(
    frequencies: Sequence[float], amplitudes: Sequence[float]
) -> tuple[list[float], str]:
    """Return the frequencies that sines have at every amplitude, and a note about the others.

    Raises a `SignalError` if there is no such frequency.

    Parameters
    ----------
    frequencies, amplitudes : (N,) sequence of float
        Frequency in Hz and amplitude of each sine.

    Returns
    -------
    frequencies : list of float
        In increasing order.
    note : str
        Which are left out; empty if none.
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
            "that no gains can be compared; give each frequency the same amplitudes, or make a run "
            "of its own for each amplitude"
        )
    left = ", ".join(f"{f:g}" for f in every if f not in complete)
    return complete, f"{left} Hz left out: not measured at every amplitude" if left else ""


def sine_response(sines: Sequence[SinePeriods]) -> tuple[FrequencyResponse, list[str]]:
    """Return gains at the frequencies that were measured at every amplitude, and notes.

    Raises a `SignalError` if no frequency was measured at every amplitude, or a sine does not
    oscillate.

    Parameters
    ----------
    sines : sequence of SinePeriods
        Sines, in any order; the last of several with one frequency and amplitude is used.
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
    return response_of(grid, complete, amplitudes, float(np.mean(offsets))), notes


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
            f"{named} lasts {known:.3g} periods and {periods} whole ones are evaluated; record it "
            "for longer"
        )
    if step * frequency > (1 + 1e-6) / FEWEST_SAMPLES:
        raise SignalError(
            f"{named} has {1 / (step * frequency):.3g} samples in a period; give at least "
            f"{FEWEST_SAMPLES}"
        )
    samples = round(1 / (step * frequency))
    if not held:  # fewer samples would be held for longer
        samples = min(samples, _MOST_SAMPLES)
    places = t[-1] - np.arange(periods * samples)[::-1] / (samples * frequency)
    if np.isnan(y[t >= places[0]]).any():
        raise SignalError(f"{named} has gaps in its last {periods} periods; record it again")
    ends = np.searchsorted(t, places - _ROUNDING * step)  # rows at the ends of the holds

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
        if groups and values[k] < _SAME_AMPLITUDE * values[groups[-1][0]]:
            groups[-1].append(k)
        else:
            groups.append([k])
    place = {k: i for i, group in enumerate(groups) for k in group}
    levels = [float(np.median([values[k] for k in group])) for group in groups]
    return levels, [place[k] for k in range(len(values))]


def _side(preamble: float, offset: float) -> str:
    """Return the start of the operator's memory that a saturating input belongs to."""
    return "negative" if preamble <= offset else "positive"


def unsaturated(operator: Any, preambles: Sequence[float]) -> Iterator[str]:
    """Yield a note if an input before a sine does not saturate the operator.

    Parameters
    ----------
    operator : model
        The operator; only one with ``levels`` is checked.
    preambles : sequence of float
        Inputs before the sines.
    """
    levels = getattr(operator, "levels", None)
    for preamble in preambles:
        if levels is not None and levels[0] < preamble < levels[-1]:
            yield (
                f"the preamble of {preamble:g} does not saturate the model, whose levels reach "
                f"from {levels[0]:g} to {levels[-1]:g}; memory of before is not wiped out"
            )
            return
