"""Forward and inverse of the Preisach operator, against relays in NumPy."""

from __future__ import annotations

import numpy as np

from benchmarks._timing import Row, best, seconds
from minorloop import Preisach

BANDS, SAMPLES = 100, 1_000_000
_RELAY_SAMPLES = 4000


def a_model() -> Preisach:
    rng = np.random.default_rng(0)
    levels = np.sort(rng.uniform(-1, 1, BANDS + 1))
    return Preisach(levels, np.tril(rng.uniform(0, 1, (BANDS, BANDS))))


def relay_loop(model: Preisach, u: np.ndarray) -> np.ndarray:
    """What one writes first: all relays at once in NumPy, sample after sample."""
    i, j = np.tril_indices(BANDS)
    up, down = model.levels[i + 1], model.levels[j]
    weights, state = model.weights[i, j], -np.ones(i.size)
    y = np.empty(u.size)
    for t, value in enumerate(u):
        state[value >= up] = 1.0
        state[value <= down] = -1.0
        y[t] = weights @ state
    return y + model.offset


def rows() -> list[Row]:
    model, rng = a_model(), np.random.default_rng(1)
    model.invert(model.simulate(rng.uniform(-1, 1, 100)))
    found = []
    signals = {
        "random": rng.uniform(model.levels[0], model.levels[-1], SAMPLES),
        "smooth": 0.99 * np.sin(np.linspace(0, 2000, SAMPLES)),
    }
    at_levels = rng.choice(model.levels, _RELAY_SAMPLES)
    span = np.ptp(model.range)
    error = np.abs(relay_loop(model, at_levels) - model.simulate(at_levels)).max() / span
    for name, u in signals.items():
        found += _forward_and_inverse(model, name, u, f"{error:.1e} of range at levels", span)
    found += [_parallel(model, rng), _tracker(model, signals["random"][:20_000])]
    return found


def _forward_and_inverse(
    model: Preisach, name: str, u: np.ndarray, accuracy: str, span: float
) -> list[Row]:
    few = u[: 20 * (u.size // _RELAY_SAMPLES) : u.size // _RELAY_SAMPLES]
    forward, copy, relays = best(
        lambda: model.simulate(u), u.copy, lambda: relay_loop(model, few), rounds=7
    )
    targets = np.clip(model.simulate(u[:200_000]), *model.range)
    (inverse,) = best(lambda: model.invert(targets), rounds=3)
    per_sample = forward / u.size
    over_relays = relays / few.size / per_sample
    over_copy = forward / copy
    ratio = inverse / targets.size / per_sample
    residual = f"{model.invert(targets).worst / span:.1e} of range"
    label = f"1e6 {name} samples, L = {BANDS}"
    fast, light = over_relays >= 500, over_copy <= 60
    return [
        Row(f"{label}: time a sample", 1e9 * per_sample, "ns", "", None),
        Row(
            f"{label}: NumPy relay loop / ours",
            over_relays,
            "x",
            ">= 500",
            fast,
            accuracy,
        ),
        Row(f"{label}: ours / copying the array", over_copy, "x", "<= 60", light),
        Row(f"inverse of {name} outputs / forward", ratio, "x", "<= 20", ratio <= 20, residual),
    ]


def _parallel(model: Preisach, rng: np.random.Generator) -> Row:
    u = rng.uniform(-1, 1, (16, 500_000))
    model.simulate(u)
    together, apart = best(lambda: model.simulate(u), lambda: [model.simulate(row) for row in u])
    ratio = apart / together
    same = np.array_equal(model.simulate(u[:2, :1000]), [model.simulate(x) for x in u[:2, :1000]])
    accuracy = "equal to the bit" if same else "differs"
    return Row("16 signals: one by one / together", ratio, "x", ">= 1.6", ratio >= 1.6, accuracy)


def _tracker(model: Preisach, u: np.ndarray) -> Row:
    samples = u.tolist()

    def follow() -> None:
        tracker = model.track()
        for value in samples:
            tracker.push(value)

    least = min(seconds(follow) for _ in range(5))
    each = 1e6 * least / len(samples)
    return Row("Tracker.push from Python", each, "us", "<= 5", each <= 5)
