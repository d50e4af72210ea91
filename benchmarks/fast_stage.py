"""Operator and dynamics of a fast stage: predicted at other frequencies, and driven along a sine.

The stage is simulated by 241 plays, a bend and lags of 3 and 1 ms, with four steps for each sample;
its sensor has 10 nm of noise. The model is identified with the options of the command line from one
record of sines of decreasing amplitude. Scores are against the stage without noise.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks._timing import Row
from minorloop.arrays import FloatArray
from minorloop.identification import Dynamics, Plane, identify
from minorloop.lab.records import Record

RATE, STEPS = 5000.0, 4
"""Samples per second, and steps of the simulation for each."""
LAGS = (3e-3, 1e-3)
NOISE = 0.01
TRAVEL = 40.0
"""Range of the position in um, for 0 to 100 V."""
RADII = np.linspace(0.0, 48.0, 241)
SINES = ((1, 3.0), (5, 1.2), (20, 0.5), (50, 0.3), (100, 0.15))
"""Frequencies in Hz and durations in s of the record."""
REQUIRED = {20: 0.0025, 50: 0.003}
MOST_OFF = 0.4
"""Tracking error in um."""


@dataclass(frozen=True)
class Stage:
    """A stage of one seed: weights of its plays, and its bend."""

    seed: int

    def settled(self, u: FloatArray) -> FloatArray:
        """Positions (T,) for slow inputs, after a sweep up and down."""
        rng = np.random.default_rng(self.seed)
        weights = np.exp(-RADII / rng.uniform(12, 20))
        weights[0] = rng.uniform(4, 8) * weights[1:].sum() / 2.5
        bend = rng.uniform(-0.08, 0.08)
        play, w = RADII.copy(), np.empty(u.size)
        for k, x in enumerate(u):
            np.clip(play, x - RADII, x + RADII, out=play)
            w[k] = weights @ play
        low, high = weights @ RADII, weights @ (100 - RADII)
        z = (w - low) / (high - low)
        return np.asarray(TRAVEL * (z + bend * z * (1 - z)))

    def positions(self, u: FloatArray, noise: float = 0.0) -> FloatArray:
        """Positions (T,) for held inputs; before the first sample it was at rest."""
        w = np.repeat(self.settled(u), STEPS)
        for lag in LAGS:
            left = np.exp(-1 / (RATE * STEPS * lag))
            y = np.empty(w.size)
            now = w[0]
            for k, x in enumerate(w):
                now = y[k] = x + left * (now - x)
            w = y
        return w[STEPS - 1 :: STEPS] + noise * np.random.default_rng([self.seed, 1]).normal(
            size=u.size
        )


def times(u: FloatArray) -> FloatArray:
    return np.arange(u.size) / RATE


def record(share: float = 0.9) -> FloatArray:
    """Input of the record: rest, then sines whose amplitudes fall by this share."""
    parts = [np.zeros(200)]
    for frequency, seconds in SINES:
        t = np.arange(0, seconds, 1 / RATE)
        parts.append(50 - 50 * np.cos(2 * np.pi * frequency * t) * (1 - share * t / seconds))
    return np.clip(np.concatenate(parts), 0, 100)


def other(frequency: float) -> FloatArray:
    """Input of six periods at one frequency, with other amplitudes than the record."""
    t = np.arange(0, 6 / frequency, 1 / RATE)
    wave = 45 - 45 * np.cos(2 * np.pi * frequency * t) * (1 - 0.6 * t * frequency / 6)
    return np.concatenate([np.zeros(50), wave])


def wanted(rest: float) -> FloatArray:
    """Trajectory: to 4 um within 0.1 s, then five periods of 10 Hz between 4 and 32 um."""
    rise = (1 - np.cos(np.pi * np.arange(500) / 500)) / 2
    wave = 18 - 14 * np.cos(2 * np.pi * 10 * np.arange(2500) / RATE)
    return np.concatenate([rest + (4 - rest) * rise, wave])


def measure(seed: int) -> tuple[float, dict[int, float], float]:
    """Seconds of the identification, errors by frequency over the travel, tracking error in um."""
    stage, u = Stage(seed), record()
    y = stage.positions(u, NOISE)
    began = time.perf_counter()
    found = identify(Record(u, y, times(u)), Dynamics(Plane("auto", diagonal="auto", slope="auto")))
    seconds = time.perf_counter() - began
    errors = {}
    for frequency in REQUIRED:
        inputs = other(frequency)
        off = found.predict(times(inputs), inputs) - stage.positions(inputs)
        errors[frequency] = float(np.sqrt(np.mean(off**2)) / TRAVEL)
    targets = wanted(float(found.model.operator.simulate([0.0])[0]))
    inverse = found.invert(times(targets), targets, before=0.0, unreachable="clip")
    off = stage.positions(np.clip(inverse.u, 0, 100)) - targets
    return seconds, errors, float(np.sqrt(np.mean(off**2)))


def rows(quick: bool = False, first_seed: int = 0) -> list[Row]:
    """Measure, and return the rows of the report."""
    measured = [measure(seed) for seed in range(first_seed, first_seed + (1 if quick else 20))]
    seconds = float(np.median([one[0] for one in measured]))
    found = []
    for frequency, most in REQUIRED.items():
        errors = [one[1][frequency] for one in measured]
        found.append(
            Row(
                f"prediction of a fast stage at {frequency} Hz",
                seconds,
                required=f"<= {most:.2%} of range",
                met=max(errors) <= most,
                accuracy=f"{np.median(errors):.3%} in the median, {max(errors):.3%} at most",
            )
        )
    off = [one[2] for one in measured]
    found.append(
        Row(
            "tracking of 10 Hz by its inverse",
            seconds,
            required=f"<= {MOST_OFF} um rms of 40",
            met=max(off) <= MOST_OFF,
            accuracy=f"{np.median(off):.3f} um in the median, {max(off):.3f} um at most",
        )
    )
    return found
