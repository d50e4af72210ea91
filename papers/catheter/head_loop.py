"""A guarded control loop around a twin of the head, run and scored."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.guard import Event
from minorloop_head.control.head import HeadControl
from minorloop_head.control.reach import Unreachable
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Surroundings
from papers.catheter.picture_sensor import PictureSensor
from papers.catheter.scoring import Truth, truth
from papers.harness import rms

TICK, DELAY, NOISE = 0.04, 0.04, 0.05
"""Interval of the loop, delay and noise of the sensor: s, s, degrees."""
HOTTEST, HIGHEST = 150.0, 0.4
"""Limits of a wire: degrees Celsius and A."""
STEADY = 5.0
"""Duration of the steady part at the end of a run, in seconds."""
DISTURBED = {
    "ambient 10 C": Surroundings(ambient=10.0),
    "ambient 30 C": Surroundings(ambient=30.0),
    "convection 65": Surroundings(convection=65.0),
    "convection 90": Surroundings(convection=90.0),
}
Reference: TypeAlias = Callable[[float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Alarm:
    """A target that the guard declared unreachable: time, axis and reason."""

    t: float
    axis: int
    verdict: Unreachable


@dataclass(frozen=True, eq=False)
class HeadRun:
    """One run of a loop."""

    t: FloatArray
    """Shape (T,). Ends of the ticks, in seconds."""
    wanted: FloatArray
    read: FloatArray
    current: FloatArray
    """Shape (T, 2). Targets and readings in degrees, currents in A."""
    truth: Truth
    """Truth for scoring."""
    alarms: tuple[Alarm, ...]
    """First alarm of each target that was declared unreachable."""
    log: tuple[tuple[int, Event], ...]
    """Axis and event, from the guard."""
    step_seconds: FloatArray
    """Shape (T,). Duration of each control step."""

    @cached_property
    def error(self) -> FloatArray:
        """(T, 2) true angles minus targets, in degrees."""
        return np.asarray(self.truth.angle - self.wanted)

    @property
    def settle(self) -> float:
        """Time in seconds from which the first axis stays at its last target; infinite without.

        It has settled within 2 % of the target, or 0.3 degrees if that is more.
        """
        target = float(self.wanted[-1, 0])
        out = np.abs(self.truth.angle[:, 0] - target) > max(0.02 * abs(target), 0.3)
        if out[-1]:
            return math.inf
        return float(self.t[np.flatnonzero(out)[-1]]) if out.any() else 0.0

    @property
    def overshoot(self) -> float:
        """Overshoot of the first axis over its last target, in percent."""
        return max(100.0 * (float(self.truth.angle[:, 0].max() / self.wanted[-1, 0]) - 1), 0.0)

    @property
    def steady(self) -> float:
        """Root-mean-square error of the first axis in the last 5 s, in degrees."""
        return rms(self.error[self.t > self.t[-1] - STEADY, 0])

    @property
    def violations(self) -> int:
        """Number of exceeded limits of currents and of each wire's temperature."""
        return int((self.truth.hottest > HOTTEST).sum()) + int((self.current > HIGHEST).sum())


def run_loop(
    control: HeadControl,
    reference: Reference,
    seconds: float,
    *,
    specimen: int | None,
    seed: int,
    camera: Callable[[Head], PictureSensor] | None = None,
    **options: Any,
) -> HeadRun:
    """Run a control loop on a cold head and return it with its truth.

    The controller follows targets in degrees. ``camera`` gives a head the camera that is then
    its only sensor; specimen, seed and options are those of `Head`.
    """
    options = {"delay": DELAY, **options}
    head = Head(specimen, NOISE, seed, tick=TICK, log_truth=True, **options)
    plant: Head | PictureSensor = head if camera is None else camera(head)
    steps = round(seconds / TICK)
    wanted, read, current = (np.empty((steps, 2)) for _ in range(3))
    took = np.empty(steps)
    alarms: list[Alarm] = []
    before: tuple[Unreachable | None, ...] = (None, None)
    state, y = control.begin(), np.zeros(2)
    for k in range(steps):
        wanted[k] = reference(k * TICK)
        began = time.perf_counter()
        u, state = control.step(state, wanted[k], y, t=k * TICK)
        took[k] = time.perf_counter() - began
        y = np.asarray(plant.exchange(u))
        current[k], read[k] = u, y
        verdicts = tuple(axis.unreachable for axis in state.axes)
        alarms += [
            Alarm(k * TICK, axis, now)
            for axis, (old, now) in enumerate(zip(before, verdicts, strict=True))
            if now is not None and old is None
        ]
        before = verdicts
    t = TICK * np.arange(1.0, steps + 1.0)
    return HeadRun(t, wanted, read, current, truth(head), tuple(alarms), state.log, took)


def step_figures(runs: Sequence[HeadRun]) -> dict[str, float]:
    """Return the worst figures of several steps of the first axis."""
    return {
        "settle_s": max(run.settle for run in runs),
        "overshoot_pct": max(run.overshoot for run in runs),
        "steady_rms_deg": max(run.steady for run in runs),
    }


def controller_figures(steps: Sequence[HeadRun], disturbed: Sequence[HeadRun]) -> dict[str, float]:
    """Return the figures of a controller by its steps, and by those in other surroundings."""
    return {
        **step_figures(steps),
        "disturbed_settle_s": max(run.settle for run in disturbed),
        "disturbed_rms_deg": max(run.steady for run in disturbed),
        "energy_A2s": float(sum(np.sum(run.current[:, 0] ** 2) * TICK for run in steps)),
    }


def constant(pan: float, tilt: float = 0.0) -> Reference:
    """Return a constant reference."""
    return lambda t: (pan, tilt)


def stairs(targets: Sequence[float], hold: float) -> Reference:
    """Return a staircase of the first axis."""
    return lambda t: (targets[min(int(t / hold + 1e-9), len(targets) - 1)], 0.0)


def circle(
    period: float, *, centre: float = 25.0, radius: float = 10.0, before: float = 0.0
) -> Reference:
    """Return a circle in pan and tilt, after a wait at its beginning."""

    def at(t: float) -> tuple[float, float]:
        phase = 2 * np.pi * max(t - before, 0.0) / period
        return centre + radius * float(np.cos(phase)), centre + radius * float(np.sin(phase))

    return at


def ramps(low: float, high: float, period: float) -> Reference:
    """Return ramps up and down on the first axis."""

    def at(t: float) -> tuple[float, float]:
        share = 1 - abs(2 * (t / period % 1.0) - 1)
        return low + (high - low) * share, 0.0

    return at
