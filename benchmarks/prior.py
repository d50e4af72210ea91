"""What the prior costs on simulated records; `real_records` says what it is worth on real ones."""

from __future__ import annotations

import numpy as np

from benchmarks._timing import Row, best, dearer, within
from benchmarks.one_fit import a_record
from minorloop import excitation, identify
from minorloop.identification.design import next_input
from minorloop.operators.memory import Memory


def rows(quick: bool = False) -> list[Row]:
    bands, samples = (20, 2_000) if quick else (50, 20_000)
    return [*_few(), _many(bands, samples)]


def _few() -> list[Row]:
    """Choosing an input, and fitting 56 holds, on 20 bands."""
    model, _, _ = a_record(20, 10)
    stairs = excitation.decaying_staircase(np.linspace(-1, 1, 11))
    noise = 0.0053 * float(np.ptp(model.range))
    y = model.simulate(stairs) + noise * np.random.default_rng(1).normal(size=stairs.size)

    def fit() -> object:
        return identify(stairs, y, levels=model.levels, prior="gaussian", noise=noise)

    found = identify(stairs, y, levels=model.levels, prior="gaussian", noise=noise)
    memory = Memory.after(stairs, low=-1.0, high=1.0)
    choice, refit = best(lambda: next_input(found, memory), fit, rounds=3)
    return [
        within("choose the next input, L = 20, 56 holds", choice, 0.1),
        within("fit 56 holds with the prior, L = 20", refit, 2.0, f"kkt {found.kkt:.0e}"),
    ]


def _many(bands: int, samples: int) -> Row:
    model, u, y = a_record(bands, samples)
    fits = []
    ours, theirs = best(
        lambda: fits.append(identify(u, y, levels=model.levels, prior="gaussian")),
        lambda: identify(u, y, levels=model.levels, prior="none"),
        rounds=2,
    )
    what = f"identify with the prior, L = {bands}, N = {samples:,}"
    kkt = fits[-1].kkt
    return dearer(what, ours, "smoothness auto", theirs, 4, f"kkt {kkt:.0e}", kkt <= 1e-6)
