"""Forward and inverse of the Preisach operator, against relays in NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks._timing import Row, best, dearer, faster, within
from minorloop import Preisach

BANDS = 100


@dataclass(frozen=True)
class Sizes:
    samples: int = 1_000_000
    targets: int = 200_000
    relay_samples: int = 2_000
    signals: int = 16
    samples_each: int = 500_000
    pushes: int = 20_000


QUICK = Sizes(100_000, 20_000, 200, 4, 50_000, 2_000)


def rows(quick: bool = False) -> list[Row]:
    sizes, model, rng = QUICK if quick else Sizes(), a_model(), np.random.default_rng(1)
    model.invert(model.simulate(rng.uniform(-1, 1, 100)))  # compile first
    signals = {
        "random": rng.uniform(model.levels[0], model.levels[-1], sizes.samples),
        "smooth": 0.99 * np.sin(np.linspace(0, sizes.samples / 500, sizes.samples)),
    }
    found = []
    for name, u in signals.items():
        found += _forward(model, name, u, sizes)
        found.append(_inverse(model, name, u[: sizes.targets]))
    found.append(_together(model, rng.uniform(-1, 1, (sizes.signals, sizes.samples_each))))
    found.append(_tracker(model, signals["random"][: sizes.pushes]))
    return found


def a_model() -> Preisach:
    rng = np.random.default_rng(0)
    levels = np.sort(rng.uniform(-1, 1, BANDS + 1))
    return Preisach(levels, np.tril(rng.uniform(0, 1, (BANDS, BANDS))))


class Relays:
    """What one writes first: all relays of a plane at once in NumPy, sample after sample."""

    def __init__(self, model: Preisach) -> None:
        i, j = np.tril_indices(model.bands)
        self.up, self.down = model.levels[i + 1], model.levels[j]
        self.weights, self.offset = model.weights[i, j], model.offset

    def as_usual(self, u: np.ndarray) -> np.ndarray:
        """Relays of -1 and +1, switched by ``np.where``."""
        state, y = -np.ones(self.weights.size), np.empty(u.size)
        for t, value in enumerate(u):
            state = np.where(self.up <= value, 1.0, np.where(value <= self.down, -1.0, state))
            y[t] = self.weights @ state
        return y + self.offset

    def simulate(self, u: np.ndarray) -> np.ndarray:
        """The same as bits changed in place, as fast as NumPy goes."""
        on = np.zeros(self.weights.size, dtype=bool)
        y = np.empty(u.size)
        for t, value in enumerate(u):
            on |= self.up <= value
            on &= self.down < value
            y[t] = self.weights @ on
        return 2 * y - self.weights.sum() + self.offset


def cut(model: Preisach, inputs: np.ndarray) -> Preisach:
    """The same density on a plane cut at every input too, where relays are exact.

    Each cell shares its weight out over its pieces by area.
    """
    levels = np.union1d(
        model.levels, inputs[(inputs > model.levels[0]) & (inputs < model.levels[-1])]
    )
    whole = np.searchsorted(model.levels, levels[:-1], side="right") - 1
    areas, pieces = (_areas(x) for x in (model.levels, levels))
    old = np.ix_(whole, whole)
    return Preisach(levels, np.tril(model.weights[old] / areas[old] * pieces), model.offset)


def _areas(levels: np.ndarray) -> np.ndarray:
    widths = np.diff(levels)
    return np.outer(widths, widths) * (1 - np.eye(widths.size) / 2)


def _forward(model: Preisach, name: str, u: np.ndarray, sizes: Sizes) -> list[Row]:
    relays, few = Relays(model), u[:: u.size // sizes.relay_samples]
    ours, copy, usual, tuned = best(
        lambda: model.simulate(u),
        u.copy,
        lambda: relays.as_usual(few),
        lambda: relays.simulate(few),
        rounds=15,
    )
    probe = u[:: u.size // 200]
    exact = Relays(cut(model, probe)).simulate(probe)
    error = np.abs(model.simulate(probe) - exact).max() / np.ptp(model.range)
    what = f"forward, {u.size:.0e} {name} samples, L = {BANDS}: a sample"
    accuracy, accurate = f"off relays on a cut plane by {error:.0e} of range", error <= 1e-12
    ours, copy = ours / u.size, copy / u.size
    usual, tuned = usual / few.size, tuned / few.size
    return [
        faster(what, ours, "loop of NumPy relays", usual, 500, accuracy, bool(accurate)),
        Row(what, ours, "the same as bits in place", tuned, tuned / ours),
        dearer(what, ours, "copying the array", copy, 60),
    ]


def _inverse(model: Preisach, name: str, u: np.ndarray) -> Row:
    targets = np.clip(model.simulate(u), *model.range)
    inverse, forward = best(lambda: model.invert(targets), lambda: model.simulate(u), rounds=10)
    again = model.simulate(model.invert(targets).u)
    residual = np.abs(again - targets).max() / np.ptp(model.range)
    what = f"inverse, outputs of the {name} signal: a target"
    accuracy, accurate = f"residual {residual:.0e} of range", bool(residual <= 1e-12)
    inverse, forward = inverse / u.size, forward / u.size
    return dearer(what, inverse, "forward", forward, 20, accuracy, accurate)


def _together(model: Preisach, u: np.ndarray) -> Row:
    together, apart = best(lambda: model.simulate(u), lambda: [model.simulate(row) for row in u])
    same = np.array_equal(model.simulate(u), [model.simulate(row) for row in u])
    what = f"{len(u)} signals of {u.shape[1]:,} samples at once"
    accuracy = "equal to the bit" if same else "differs"
    return faster(what, together, "one by one on one core", apart, 1.6, accuracy, same)


def _tracker(model: Preisach, u: np.ndarray) -> Row:
    samples, outputs = u.tolist(), []

    def follow() -> None:
        push = model.track().push
        outputs[:] = [push(value) for value in samples]

    (least,) = best(follow, rounds=10)
    same = np.array_equal(outputs, model.simulate(u))
    accuracy = "equal to simulate, to the bit" if same else "differs"
    return within("Tracker.push from Python", least / u.size, 5e-6, accuracy, same)
