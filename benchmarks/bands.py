"""Coverage of 90 % bands: fresh walks, another input of a wire, and the targets of the strip.

``python -m benchmarks.bands --cases 400 --seed S``. The walks are for six kinds of plant, six
shapes of record and three noises. No plant is a Preisach operator on the levels of the fit. Each is
fitted with ``holdout=0.3`` and predicts a random walk that is not in its record.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks._plants import Array, Plant, bouc_wen, magnet, slow_magnet
from benchmarks._timing import Row
from minorloop import Gaussian, Plane, Preisach, connect, excitation, identify
from minorloop.arrays import uniform_levels
from minorloop.lab.records import Record
from minorloop.positioning import ExperimentProtocol, run_positioning
from minorloop.twins.ipmc_laser import NOISE

NOISES = (1e-3, 5e-3, 2e-2)
"""Standard deviations of a reading, as shares of the range of the output."""
FRESH = 500
"""Samples of a fresh walk."""
CASES, SEED, SPECIMENS = 72, 1000, 10
LEAST, MOST, POOR, WIDER = 0.85, 0.97, 0.6, 1.3
"""Coverage that means need; coverage of a case below which advice must say so; half width on the
held-out part of the record over that of the posterior alone, which was the band before."""
HIGHEST, STEPS, HOLD, WIRE_NOISE = 0.4, 10, 40.0, 0.05
"""Current of a wire in A, levels of its curves, hold in s, and noise of its angle in degrees."""


@dataclass(frozen=True)
class Found:
    """Coverage of a case, and its half width over that of the posterior alone.

    ``like`` is the ratio on the held-out part of the record; ``said`` whether the identification
    or the prediction advises against its bands.
    """

    kind: str
    shape: str
    noise: float
    coverage: float
    like: float
    said: bool


@dataclass(frozen=True, eq=False)
class Case:
    """A record of a plant, and a fresh walk with its readings."""

    kind: str
    shape: str
    noise: float
    u: Array
    y: Array
    fresh: Array
    readings: Array


def a_case(seed: int) -> Case:
    """Return a case; the same seed gives the same case.

    Kind, shape and noise follow from the seed, so that consecutive seeds hold as many of each.
    """
    rng = np.random.default_rng([seed, 1644])
    kind = list(PLANTS)[seed % len(PLANTS)]
    shape = list(SHAPES)[seed // len(PLANTS) % len(SHAPES)]
    noise = NOISES[seed // (len(PLANTS) * len(SHAPES)) % len(NOISES)]
    plant = PLANTS[kind](rng)
    x = np.append(0.0, SHAPES[shape](rng, int(rng.integers(300, 2_000))))
    fresh = np.append(0.0, walk(rng, FRESH))
    y, truth = plant(x), plant(fresh)
    spread = noise * float(np.ptp(plant(np.array([0.0, 1.0, 0.0]))))
    return Case(
        kind, shape, noise, x, y + spread * rng.normal(size=x.size), fresh,
        truth + spread * rng.normal(size=fresh.size),
    )  # fmt: skip


def ridge(rng: np.random.Generator) -> Plant:
    """A smooth ridge on a fine Preisach plane, with a reversible part."""
    levels = np.linspace(0, 1, 81)
    middle = (levels[1:] + levels[:-1]) / 2
    width, centre = middle[:, None] - middle, middle[:, None] + middle - 1
    place, steep = rng.uniform(0.05, 0.4), rng.uniform(10, 80)
    weights = np.tril(
        np.exp(-steep * (width - place) ** 2 - rng.uniform(1, 10) * (centre - 0.2) ** 2)
    )
    share = rng.uniform(0, 0.5)
    model = Preisach(levels, weights / weights.sum(), slope=2 * share)
    return lambda x: np.asarray(model.simulate(x))


def relays(rng: np.random.Generator) -> Plant:
    """Two hundred relays whose thresholds are scattered evenly over the plane."""
    ends = np.sort(rng.uniform(0, 1, (200, 2)), axis=1)
    weights = rng.exponential(size=200)
    down, up = ends.T

    def run(x: Array) -> Array:
        on = np.zeros(up.size, dtype=bool)
        out = np.empty(x.size)
        for k, value in enumerate(x):
            on = np.where(value >= up, True, np.where(value <= down, False, on))
            out[k] = weights @ on
        return out

    return run


def plays(rng: np.random.Generator) -> Plant:
    """A sum of plays and a linear part."""
    radii = np.sort(rng.uniform(0, 0.4, int(rng.integers(4, 13))))
    weights = rng.uniform(0.1, 1, radii.size) * np.exp(-radii / rng.uniform(0.05, 0.4))
    slope = rng.uniform(0, 1) * weights.sum()

    def run(x: Array) -> Array:
        places = x[0] + radii
        out = np.empty(x.size)
        for k, value in enumerate(x):
            places = np.minimum(np.maximum(places, value - radii), value + radii)
            out[k] = weights @ places + slope * value
        return out

    return run


PLANTS: dict[str, Callable[[np.random.Generator], Plant]] = {
    "ridge": ridge,
    "relays": relays,
    "plays": plays,
    "bouc-wen": bouc_wen,
    "jiles-atherton": magnet,
    "slow magnet": slow_magnet,
}


def walk(rng: np.random.Generator, samples: int) -> Array:
    """Return a random walk, reflected at 0 and 1."""
    steps = rng.uniform(0.02, 0.15) * rng.normal(size=samples)
    return np.abs((np.cumsum(steps) + 1) % 2 - 1)


def staircase(rng: np.random.Generator, samples: int) -> Array:
    """Random levels, each held for some samples."""
    held = int(rng.integers(4, 21))
    return np.repeat(rng.uniform(0, 1, samples // held + 1), held)[:samples]


def multisine(rng: np.random.Generator, samples: int) -> Array:
    """Three to six sines of random frequencies and phases, over the whole range."""
    time, count = np.linspace(0, 1, samples), int(rng.integers(3, 7))
    rates, phases = rng.uniform(2, 25, (count, 1)), rng.uniform(0, 2 * np.pi, (count, 1))
    whole = np.sin(2 * np.pi * rates * time + phases).sum(axis=0)
    return np.asarray((whole - whole.min()) / np.ptp(whole))


def triangle(rng: np.random.Generator, samples: int) -> Array:
    """A triangle over the whole range, three to fifteen periods."""
    phase = np.linspace(0, rng.uniform(3, 15), samples)
    return np.asarray(1 - np.abs(2 * (phase % 1) - 1))


def reversals(rng: np.random.Generator, samples: int) -> Array:
    """Reversal curves from the top, in random order, down to a level and up again."""
    count = int(rng.integers(5, 13))
    ends = [0.0, 1.0]
    for level in rng.permutation(np.linspace(0, 0.9, count)):
        ends += [float(level), 1.0]
    places = np.cumsum(np.abs(np.diff(ends, prepend=0.0)))
    return np.interp(np.linspace(0, places[-1], samples), places, ends)


def steps(rng: np.random.Generator, samples: int) -> Array:
    """Independent inputs."""
    return rng.uniform(0, 1, samples)


SHAPES: dict[str, Callable[[np.random.Generator, int], Array]] = {
    "walk": walk,
    "staircase": staircase,
    "multisine": multisine,
    "triangle": triangle,
    "reversals": reversals,
    "steps": steps,
}


def rows(
    quick: bool = False, cases: int = CASES, seed: int = SEED, specimens: int = SPECIMENS
) -> list[Row]:
    """Measure, and return the rows of the report."""
    began = time.process_time()
    found = [_found(a_case(one)) for one in range(seed, seed + (36 if quick else cases))]
    took = (time.process_time() - began) / len(found)
    report = [_walks(key, found, took) for key in ("kind", "shape", "noise")]
    poor = [one for one in found if one.coverage < POOR]
    silent = sum(not one.said for one in poor)
    ratios = [one.like for one in found]
    least = min(one.coverage for one in found)
    return [
        *(row for group in report for row in group),
        Row(f"of {len(found)} cases, coverage below {POOR:g} without advice", took,
            required="none", met=not silent,
            accuracy=f"{silent}; {len(poor)} with or without, the least {least:.2f}"),
        Row("half width on the held-out part of the record, over that before", took,
            required=f"<= {WIDER:g}", met=bool(np.mean(ratios) <= WIDER),
            accuracy=f"mean {np.mean(ratios):.2f}, median {np.median(ratios):.2f}"),
        *_wires(range(seed, seed + (2 if quick else specimens))),
        *_strips(range(seed, seed + (2 if quick else specimens))),
    ]  # fmt: skip


def _found(case: Case) -> Found:
    """Fit a case, and compare its bands with the readings."""
    fit = identify(case.u, case.y, holdout=0.3)
    band = fit.predict(case.fresh, bands=0.9)
    shown = fit.predict(case.u, bands=0.9)
    posterior = np.hypot(fit.uncertainty.deviation(case.u, fit.start), shown.noise)
    ratio = float(np.mean(shown.sd[fit.held_out]) / np.mean(posterior[fit.held_out]))
    said = band.beyond > 0 or any("excited" in text for text in fit.advice)
    return Found(case.kind, case.shape, case.noise, band.covers(case.readings), ratio, said)


def _walks(key: str, found: list[Found], took: float) -> list[Row]:
    """Coverage by kind, by shape or by noise."""
    report = []
    for value in dict.fromkeys(getattr(one, key) for one in found):
        shares = [one.coverage for one in found if getattr(one, key) == value]
        name = f"noise of {value:.1%}" if isinstance(value, float) else value
        report.append(_covered(f"fresh walks, {key}: {name}", took, shares))
    return report


def _covered(name: str, took: float, shares: list[float]) -> Row:
    mean = float(np.mean(shares))
    return Row(
        name,
        took,
        required=f"{LEAST:g} to {MOST:g}",
        met=LEAST <= mean <= MOST,
        accuracy=f"{mean:.3f} of {len(shares)}, {min(shares):.2f} to {max(shares):.2f}",
    )


def _wires(specimens: range) -> list[Row]:
    """Bands of another input of a wire, after a fit to a fine major loop and reversal curves."""
    began = time.process_time()
    shares: dict[str, list[float]] = {"a decaying staircase": [], "random currents": []}
    levels = uniform_levels(0.0, HIGHEST, STEPS)
    curves = [np.append(levels[k:][::-1], levels[k + 1 :]) for k in range(1, STEPS)]
    fine = uniform_levels(0.0, HIGHEST, 25)
    curves = [np.append(fine, fine[-2::-1]), *curves]
    labels = np.repeat(np.arange(len(curves)), [curve.size for curve in curves])
    u = np.concatenate(curves)
    for specimen in specimens:
        rng = np.random.default_rng([specimen, 1645])
        y = _angles(specimen, u, 0)
        fit = identify(Record(u, y, curves=labels, start_of_curve="as-left"))
        others = excitation.decaying_staircase(levels), np.append(0.0, rng.uniform(0, HIGHEST, 40))
        for inputs, found in zip(others, shares.values(), strict=True):
            readings = _angles(specimen, inputs, 1)
            band = fit.predict(inputs, bands=0.9)
            found.append(band.covers(readings))
    took = (time.process_time() - began) / len(specimens)
    return [_covered(f"a wire after its curves: {name}", took, x) for name, x in shares.items()]


def _angles(specimen: int, u: Array, seed: int) -> Array:
    """Return settled angles of a wire in degrees."""
    wire = connect("twin:wire", specimen=specimen, noise=WIRE_NOISE, seed=seed)
    return np.array([wire.apply(float(value), HOLD, HOLD).y[-1] for value in u])


def _strips(specimens: range) -> list[Row]:
    """Bands of the curvatures that the strip reaches, for the 14 targets of the paper."""
    report = []
    for diagonal in ("uniform", "reversible"):
        began, shares = time.process_time(), []
        setup = ExperimentProtocol(laser=True, diagonal=diagonal)
        for specimen in specimens:
            one = run_positioning(specimen, NOISE, setup)
            law = Plane(one.identification.model.levels, diagonal=diagonal, slope=False, lag=0)
            fit = identify(one.voltages, one.settled, law, prior=Gaussian())
            band = fit.predict(np.append(-setup.voltage, one.preisach.voltages), bands=0.9)
            shares.append(band.covers(np.append(np.nan, one.preisach.achieved)))
        took = (time.process_time() - began) / len(specimens)
        report.append(_covered(f"14 targets of the strip, {diagonal} cells", took, shares))
    return report


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bands", description=__doc__)
    parser.add_argument("--cases", type=int, default=CASES, help="records")
    parser.add_argument("--seed", type=int, default=SEED, help="the first seed")
    parser.add_argument("--specimens", type=int, default=SPECIMENS, help="wires and strips")
    chosen = parser.parse_args()
    for row in rows(cases=chosen.cases, seed=chosen.seed, specimens=chosen.specimens):
        print(" | ".join(row.cells()))


if __name__ == "__main__":
    main()
