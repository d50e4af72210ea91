"""A fast stage in open loop: the inverse with dynamics against that of the hysteresis alone.

One noisy record of sines of falling amplitude gives operator, resonance and creep. The stage is
then driven along sines of 1 to 200 Hz without its sensor, with voltages from two inverses: that of
all of them, and that of an operator identified from the slow part of the same record.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification import identify
from minorloop.identification.dynamic_result import DynamicIdentification
from minorloop.identification.dynamics import identify_dynamics
from minorloop.identification.result import Identification
from minorloop.report import Table
from minorloop.twins.stage import RATE, TRAVEL, VOLTAGE, Stage
from papers.drawing import new_figure
from papers.harness import Study, rms

SINES = ((1.0, 3.0), (5.0, 1.2), (20.0, 0.5), (50.0, 0.3), (100.0, 0.15), (200.0, 0.1))
"""Frequencies in Hz and durations in s of the record."""
REST = 0.04
"""Seconds of rest before them."""
LEAST_SHARE = 0.1
"""Amplitude at the end of each sine over that at its beginning."""
FAST, FAST_SHARE = 200.0, 0.4
"""Frequency in Hz from which amplitudes are smaller, and by how much: the resonance is near."""
EVERY = 20
"""Of so many rows of the slow sine, the rate-independent operator is fitted to one: 500 a second
are enough for 1 Hz."""
FREQUENCIES = (1, 2, 5, 10, 20, 50, 100, 150, 200)
"""Frequencies of the targets in Hz."""
LOW, HIGH = 4.0, 32.0
"""Ends of the targets in um."""
RISE, LASTING = 0.1, 0.2
"""Seconds from rest to the lower end, and least duration of a sine."""
PERIODS = 3
"""Least number of periods."""
_INVERSES = {
    "without_time": ("inverse of the hysteresis alone", "C3", "s"),
    "dynamics": ("inverse with resonance and creep", "C0", "o"),
}
"""Name, colour and mark of both inverses."""
_SHOWN, _PERIODS = 100, 3
"""Frequency in Hz of the sine that is drawn against time, and its last periods."""


@dataclass(frozen=True, eq=False)
class FollowedSine:
    """A sine that was followed twice."""

    targets: FloatArray
    """Shape (T,). Wanted positions in um, from the end of the rise on."""
    dynamics: FloatArray
    without_time: FloatArray
    """Shape (T,). Errors in um with the inverse of operator, resonance and creep, and with that of
    the operator alone."""


@dataclass(frozen=True, eq=False)
class StageStudy:
    """All results of one specimen."""

    seed: int
    """Seed of specimen and noise."""
    found: DynamicIdentification
    """Operator with dynamics, of the whole record."""
    tracked: dict[int, FollowedSine]
    """By frequency in Hz."""
    seconds: float
    """Seconds of the identification with dynamics."""

    def figures(self) -> dict[str, Any]:
        """Return all figures by the names under which they are printed."""
        errors = {
            name: {
                f"hz_{frequency}": rms(getattr(one, name)) / TRAVEL
                for frequency, one in self.tracked.items()
            }
            for name in ("dynamics", "without_time")
        }
        ratio = errors["without_time"]["hz_100"] / errors["dynamics"]["hz_100"]
        return {
            **errors,
            "ratio_at_100_hz": ratio,
            "worst": {"ratio_at_100_hz_min": ratio},
            "resonance_off": abs(self._resonance / Stage(self.seed).resonance - 1),
            "nrmse": self.found.nrmse,
            "seconds": self.seconds,
        }

    @property
    def _resonance(self) -> float:
        """Natural frequency that was found, in Hz."""
        poles = self.found.model.linear.poles
        return float(np.abs(poles[np.argmax(np.abs(poles.imag))])) / (2 * np.pi)


def run_study(seed: int) -> StageStudy:
    """Identify one specimen and drive it along all sines.

    Parameters
    ----------
    seed : int
        Seed of specimen and noise.
    """
    stage, u = Stage(seed), record()
    y = stage.positions(u)
    began = time.perf_counter()
    found = identify_dynamics(times(u), u, y)
    seconds = time.perf_counter() - began
    first = round((REST + SINES[0][1]) * RATE)
    slow = identify(
        u[:first:EVERY], y[:first:EVERY], levels=25, diagonal="uniform", slope=False, lag=0
    )
    tracked = {frequency: _tracked(stage, found, slow, frequency) for frequency in FREQUENCIES}
    return StageStudy(seed, found, tracked, seconds)


def record() -> FloatArray:
    """Return the voltages (T,) of the record: rest, then sines whose amplitudes fall."""
    parts = [np.zeros(round(REST * RATE))]
    for frequency, seconds in SINES:
        t = np.arange(round(seconds * RATE)) / RATE
        amplitude = VOLTAGE / 2 * (FAST_SHARE if frequency >= FAST else 1.0)
        fall = 1 - (1 - LEAST_SHARE) * t / seconds
        parts.append(VOLTAGE / 2 - amplitude * fall * np.cos(2 * np.pi * frequency * t))
    return np.concatenate(parts)


def targets(frequency: float, rest: float) -> tuple[FloatArray, int]:
    """Return wanted positions (T,) in um, and the sample at which the sine begins.

    Parameters
    ----------
    frequency : float
        In Hz.
    rest : float
        Position at rest in um.
    """
    rising = round(RISE * RATE)
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
) -> FollowedSine:
    """Drive the stage along one sine with both inverses; errors are without noise of a sensor."""
    wanted, rising = targets(frequency, float(found.model.operator.simulate([0.0])[0]))
    inputs = (
        found.invert(times(wanted), wanted, before=0.0, unreachable="clip").u,
        slow.model.invert(wanted, unreachable="clip").u,
    )
    errors = [(stage.positions(np.clip(u, 0.0, VOLTAGE), 0.0) - wanted)[rising:] for u in inputs]
    return FollowedSine(wanted[rising:], errors[0], errors[1])


def found_table(study: StageStudy) -> Table:
    """Return what was identified."""
    return Table(("", ""), study.found.rows)


def draw_errors(figures: Mapping[str, Any]) -> Any:
    """Draw the rms errors of both inverses over the range against frequency."""
    figure, axes = new_figure(1, 1, height=3.8)
    for name, (words, colour, mark) in _INVERSES.items():
        errors = [100 * figures[name][f"hz_{frequency}"] for frequency in FREQUENCIES]
        axes.loglog(FREQUENCIES, errors, f"{mark}-", color=colour, label=words)
    axes.set(xlabel="frequency of the target [Hz]", ylabel="rms error [% of range]")
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False)
    return figure


def draw_sine(study: StageStudy) -> Any:
    """Draw the last periods of one sine, and the errors of both inverses."""
    figure, (above, below) = new_figure(2, 1, height=5.0, sharex=True)
    one = study.tracked[_SHOWN]
    last = slice(-round(_PERIODS * RATE / _SHOWN), None)
    t = 1e3 * np.arange(one.targets[last].size) / RATE
    above.plot(t, one.targets[last], color="0.3", lw=2.5, alpha=0.5, label="target")
    for name, (words, colour, _) in _INVERSES.items():
        error = getattr(one, name)[last]
        above.plot(t, one.targets[last] + error, color=colour, lw=1, label=words)
        below.plot(t, 100 * error / TRAVEL, color=colour, lw=1)
    above.set(ylabel="position [um]")
    below.set(xlabel="time [ms]", ylabel="error [% of range]")
    above.legend(frameon=False, fontsize=9)
    return figure


STUDY = Study(
    "stage",
    "A fast stage along sines of 1 to 200 Hz, without its sensor",
    run_study,
    page=__name__,
)
