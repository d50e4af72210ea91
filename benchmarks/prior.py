"""What the prior costs, and what it is worth on real records where these are at hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks._timing import Row, best, dearer, seconds, within
from benchmarks.one_fit import a_record
from minorloop import excitation, identify
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.design import next_input
from minorloop.operators.memory import Memory

DATA = Path(__file__).parents[2] / "shared" / "data"
MAGNETS = (
    ("FeCo nanowires", "forc_feco_nanowires.csv", "field_Oe", "moment_emu"),
    ("steel MSM 33", "forc_msm33.csv", "field_T", "moment_Am2"),
)
PIEZO = "piezo_micromanipulator_minor_loops.csv"
ROWS, HELD = slice(200, 7000), 0.3676


def rows(quick: bool = False) -> list[Row]:
    bands, samples = (20, 2_000) if quick else (50, 20_000)
    return [*_few(), _many(bands, samples), *([] if quick else _records())]


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


def _records() -> list[Row]:
    """Held-out errors of real records with the prior and with smoothness."""
    missing = [name for name in (PIEZO, *(row[1] for row in MAGNETS)) if not (DATA / name).exists()]
    if missing:
        return [Row(f"records with the prior: {', '.join(missing)} not in shared/data", 0.0)]
    table = np.genfromtxt(DATA / PIEZO, delimiter=",", names=True)[ROWS]
    u, y = table["input_V"], table["displacement_um"]
    options = {"levels": 25, "lag": "auto", "holdout": HELD}
    plain = identify(u, y, **options, prior="none")
    found = []
    took = seconds(lambda: found.append(identify(u, y, **options, prior="gaussian")))
    prior = found[0]
    scored = np.flatnonzero(prior.held_out)
    inside = np.abs((prior.prediction - prior.y)[scored]) <= PER_DEVIATION * prior.deviation(scored)
    piezo = _row("piezo stage", took, prior.holdout_nrmse, plain.holdout_nrmse, inside.mean())
    return [piezo, *(_magnet(*each) for each in MAGNETS)]


def _magnet(words: str, name: str, field: str, moment: str) -> Row:
    """Every other reversal curve is fitted, the others are predicted."""
    u, y = _curves(name, field, moment, 0)
    options = {"levels": 51, "spacing": "adaptive", "start": "positive"}
    plain = identify(u, y, **options, prior="none")
    found = []
    took = seconds(lambda: found.append(identify(u, y, **options, prior="gaussian")))
    prior = found[0]
    u, y = _curves(name, field, moment, 1)
    seen = np.isfinite(y)
    span = float(np.ptp(y[seen]))
    errors = [
        float(np.sqrt(np.mean((fit.model.simulate(u, "positive") - y)[seen] ** 2))) / span
        for fit in (prior, plain)
    ]
    bands = prior.predict(u, bands=0.9)
    noise = prior.posterior.hyperparameters.noise * prior.posterior.unit
    reach = PER_DEVIATION * np.hypot(bands.sd, noise)
    return _row(words, took, *errors, np.mean(np.abs(bands.y - y)[seen] <= reach[seen]))


def _row(words: str, took: float, prior: float, plain: float, inside: float) -> Row:
    return Row(
        f"{words}, held out, with the prior",
        took,
        required="error <= 1.02 of smoothness, bands 0.8 to 0.98",
        met=bool(prior <= 1.02 * plain and 0.8 <= inside <= 0.98),
        accuracy=f"{prior:.3%}, smoothness {plain:.3%}; bands cover {inside:.0%}",
    )


def _curves(name: str, field: str, moment: str, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Every other curve of a file of reversal curves, each from the largest field."""
    table = np.genfromtxt(DATA / name, delimiter=",", names=True, dtype=None, encoding="utf-8")
    u, y = [], []
    for curve in np.unique(table["curve"])[first::2]:
        part = table[(table["curve"] == curve) & (table["kind"] == "curve")]
        u += [table[field].max(), *part[field]]
        y += [np.nan, *part[moment]]
    return np.array(u), np.array(y)
