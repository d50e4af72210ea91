"""Measured properties of a twin: trend, loop, and deviation from every Preisach model.

A test of an estimator on data of its own model proves nothing. These figures show the difference of
a twin from every Preisach operator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.identification import Identification, excitation
from minorloop.identification.pipeline import Options
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import hold_each


@dataclass(frozen=True)
class ProbeInputs:
    """Inputs that show the properties of a twin, in its unit."""

    low: float
    high: float
    """Range of the staircases."""
    bands: int
    """Steps between them."""
    hold: float
    """Seconds at each level."""
    loop: tuple[float, float]
    """Low and high end of a minor loop, which is reached from above and from below."""
    excursion: float
    """End of an excursion from ``high`` and back, which a Preisach operator forgets."""


def identify_settled(u: FloatArray, y: FloatArray, **options: Any) -> Identification:
    """Identify an operator from settled points by least squares, without lag and slope."""
    chosen = {"smoothness": 0.0, "diagonal": "reversible", **options}
    return Options.of({"slope": False, "lag": 0, **chosen}).identify(Record(u, y))


def twin_facts(make: Callable[[], Actuator], probes: ProbeInputs) -> dict[str, Any]:
    """Measure properties of a twin, each time from rest.

    Returns
    -------
    dict
        ``quadratic_fit``: coefficients of u^2, u and 1 of the least-squares quadratic through
        the settled points of a decaying staircase. ``loop_gap``: widest gap of the major loop
        over its range. ``congruency``: difference in height of one minor loop after two pasts,
        over its height. ``wiping_out``: change of the output by an excursion that a Preisach
        operator forgets, over the range.
    """

    def settled(inputs: FloatArray) -> FloatArray:
        return hold_each(make(), inputs, probes.hold, probes.hold)[1]

    grid = uniform_levels(probes.low, probes.high, probes.bands)
    stairs = excitation.decaying_staircase(grid)
    major = settled(np.concatenate([grid, grid[::-1]]))
    span = float(np.ptp(major))
    rising, falling = major[: grid.size], major[grid.size :][::-1]
    heights = [
        float(-np.diff(settled(np.array([probes.low, past, *probes.loop, *probes.loop]))[-2:])[0])
        for past in (probes.high, probes.loop[1])
    ]
    there_and_back = np.array([probes.low, probes.high, probes.excursion, probes.high])
    before, _, after = settled(there_and_back)[1:]
    return {
        "quadratic_fit": np.polyfit(stairs, settled(stairs), 2).tolist(),
        "range": [float(major.min()), float(major.max())],
        "loop_gap": float(np.max(falling - rising)) / span,
        "congruency": abs(heights[0] - heights[1]) / (abs(heights[0] + heights[1]) / 2),
        "wiping_out": float(abs(after - before)) / span,
    }
