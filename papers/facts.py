"""Measured properties of a twin: trend, loop, and deviation from every Preisach model.

A test of an estimator on data of its own model proves nothing. These figures show the difference of
a twin from every Preisach operator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, Levels
from minorloop.identification import Identification, excitation
from minorloop.identification.pipeline import Options
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import hold_each


def identify_settled(u: FloatArray, y: FloatArray, **options: Any) -> Identification:
    """Identify an operator from settled points by least squares, without lag and slope."""
    chosen = {"smoothness": 0.0, "diagonal": "reversible", **options}
    return Options.of({"slope": False, "lag": 0, **chosen}).identify(Record(u, y))


def twin_facts(
    make: Callable[[], Actuator],
    levels: Levels,
    hold: float,
    *,
    loop: tuple[float, float],
    excursion: float,
) -> dict[str, Any]:
    """Measure properties of a twin, each time from rest.

    ``make`` returns a twin at rest; ``levels`` (L + 1,) are those of staircases, in the unit of the
    input; a ``hold`` is in seconds. ``loop``: low and high end of a minor loop, which is reached
    from above and from below. ``excursion``: end of one from the highest level and back.

    In the results, ``quadratic_fit`` has the coefficients of u^2, u and 1 of the least-squares
    quadratic through the settled points of a decaying staircase; ``loop_gap`` is the widest gap of
    the major loop over its range, which is ``range``; ``congruency`` the difference in height of
    one minor loop after two pasts, over its height; ``wiping_out`` the change of the output by the
    excursion, which a Preisach operator forgets, over the range.
    """

    def settled(inputs: FloatArray) -> FloatArray:
        return hold_each(make(), inputs, hold, hold)[1]

    low, high = levels[[0, -1]].tolist()
    stairs = excitation.decaying_staircase(levels)
    major = settled(np.concatenate([levels, levels[::-1]]))
    span = float(np.ptp(major))
    rising, falling = major[: levels.size], major[levels.size :][::-1]
    heights = [
        float(-np.diff(settled(np.array([low, past, *loop, *loop]))[-2:])[0])
        for past in (high, loop[1])
    ]
    before, _, after = settled(np.array([low, high, excursion, high]))[1:]
    return {
        "quadratic_fit": np.polyfit(stairs, settled(stairs), 2).tolist(),
        "range": [float(major.min()), float(major.max())],
        "loop_gap": float(np.max(falling - rising)) / span,
        "congruency": abs(heights[0] - heights[1]) / (abs(heights[0] + heights[1]) / 2),
        "wiping_out": float(abs(after - before)) / span,
    }
