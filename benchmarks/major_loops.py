"""Models fitted to a major loop alone against measured minor loops."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import minorloop as ml
from benchmarks._plants import Array
from benchmarks._timing import Row, seconds
from minorloop.identification import Identification
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.pipeline import Options
from minorloop.lab.columns import read_columns

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
LOOPS = (("ferrite MnZn", "bh_mnzn_ferrite.csv"), ("steel M130-27S", "bh_m130_27s_steel.csv"))
"""Symmetric loops at several amplitudes; the largest is the major loop."""
CURVES = (
    ("FeCo nanowires", "forc_feco_nanowires.csv", "field_Oe", "moment_emu"),
    ("rock MSM 33", "forc_msm33.csv", "field_T", "moment_Am2"),
)
"""First-order reversal curves; their first points are the descending branch of the major loop."""
EACH, SHORTEST = 5, 3
"""Every so many curves are compared, of more samples than that."""
BANDS, MOST = 25, 150
"""Of fits to the major loop: bands, and samples of a branch at most."""


@dataclass(frozen=True)
class Material:
    """A major loop and minor loops: ``major`` is the descending branch, inputs increasing."""

    start: str
    minor: list[tuple[Array, Array]]
    major: tuple[Array, Array]


def rows(quick: bool = False) -> list[Row]:
    if not DATA.is_dir():
        return [Row("models from major loops: no measured records in ../shared/data", 0.0)]
    named = [(name, of_loops(file)) for name, file in LOOPS]
    named += [(name, of_curves(*where)) for name, *where in CURVES]
    return [_fitted(name, material) for name, material in (named[:1] if quick else named)]


def _fitted(name: str, material: Material) -> Row:
    """Fits with the prior to the major loop alone, with mean zero and with a ridge."""
    u, y = material.major
    some = np.linspace(0, u.size - 1, min(u.size, MOST)).astype(int)
    down, branch = u[some][::-1], y[some][::-1]
    loop, seen = np.concatenate([down, -down]), np.concatenate([branch, -branch])
    results, times = [], []
    for mean in ("zero", "ridge"):
        fits: list[Identification] = []
        times.append(seconds(lambda mean=mean, fits=fits: fits.append(_fit(loop, seen, mean))))
        off, whole, inside = 0.0, 0.0, []
        for inputs, outputs in material.minor:
            errors = fits[0].model.simulate(inputs, material.start) - outputs
            assert fits[0].posterior is not None
            sd = fits[0].posterior.deviation(inputs, material.start)
            inside.append(np.mean(np.abs(errors) <= PER_DEVIATION * sd))
            off, whole = off + float(errors @ errors), whole + float(outputs @ outputs)
        ridge = fits[0].ridge
        named = "zero" if ridge is None else f"{ridge.kind} ridge"
        results.append(f"{named}: {off / whole:.2%}, {np.mean(inside):.0%} in 90 % bands")
    accuracy = f"relative square error on minor loops with mean {'; '.join(results)}"
    return Row(f"prior on the major loop of {name}", times[1], accuracy=accuracy)


def _fit(u: Array, y: Array, mean: str) -> Identification:
    options = {
        "levels": BANDS,
        "spacing": "adaptive",
        "diagonal": "reversible",
        "slope": False,
        "lag": 0,
    }
    return Options.of({"prior": "gaussian", "mean": mean, "start": "positive", **options}).identify(
        ml.Record(u, y)
    )


def of_loops(file: str) -> Material:
    """Return the largest loop, and the others."""
    number, h, b = read_columns(DATA / file, ["loop", "H_A_per_m", "B_T"]).values()
    loops = [(h[number == k], b[number == k]) for k in np.unique(number)]
    field, flux = loops[-1]
    down = slice(int(np.argmin(field)), None, -1)  # from the least input back to the peak
    return Material("demagnetised", loops[:-1], (field[down], flux[down]))


def of_curves(file: str, input: str, output: str) -> Material:
    """Return the descending branch, and the curves from it within its inputs."""
    number, u, y = read_columns(DATA / file, ["curve", input, output]).values()
    measured = np.append(False, np.diff(number) == 0)  # the first row of each calibrates
    parts = [(number == k) & measured for k in np.unique(number)[::EACH]]
    curves = [(u[part], y[part]) for part in parts if np.count_nonzero(part) > SHORTEST]
    first = np.array([(field[0], moment[0]) for field, moment in curves])
    first = first[np.argsort(first[:, 0])]
    highest = float(min(-first[0, 0], u[measured].max()))
    order = np.argsort(u[measured])
    top = float(np.interp(highest, u[measured][order], y[measured][order]))
    inside = [(u[abs(u) <= highest], y[abs(u) <= highest]) for u, y in curves]
    minor = [curve for curve in inside if curve[0].size > SHORTEST]
    branch = np.vstack([first, [highest, top]]).T
    return Material("positive", minor, (branch[0], branch[1]))
