"""Targets read at the end of holds too short to settle, with creep in the inverse and without.

One staircase with holds of 200 s and one with holds of 10 s give a plane with a generic spectrum of
creep. Rivals are the model of settled values of the long holds, and a model of the values that are
read after 10 s.
"""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.identification import Viscosity, excitation, identify
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER
from papers.facts import identify_settled
from papers.harness import Results, rms

LOW, HIGH, BANDS = -1.2, 1.2, 10
"""Least and greatest voltage, and bands of the models."""
SETTLED, SHORT, INTERVAL = 200.0, 10.0, 1.0
"""Long and short holds, and time between samples, in s."""
TARGETS, REACH = 14, 7.5
"""Number of targets, and their largest curvature in 1/m."""
NOISE = 0.03
"""Standard deviation of a curvature in 1/m while models are identified."""
_FIRST = 20
"""First of the experiments of a specimen here; the study of the strip has those before."""


def run_short_holds(seed: int) -> Results:
    """Identify one strip, and drive it to targets with three inverses.

    ``targets`` (n,) are curvatures in 1/m; ``errors`` those of what is read at the end of each
    short hold, by the model of the inverse: ``creep``, ``settled``, and ``early``, a model of
    values at the end of short holds.
    """
    grid = uniform_levels(LOW, HIGH, BANDS)
    voltages = excitation.decaying_staircase(grid)
    strip = _strip(seed, 0, NOISE)
    long, short = _held(strip, voltages, SETTLED), _held(strip, voltages, SHORT)
    record = Record.joined([*long, *short])
    creeping = identify(
        Record(record.u, record.y, record.t), Viscosity(grid, creep="spectrum", rate=False)
    ).model
    quick = _held(_strip(seed, 1, NOISE), voltages, SHORT)
    settled, early = (
        identify_settled(voltages, _ends(holds), levels=grid).model for holds in (long, quick)
    )
    targets = np.random.default_rng(seed).uniform(-REACH, REACH, TARGETS)
    times = SHORT * np.arange(1, TARGETS + 1)
    inputs = {
        "creep": creeping.invert(times, targets, unreachable="clip").u,
        "settled": settled.invert(targets, unreachable="clip").u,
        "early": early.invert(targets, unreachable="clip").u,
    }
    errors = {name: _ends(_held(_strip(seed, 2), u, SHORT)) - targets for name, u in inputs.items()}
    ends = {f"rms_{name}": rms(each) for name, each in errors.items()}
    ratio = ends["rms_settled"] / ends["rms_creep"]
    figures = {
        **ends,
        "ratio": ratio,
        "ratio_min": ratio,
        "minutes_saved": targets.size * (SETTLED - SHORT) / 60,
    }
    return Results(figures, targets=targets, errors=errors)


def _strip(seed: int, experiment: int, noise: float = 0.0) -> Actuator:
    """Return a specimen that has settled at the least voltage."""
    noise_seed = seed + FURTHER * (_FIRST + experiment)
    strip = connect("twin:ipmc", specimen=seed, noise=noise, seed=noise_seed)
    strip.apply(LOW, 2 * SETTLED, INTERVAL)
    return strip


def _held(strip: Actuator, inputs: FloatArray, hold: float) -> list[Record]:
    return [strip.apply(float(np.clip(u, LOW, HIGH)), hold, INTERVAL) for u in inputs]


def _ends(holds: list[Record]) -> FloatArray:
    """(n,) last samples of holds."""
    return np.array([hold.y[-1] for hold in holds])
