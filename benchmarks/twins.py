"""What simulating the head costs."""

from __future__ import annotations

import numpy as np

from benchmarks._timing import Row, best, within

FULL_SCALE = 60.0
"""Range of an axis, in degrees."""


def rows(quick: bool = False) -> list[Row]:
    ticks = 500 if quick else 15_000
    phase = 2 * np.pi * 0.04 * np.arange(ticks)[:, None] / 30.0
    currents = 0.2 + 0.2 * np.sin(phase + np.array([0.0, np.pi / 2]))
    way, finer = _loop(currents, 1), _loop(currents, 2)
    change = 100 * float(np.max(np.abs(way - finer))) / FULL_SCALE
    (taken,) = best(lambda: _loop(currents, 1), rounds=3)
    accuracy = f"half the step changes it by {change:.2g} % of full scale"
    what = f"{ticks * 0.04 / 60:.3g} minutes of the head, both axes, 40 ms at a time"
    return [within(what, taken, 2.0, accuracy, change <= 1.0)]


def _loop(currents: np.ndarray, substeps: int) -> np.ndarray:
    from minorloop_head.twins.head import Head

    plant = Head(noise=0.0, delay=0.04, substeps=substeps)
    return np.array([plant.exchange(u) for u in currents])
