"""What the prior costs, and what it is worth on simulated planes, smooth and rough ones.

`real_records` says what it is worth on real records.
"""

from __future__ import annotations

import numpy as np

from benchmarks._plants import Array
from benchmarks._timing import FIXED, Row, best, dearer, seconds, within
from benchmarks.one_fit import a_record
from benchmarks.real_records import LEAST, MOST, NOT_WORSE
from benchmarks.real_records import a_record as like_real
from minorloop import Preisach, excitation, identify
from minorloop.identification import Gaussian, Identification, Plane, Smooth
from minorloop.identification.design import next_input
from minorloop.identification.pipeline import Options
from minorloop.lab.records import Record
from minorloop.operators.memory import Memory

PLANES = ("smooth", "two populations", "uniform", "exponential squared", "few relays")
SIZES, FINE = ((10, 150), (10, 400), (20, 2_000)), ((80, 5_000),)
"""Bands and samples; the last of more bands than single large weights are looked for."""
SEEDS, NOISE, OTHERS = 5, 3e-3, 1_500
"""Plants of each kind, size and kind of inputs, noise over the range, and inputs not fitted."""


def rows(quick: bool = False) -> list[Row]:
    bands, samples = (20, 2_000) if quick else (50, 20_000)
    found = [*_few(), _many(bands, samples)]
    found += [_planes(kind, 1 if quick else SEEDS, SIZES) for kind in PLANES]
    found.append(_last_third(2 if quick else 2 * SEEDS))
    return found if quick else [*found, _planes(PLANES[-1], 2, FINE)]


def a_plane(kind: str, bands: int, rng: np.random.Generator) -> Preisach:
    """A plant with relays on levels from -1 to 1, whose output has a range of 2."""
    levels = np.linspace(-1, 1, bands + 1)
    middle = (levels[1:] + levels[:-1]) / 2
    width, centre = middle[:, None] - middle, middle[:, None] + middle
    if kind == "smooth":
        place, steep = rng.uniform(0.2, 0.8), rng.uniform(4, 12)
        weights = np.exp(-steep * (width - place) ** 2 - 2 * centre**2)
    elif kind == "two populations":
        weights = np.exp(-20 * (width - 0.25) ** 2 - 4 * (centre + 0.5) ** 2)
        weights += np.exp(-20 * (width - rng.uniform(0.8, 1.2)) ** 2 - 6 * (centre - 0.3) ** 2)
    elif kind == "few relays":
        weights, cells = np.zeros((bands, bands)), np.argwhere(np.tri(bands))
        for i, j in rng.permutation(cells)[: rng.integers(3, 13)]:
            weights[i, j] = rng.uniform(0.2, 1)
    else:
        draw = rng.uniform(size=(bands, bands))
        weights = draw if kind == "uniform" else np.log(draw) ** 2
    weights = np.tril(weights)
    return Preisach(levels, weights / weights.sum())


def _planes(kind: str, seeds: int, sizes: tuple[tuple[int, int], ...]) -> Row:
    """Errors and bands of default fits on inputs that were not fitted, beside plain fits."""
    ratios, inside, took = [], [], 0.0
    for bands, samples in sizes:
        for seed in range(2 * seeds):
            rng = np.random.default_rng([seed, bands, samples, PLANES.index(kind)])
            plant, ramps = a_plane(kind, bands, rng), seed % 2
            u, others = (_inputs(count, bool(ramps), rng) for count in (samples, OTHERS))
            spread = NOISE * float(np.ptp(plant.simulate(u)))
            y = plant.simulate(u) + spread * rng.normal(size=u.size)
            truth, fits = plant.simulate(others), []
            options = {"levels": plant.levels, **FIXED}
            took += seconds(lambda: fits.append(Options.of(options).identify(Record(u, y))))  # noqa: B023
            fits.append(identify(u, y, Plane(plant.levels, **FIXED), prior=Smooth(0.0)))
            ours, plain = (np.sqrt(np.mean((fit.predict(others) - truth) ** 2)) for fit in fits)
            ratios.append(ours / plain)
            readings = truth + spread * rng.normal(size=truth.size)
            inside.append(fits[0].predict(others, bands=0.9).covers(readings))
    above, cover = np.mean(np.array(ratios) > NOT_WORSE), float(np.mean(inside))
    return Row(
        f"default fits of {len(ratios)} planes of up to {sizes[-1][0]} bands, {kind}",
        took,
        required=f"each <= {NOT_WORSE:g} of the fit without prior; bands {LEAST:g} to {MOST:g}",
        met=bool(above == 0 and LEAST <= cover <= MOST),
        accuracy=f"median {np.median(ratios):.2f}, {above:.0%} above {NOT_WORSE:g}, "
        f"worst {max(ratios):.2g}; bands cover {cover:.0%}",
    )


def _last_third(seeds: int) -> Row:
    """Bands on the last third of records like real, where relays are scattered evenly.

    A cell of the fit has sixteen cells of the plant, of weights drawn one by one.
    """
    inside, took = [], 0.0
    for seed in range(1000, 1000 + seeds):
        rng, u = np.random.default_rng(seed), like_real(25, 2_000, seed)[1]
        y = a_plane("uniform", 100, rng).simulate(u)
        y += 1e-3 * np.ptp(y) * rng.normal(size=y.size)
        fits: list[Identification] = []
        options = {"levels": 25, "holdout": 1 / 3, **FIXED}
        took += seconds(lambda: fits.append(Options.of(options).identify(Record(u, y))))  # noqa: B023
        off = np.abs(fits[0].predict(u) - y)
        half = fits[0].predict(u, bands=0.9).half_width
        inside.append(np.mean((off <= half)[fits[0].held_out]))
    cover = float(np.mean(inside))
    return Row(
        f"bands of the last third of {seeds} records like real, N = 2,000, uniform",
        took,
        required=f"{LEAST:g} to {MOST:g}",
        met=bool(LEAST <= cover <= MOST),
        accuracy=f"cover {cover:.0%}, {min(inside):.0%} to {max(inside):.0%}",
    )


def _inputs(count: int, ramps: bool, rng: np.random.Generator) -> Array:
    """Saturation from both sides, then random inputs, or ramps of 10 samples."""
    ends = rng.uniform(-1, 1, count)
    inputs = np.interp(np.arange(count) / 10, np.arange(count), ends) if ramps else ends
    return np.append([-1.0, 1.0], inputs)


def _few() -> list[Row]:
    """Choosing an input, and fitting 56 holds, on 20 bands."""
    model, _, _ = a_record(20, 10)
    stairs = excitation.decaying_staircase(np.linspace(-1, 1, 11))
    noise = 0.0053 * float(np.ptp(model.range))
    y = model.simulate(stairs) + noise * np.random.default_rng(1).normal(size=stairs.size)

    def fit() -> object:
        return identify(Record(stairs, y, sd=noise), Plane(model.levels, **FIXED), prior=Gaussian())

    found = identify(Record(stairs, y, sd=noise), Plane(model.levels, **FIXED), prior=Gaussian())
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
        lambda: fits.append(identify(u, y, Plane(model.levels, **FIXED), prior=Gaussian())),
        lambda: identify(u, y, Plane(model.levels, **FIXED), prior=Smooth()),
        rounds=2,
    )
    what = f"identify with the prior, L = {bands}, N = {samples:,}"
    kkt = fits[-1].kkt
    return dearer(what, ours, "smoothness auto", theirs, 4, f"kkt {kkt:.0e}", kkt <= 1e-6)
