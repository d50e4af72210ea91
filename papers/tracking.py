"""Recursive identification of a drifting strip, which the ionic polymer paper leaves open.

Data of a Preisach operator show the best that the recursion can do. On a twin whose bending fades,
the recursion is compared with a batch fit to the most recent samples, repeated at every sample.
The exponential window has the same mean age as that batch, so that both use the same history.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.identification import excitation
from minorloop.identification.recursive import Recursive
from minorloop.lab.settled_holds import hold_each
from minorloop.operators.preisach import Preisach
from minorloop.twins.ipmc import Ipmc
from papers.facts import identify_settled
from papers.harness import Results, rms

VOLTAGE, BANDS, HOLD = 1.2, 10, 200.0
NOISE = 0.006
"""Noise of the synthetic data, over their range."""
SYNTHETIC, SETTLING_IN = 1500, 500
SWING = 0.1
"""Relative amplitude by which the synthetic density drifts, one period over the record."""
FADING, FADING_NOISE = -0.02, 0.05
"""Relative loss of bending an hour, and sensor noise in 1/m, of the drifting twin."""
_DIVERGED = 0.5
"""Error over the range from which the recursion counts as diverged. A stable one stays within a few
percent, and a diverging one exceeds every bound."""


def synthetic_figures(seed: int) -> dict[str, Any]:
    """Return errors of the recursion on data of an operator, over their range, and divergence."""
    rng = np.random.default_rng(seed)
    grid = uniform_levels(-VOLTAGE, VOLTAGE, BANDS)
    shape = np.linspace(0, 1, BANDS)
    weights = np.exp(-4 * (shape[:, None] - shape)) * rng.uniform(0.5, 1.5, (BANDS, BANDS))
    model = Preisach(grid, np.tril(weights))
    exciting = np.resize(excitation.decaying_staircase(grid), SYNTHETIC)
    poor = rng.uniform(-0.5, 0.5, SYNTHETIC) * VOLTAGE
    fixed = _errors(model, exciting, 0.0, rng)
    drifting = _errors(model, exciting, SWING, rng)
    unexciting = _errors(model, poor, SWING, rng)
    return {
        "synthetic_nrmse_fixed": rms(fixed),
        "synthetic_nrmse_drift": rms(drifting),
        "synthetic_nrmse_poor": rms(unexciting),
        "diverged": bool(np.abs(unexciting).max() > _DIVERGED),
    }


def _errors(model: Preisach, u: FloatArray, swing: float, rng: np.random.Generator) -> FloatArray:
    """Return errors of the one-step predictions, over the range of the model."""
    recursion = Recursive(model.levels)
    state, span = recursion.begin(), float(np.ptp(model.range))
    rows = np.arange(BANDS)[:, None] / BANDS
    errors = []
    for k, value in enumerate(u):
        gain = 1 + swing * np.sin(2 * np.pi * k / SYNTHETIC) * rows
        truth = Preisach(model.levels, model.weights * gain).step(state.memory, value)[0]
        errors.append((recursion.model(state).step(state.memory, value)[0] - truth) / span)
        state = recursion.update(state, value, truth + rng.normal(0, NOISE * span))
    return np.array(errors[SETTLING_IN:])


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
