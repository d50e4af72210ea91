"""Recursive identification of a drifting strip, which the ionic polymer paper leaves open.

On a twin whose bending fades, the recursion is compared with a batch fit to the most recent
samples, repeated at every sample. The exponential window has the same mean age as that batch, so
that both use the same history.
"""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.identification import excitation
from minorloop.identification.recursive import Recursive
from minorloop.lab.settled_holds import hold_each
from minorloop.twins.ipmc import Ipmc
from papers.facts import identify_settled
from papers.harness import Results, rms

VOLTAGE, BANDS, HOLD = 1.2, 10, 200.0
FADING, FADING_NOISE = -0.02, 0.05
"""Relative loss of bending an hour, and sensor noise in 1/m, of the drifting twin."""


def run_tracking(seed: int) -> Results:
    """Follow a fading strip through three staircases and then random voltages.

    ``measured`` (n,) has its outputs in 1/m over the part that is scored, ``predicted`` those from
    the samples before: ``recursive``, ``batch``, and ``fixed`` of a model identified once, before.
    """
    grid = uniform_levels(-VOLTAGE, VOLTAGE, BANDS)
    stairs = excitation.decaying_staircase(grid)
    random = np.random.default_rng(seed).uniform(-VOLTAGE, VOLTAGE, stairs.size // 2)
    u = np.concatenate([stairs, stairs, stairs, random])
    strip = Ipmc(seed, FADING_NOISE, seed, drift=FADING)
    _, y = hold_each(strip, u, HOLD)
    strip.safe()
    scored = slice(2 * stairs.size, u.size)
    once = identify_settled(u[: stairs.size], y[: stairs.size], levels=grid)
    predicted = {
        "recursive": _recursive_predictions(grid, u, y, stairs.size)[scored],
        "batch": _batch_predictions(grid, u, y, stairs.size, scored.start),
        "fixed": once.model.simulate(u)[scored],
    }
    errors = {name: rms(each - y[scored]) for name, each in predicted.items()}
    figures = {
        f"twin_over_{other}": errors["recursive"] / errors[other] for other in ("batch", "fixed")
    }
    return Results(figures, measured=y[scored], predicted=predicted)


def _recursive_predictions(grid: Levels, u: FloatArray, y: FloatArray, window: int) -> FloatArray:
    """Return the prediction of each sample before the update with it."""
    age = window / 2  # the forgetting factor that gives samples this mean age
    recursion = Recursive(grid, forgetting=age / (age + 1), diagonal="reversible")
    state, predicted = recursion.begin(), np.empty_like(y)
    for k in range(u.size):
        predicted[k] = recursion.model(state).step(state.memory, u[k])[0]
        state = recursion.update(state, u[k], y[k])
    return predicted


def _batch_predictions(
    grid: Levels, u: FloatArray, y: FloatArray, window: int, first: int
) -> FloatArray:
    """Return the prediction of each sample by a fit to the window before it."""
    predicted = np.empty(u.size - first)
    for k in range(first, u.size):
        recent = y[:k].copy()
        recent[: k - window] = np.nan
        fit = identify_settled(u[:k], recent, levels=grid)
        predicted[k - first] = fit.model.simulate(u[: k + 1])[-1]
    return predicted
