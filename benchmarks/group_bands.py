"""Coverage of the 90 % bands of left-out groups: reversal curves, and simulated specimens.

Curves of a magnet are left out in ten parts. Of the simulated specimens, 5 or 8 are measured on a
decaying staircase, and the bands are for random levels on other specimens.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks._timing import FIXED, Row
from minorloop import excitation, identify
from minorloop.arrays import FloatArray, uniform_levels
from minorloop.identification import Plane
from minorloop.identification.pipeline import Options
from minorloop.lab.columns import read_columns
from minorloop.lab.records import Record
from minorloop.twins.fibre import Fibre
from minorloop.twins.ipmc import Ipmc

DATA = Path(__file__).parents[2] / "shared" / "data"
MAGNETS = (
    ("FeCo nanowires", "forc_feco_nanowires.csv", "field_Oe", "moment_emu"),
    ("steel MSM 33", "forc_msm33.csv", "field_T", "moment_Am2"),
)
OPTIONS = {"levels": 20, "spacing": "adaptive", "start_of_curve": "positive"}
FOLDS = 10
TWINS = (("strip", Ipmc, -1.2, 1.2, 0.02, 200.0), ("fibre", Fibre, 0.2, 0.65, 1.0, 300.0))
"""Twin, range of the input, noise of the sensor in 1/m or um, and duration of a hold in s."""
GROUPS, OTHERS, SEEDS = (5, 8), 10, 20
BANDS = 8
LEAST, MOST = 0.85, 0.95

Labels = npt.NDArray[np.int64]


def rows(quick: bool = False, first_seed: int = 0) -> list[Row]:
    """Measure, and return the rows of the report."""
    seeds = range(first_seed, first_seed + (2 if quick else SEEDS))
    found = [_of_magnet(*magnet, quick) for magnet in MAGNETS if (DATA / magnet[1]).exists()]
    if len(found) < len(MAGNETS):
        print(f"no reversal curves in {DATA}: their bands are not measured", file=sys.stderr)
    for name, *twin in TWINS:
        for groups in GROUPS:
            began = time.perf_counter()
            shares = [_of_specimens(*twin, groups, seed) for seed in seeds]
            took = (time.perf_counter() - began) / len(shares)
            found.append(_row(f"{groups} specimens of the {name}", took, shares))
    return found


def _row(name: str, seconds: float, shares: list[float]) -> Row:
    mean, above = float(np.mean(shares)), sum(share > MOST for share in shares)
    accuracy = f"{mean:.3f} of the readings within the bands"
    if len(shares) > 1:
        accuracy += (
            f", {min(shares):.2f} to {max(shares):.2f} over {len(shares)} seeds, {above} above "
            f"{MOST:g} and {sum(share < LEAST for share in shares)} below {LEAST:g}"
        )
    required, met = f"{LEAST:g} to {MOST:g}", LEAST <= mean <= MOST
    return Row(f"bands of left-out groups: {name}", seconds, required=required, met=met,
               accuracy=accuracy)  # fmt: skip


def _of_magnet(name: str, file: str, input: str, output: str, quick: bool) -> Row:
    curve, u, y = read_columns(DATA / file, ["curve", input, output]).values()
    used = np.append(False, np.diff(curve) == 0)  # the first row of each is a drift calibration
    used &= curve % (8 if quick else 1) == 0
    names, counts = np.unique(curve[used], return_counts=True)
    used &= np.isin(curve, names[counts > 1])  # a group of one row is refused
    labels = curve[used].astype(np.int64)
    began = time.perf_counter()
    inside = _inside(u[used], y[used], labels)
    return _row(f"{name}, curve by curve", time.perf_counter() - began, [inside])


def _inside(u: FloatArray, y: FloatArray, labels: Labels) -> float:
    """Share of the rows within the bands of fits to the other groups."""
    names, within = np.unique(labels), []
    for k in range(FOLDS):
        out = np.isin(labels, names[k::FOLDS])
        found = Options.of({**OPTIONS, **FIXED}).identify(
            Record(u[~out], y[~out], curves=labels[~out])
        )
        band = found.predict(u[out], bands=0.9, curves=labels[out])
        within.append((y[out] >= band.lower) & (y[out] <= band.upper))
    return float(np.concatenate(within).mean())


def _of_specimens(
    kind: type, low: float, high: float, noise: float, hold: float, groups: int, seed: int
) -> float:
    """Share of the readings of other specimens within the bands of a fit to some."""
    levels = uniform_levels(low, high, BANDS)
    stairs = excitation.decaying_staircase(levels)
    chance = np.random.default_rng(seed)
    numbers = seed * (max(GROUPS) + OTHERS) + np.arange(max(GROUPS) + OTHERS)
    seen, others = numbers[:groups], numbers[-OTHERS:]

    def measured(specimen: int, inputs: FloatArray) -> FloatArray:
        twin = kind(specimen=int(specimen))
        settled = np.array([twin.apply(u, hold, hold).y[-1] for u in inputs])
        return settled + noise * chance.normal(size=inputs.size)

    y = np.concatenate([measured(specimen, stairs) for specimen in seen])
    labels = np.repeat(np.arange(groups), stairs.size)
    found = identify(Record(np.tile(stairs, groups), y, curves=labels), Plane(levels, **FIXED))
    inputs = np.concatenate([[low, high], chance.uniform(low, high, 30)])
    band = found.predict(inputs, bands=0.9)
    inside = []
    for specimen in others:
        reading = measured(specimen, inputs)
        inside.append((reading >= band.lower) & (reading <= band.upper))
    return float(np.mean(inside))
