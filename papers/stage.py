"""A fast stage in open loop: the inverse with dynamics against the inverse of hysteresis alone.

One noisy record of sines of falling amplitude gives operator, resonance and creep. The stage is
then driven along sines of 1 to 200 Hz without its sensor, with voltages from two inverses: that of
the whole model, and that of an operator identified from the slow part of the same record.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification import Dynamics, Plane, identify
from minorloop.identification.dynamic_result import DynamicIdentification
from minorloop.identification.plane_result import Identification
from minorloop.lab.records import Record
from minorloop.report import Table
from minorloop.twins.stage import RATE, TRAVEL, VOLTAGE, Stage
from papers.drawing import draw, panel
from papers.harness import Results, Study, rms

SINES = ((1.0, 3.0), (5.0, 1.2), (20.0, 0.5), (50.0, 0.3), (100.0, 0.15), (200.0, 0.1))
"""Frequencies in Hz and durations in s of the record."""
REST = 0.04
"""Seconds of rest before them."""
FREQUENCIES = (1, 2, 5, 10, 20, 50, 100, 150, 200)
"""Frequencies of the targets in Hz."""
LOW, HIGH = 4.0, 32.0
"""Ends of the targets in um."""
LASTING, PERIODS = 0.2, 3
"""Least duration of a sine in s, and least number of its periods."""
_INVERSES = {
    "without_time": ("inverse of the hysteresis alone", "C3 s"),
    "dynamics": ("inverse with resonance and creep", "C0 o"),
}
"""Name, and colour and mark of both inverses."""
_SHOWN = 100
"""Frequency in Hz of the sine drawn against time."""


def run_study(seed: int) -> Results:
    """Identify the specimen of a seed, and drive it along all sines.

    ``found`` is the operator with dynamics, of the whole record; ``tracked`` has the results of
    `_tracked` by frequency in Hz.
    """
    stage, u = Stage(seed), record()
    y = stage.positions(u)
    began = time.perf_counter()
    found = identify(Record(u, y, times(u)), Dynamics())
    seconds = time.perf_counter() - began
    first = round((REST + SINES[0][1]) * RATE)
    # For the slow sine of 1 Hz, 500 rows per second are enough.
    law = Plane(25, diagonal="uniform", slope=False, lag=0)
    slow = identify(u[:first:20], y[:first:20], law)
    tracked = {frequency: _tracked(stage, found, slow, frequency) for frequency in FREQUENCIES}
    errors = {
        name: {f"hz_{frequency}": rms(one[name]) / TRAVEL for frequency, one in tracked.items()}
        for name in ("dynamics", "without_time")
    }
    ratio = errors["without_time"]["hz_100"] / errors["dynamics"]["hz_100"]
    poles = found.model.linear.poles
    resonance = float(np.abs(poles[np.argmax(np.abs(poles.imag))])) / (2 * np.pi)
    figures = {
        **errors,
        "ratio_at_100_hz": ratio,
        "worst": {"ratio_at_100_hz_min": ratio},
        "resonance_off": abs(resonance / stage.resonance - 1),
        "nrmse": found.nrmse,
        "seconds": seconds,
    }
    return Results(figures, seed=seed, found=found, tracked=tracked)


def record() -> FloatArray:
    """Return the voltages (T,) of the record: rest, then sines whose amplitudes fall to a tenth.

    Near the resonance, at 200 Hz, they are smaller.
    """
    parts = [np.zeros(round(REST * RATE))]
    for frequency, seconds in SINES:
        t = np.arange(round(seconds * RATE)) / RATE
        amplitude = VOLTAGE / 2 * (0.4 if frequency >= 200.0 else 1.0)
        fall = 1 - (1 - 0.1) * t / seconds
        parts.append(VOLTAGE / 2 - amplitude * fall * np.cos(2 * np.pi * frequency * t))
    return np.concatenate(parts)


def targets(frequency: float, rest: float) -> tuple[FloatArray, int]:
    """Return wanted positions (T,) from rest on, in um, and the sample at which the sine begins."""
    rising = round(0.1 * RATE)
    rise = (1 - np.cos(np.pi * np.arange(rising) / rising)) / 2
    periods = max(PERIODS, round(LASTING * frequency))
    t = np.arange(round(periods / frequency * RATE)) / RATE
    wave = (LOW + HIGH) / 2 - (HIGH - LOW) / 2 * np.cos(2 * np.pi * frequency * t)
    return np.concatenate([rest + (LOW - rest) * rise, wave]), rising


def times(u: FloatArray) -> FloatArray:
    """Return the times (T,) of samples in s."""
    return np.arange(u.size) / RATE


def _tracked(
    stage: Stage, found: DynamicIdentification, slow: Identification, frequency: int
) -> dict[str, FloatArray]:
    """Drive the stage along one sine with both inverses, and return targets and errors (T,) in um.

    They begin at the end of the rise, and are without the noise of a sensor: ``targets``, and the
    errors with the inverse of operator, resonance and creep, ``dynamics``, and with that of the
    operator alone, ``without_time``.
    """
    wanted, rising = targets(frequency, float(found.model.operator.simulate([0.0])[0]))
    inputs = {
        "dynamics": found.invert(times(wanted), wanted, before=0.0, unreachable="clip").u,
        "without_time": slow.model.invert(wanted, unreachable="clip").u,
    }
    errors = {
        name: (stage.positions(np.clip(u, 0.0, VOLTAGE), 0.0) - wanted)[rising:]
        for name, u in inputs.items()
    }
    return {"targets": wanted[rising:], **errors}


def found_table(study: Results) -> Table:
    """Return the identified parameters."""
    return Table(("", ""), study.found.summary())


def draw_errors(figures: Mapping[str, Any]) -> Any:
    """Draw the rms errors of both inverses over the range against frequency."""
    lines = []
    for name, (words, look) in _INVERSES.items():
        errors = [100 * figures[name][f"hz_{each}"] for each in FREQUENCIES]
        lines.append((FREQUENCIES, errors, f"{look}-", words))
    scales = {"xscale": "log", "yscale": "log"}
    return draw(panel("frequency of the target [Hz]", "rms error [% of range]", *lines, **scales))


def draw_sine(study: Results) -> Any:
    """Draw the last periods of one sine, and the errors of both inverses."""
    last, one = slice(-round(3 * RATE / _SHOWN), None), study.tracked[_SHOWN]
    wanted = one["targets"][last]
    t = 1e3 * np.arange(wanted.size) / RATE
    above: list[Any] = [(t, wanted, "0.6 - 2.5", "target")]
    below = []
    for name, (words, look) in _INVERSES.items():
        error, colour = one[name][last], look.split()[0]
        above.append((t, wanted + error, colour, words))
        below.append((t, 100 * error / TRAVEL, colour))
    upper = panel("", "position [um]", *above, legend={"fontsize": 9})
    lower = panel("time [ms]", "error [% of range]", *below)
    return draw(upper, lower, height=5.0, sharex=True)


STUDY = Study(
    "stage", "A fast stage along sines of 1 to 200 Hz, without its sensor", run_study, page=__name__
)
