"""Fits to records like real ones, and to real ones where these are at hand.

Without prior they are compared with a sparse programme and dense `nnls`, with the prior with
smoothing.
"""

from __future__ import annotations

import json
import sys
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, hstack, vstack

from benchmarks._plants import Array
from benchmarks._timing import FIXED, Row, best, in_child, seconds, within
from benchmarks.one_fit import peak_gigabytes
from minorloop import Preisach, identify
from minorloop.identification import Gaussian, Identification, Plane, Smooth
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.pipeline import Options
from minorloop.identification.prior import prior_of
from minorloop.lab.records import Record

NOISE = 1e-3
PROGRAMME = "clarabel"
"""Compared only where it is installed."""
COMPARED = ((50, 2_000, 0.1, 1.0), (100, 20_000, 3.0, 0.5))
"""Bands, samples, most seconds, and most times the programme's."""
LARGE = ((200, 20_000, 10.0, 2), (100, 1_000_000, 10.0, 2), (400, 100_000, 120.0, 4))
"""Bands, samples, most seconds and gigabytes."""
OPTIMAL = 1e-10
BANDED = ((100, 20_000, 5.0, 2), (200, 20_000, 10.0, 2))
"""Bands, samples, and most seconds and gigabytes with the prior and bands of the last third."""
LEAST, MOST = 0.85, 0.95
"""Share of the readings that bands of 90 % are to cover."""
DATA = Path(__file__).parents[2] / "shared" / "data"
PIEZO, FERRITE = "piezo_micromanipulator_minor_loops.csv", "bh_mnzn_ferrite.csv"
MAGNETS = (
    ("FeCo nanowires", "forc_feco_nanowires.csv", "field_Oe", "moment_emu", 1.5e-3),
    ("steel MSM 33", "forc_msm33.csv", "field_T", "moment_Am2", np.inf),
)
"""Words, file, columns, and largest error with the prior."""
NOT_WORSE = 1.1
"""Most error of the default fit, over the lesser of those with the prior and with smoothing."""


def a_record(bands: int, samples: int, seed: int = 1000) -> tuple[Preisach, Array, Array]:
    """A smooth ridge, half a decaying cosine and half ramps of 10 samples, and noisy outputs."""
    rng, half = np.random.default_rng(seed), samples // 2
    time = np.arange(half)
    decay = np.cos(2 * np.pi * 25 * time / 10_000) * (1 - time / half)
    rest = np.arange(samples - half) / 10
    ends = rng.uniform(-1, 1, int(rest[-1]) + 2)
    u = np.concatenate([decay, np.interp(rest, np.arange(ends.size), ends)])
    levels = np.linspace(-1, 1, bands + 1)
    middle = (levels[1:] + levels[:-1]) / 2
    width, centre = middle[:, None] - middle, middle[:, None] + middle
    ridge = np.tril(np.exp(-8 * (width - 0.5) ** 2 - 2 * centre**2))
    model = Preisach(levels, ridge / ridge.sum())
    y = model.simulate(u)
    return model, u, y + NOISE * np.ptp(y) * rng.normal(size=samples)


def violation(model: Preisach, u: Array, y: Array, most: int = 300) -> float:
    """Violation of the optimality conditions of a fit without prior, from simulated outputs.

    The column of a cell is simulated with a unit weight in this cell; of more than ``most`` cells,
    some are drawn. Columns have unit length, and the outputs a norm of one about their mean.
    """
    left = (model.simulate(u) - y) / np.linalg.norm(y - y.mean())
    worst = abs(left.sum()) / np.sqrt(u.size)
    cells = np.argwhere(np.tril(np.ones_like(model.weights)))
    for i, j in np.random.default_rng(0).permutation(cells)[:most]:
        unit = np.zeros_like(model.weights)
        unit[i, j] = 1.0
        column = Preisach(model.levels, unit).simulate(u)
        slope = float(column @ left / np.linalg.norm(column))
        worst = max(worst, abs(slope) if model.weights[i, j] > 0 else -slope)
    return float(worst)


def programme(bands: int, u: Array, y: Array) -> float:
    """Least sum of squares by the sparse programme in Everett values and predictions.

    Unknowns are the nodes, one prediction for each sample and the output in negative saturation.
    """
    import clarabel

    levels, samples = np.linspace(-1, 1, bands + 1), u.size
    matrix = DesignMatrix(PlaneSpec(levels), u, np.ones(samples, dtype=bool), "negative")
    cells, unit, middle = matrix.spec.cells, float(np.ptp(y)), float(y.mean())
    parent, sample = matrix.parent, np.arange(samples)
    before = np.where(parent < 0, samples, parent)
    rows = np.repeat(sample, 6)
    nodes = coo_array(
        (-2 * matrix.coefficient.ravel(), (rows, matrix.index.ravel())), shape=(samples, cells)
    )
    link = coo_array((-np.ones(samples), (sample, before)), shape=(samples, samples + 1))
    own = eye_array(samples, samples + 1)
    equations = hstack([nodes, own + link])
    weights = hstack([-mixed_differences(bands), csc_array((cells, samples + 1))])
    square = np.concatenate([np.zeros(cells), np.ones(samples), [0.0]])
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.direct_solve_method = False, "qdldl"
    solved = clarabel.DefaultSolver(
        diags_array(square).tocsc(),
        np.concatenate([np.zeros(cells), (middle - y) / unit, [0.0]]),
        vstack([equations, weights]).tocsc(),
        np.zeros(samples + cells),
        [clarabel.ZeroConeT(samples), clarabel.NonnegativeConeT(cells)],
        settings,
    ).solve()
    predicted = middle + unit * np.array(solved.x)[cells : cells + samples]
    return float(np.sum((predicted - y) ** 2))


def mixed_differences(bands: int) -> csc_array:
    """Weights of the cells from Everett values at the nodes, both packed row by row."""
    i, j = np.tril_indices(bands)
    cell = np.arange(i.size)
    corners = ((cell, 1.0, j <= i), (cell - i, -1.0, j < i), (cell + 1, -1.0, j < i))
    corners += ((cell - i + 1, 1.0, j + 1 < i),)
    rows = np.concatenate([cell[there] for _, _, there in corners])
    columns = np.concatenate([node[there] for node, _, there in corners])
    values = np.concatenate([np.full(there.sum(), sign) for _, sign, there in corners])
    return csc_array((values, (rows, columns)), shape=(i.size, i.size))


def rows(quick: bool = False) -> list[Row]:
    if quick:
        return [_compared(20, 500, 0.1, 1.0), *_defaults()[-1:]]
    found = [_against_nnls(*COMPARED[0][:2])]
    found += [_compared(*case) for case in COMPARED]
    found += [_large(*case) for case in LARGE]
    found += _defaults() + [_banded(*case) for case in BANDED]
    needed = (PIEZO, FERRITE, *(magnet[1] for magnet in MAGNETS))
    missing = [name for name in needed if not (DATA / name).exists()]
    if missing:
        return [*found, Row(f"real records: {', '.join(missing)} not in shared/data", 0.0)]
    found += [_piezo(), *(_magnet(*each) for each in MAGNETS)]
    return found + [_deeper(*each[:4]) for each in MAGNETS] + [*_between(), *_ferrite()]


def _compared(bands: int, samples: int, most: float, times: float) -> Row:
    """A fit within so many seconds, and so many times those of the sparse programme."""
    model, u, y = a_record(bands, samples)
    fits, squares = [], []
    ours = [lambda: fits.append(identify(u, y, Plane(model.levels, **FIXED), prior=Smooth(0.0)))]
    theirs = [lambda: squares.append(programme(bands, u, y))] * bool(find_spec(PROGRAMME))
    ours[0]()  # loads the kernels
    rounds = 9 if samples < 10_000 else 3
    elapsed, *others = best(*ours, *theirs, rounds=rounds)
    kkt = violation(fits[-1].model, u, y)
    accuracy, met = f"kkt {kkt:.0e}", elapsed <= most and kkt <= OPTIMAL
    required = f"<= {most:g} s"
    if theirs:
        excess = u.size * fits[-1].rmse ** 2 / squares[-1] - 1
        accuracy += f", objective {excess:+.0e} of theirs"
        required += f" and <= {times:g} times as long"
        met = met and elapsed <= times * others[0]
    what = f"identify L = {bands}, N = {samples:,}, like real, no prior"
    other = (PROGRAMME, others[0], elapsed / others[0]) if theirs else ("", None, None)
    return Row(what, elapsed, *other, required=required, met=bool(met), accuracy=accuracy)


def _against_nnls(bands: int, samples: int) -> Row:
    model, u, y = a_record(bands, samples)
    plain = DesignMatrix(
        PlaneSpec(model.levels), u, np.ones(samples, dtype=bool), "negative"
    ).dense()
    dense, norms = np.column_stack([plain, -plain[:, -1]]), []
    elapsed = seconds(lambda: norms.append(nnls(dense, y, maxiter=100_000)[1]))
    fit = identify(u, y, Plane(model.levels, **FIXED), prior=Smooth(0.0))
    excess = u.size * fit.rmse**2 / norms[0] ** 2 - 1
    what = f"nnls L = {bands}, N = {samples:,}, like real, matrix given"
    accuracy = f"our objective {excess:+.0e} of its"
    return Row(
        what, elapsed, required="same to 1e-8", met=bool(abs(excess) <= 1e-8), accuracy=accuracy
    )


def _large(bands: int, samples: int, most: float, gigabytes: float) -> Row:
    """A fit in a child, within so many seconds and gigabytes."""
    figures = json.loads(in_child("-m", "benchmarks.real_records", bands, samples))
    accuracy = f"kkt {figures['kkt']:.0e}; peak {figures['peak_gb']:.2f} of {gigabytes} GB"
    good = figures["kkt"] <= OPTIMAL and figures["peak_gb"] <= gigabytes
    what = f"identify L = {bands}, N = {samples:,}, like real, no prior"
    return within(what, figures["seconds"], most, accuracy, good)


def _defaults() -> list[Row]:
    """Default fits of records of few samples."""
    cases = [(*a_record(50, 2_000)[1:], 50, 0.5)]
    cases += [
        (*a_wire(samples), bands, most) for samples, bands, most in ((358, 25, 0.3), (62, 40, 0.5))
    ]
    found = []
    for inputs, outputs, bands, most in cases:
        fits = list[Identification]()
        identified = partial(identify, inputs, outputs, Plane(bands, **FIXED))
        took = best(lambda: fits.append(identified()), rounds=5)[0]  # noqa: B023
        what = f"identify L = {bands}, N = {inputs.size:,}, like real, default"
        banded = fits[-1].posterior is not None
        found.append(within(what, took, most, f"kkt {fits[-1].kkt:.0e}", banded))
    return found


def a_wire(samples: int, seed: int = 1000) -> tuple[Array, Array]:
    """Ramps of 8 samples, and the output of a wire that transforms over a range of its input."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(0, 1, samples // 8 + 3)
    u = np.interp(np.arange(samples) / 8, np.arange(ends.size), ends)
    centre, half = np.linspace(0.3, 0.7, 40), 0.08 + 0.05 * rng.random(40)
    place, y = np.zeros(40), np.empty(samples)
    for k, value in enumerate(u):
        place = np.clip(place, value - half, value + half)
        y[k] = np.mean(1 / (1 + np.exp(-25 * (place - centre)))) + 0.05 * value
    return u, y + 2 * NOISE * rng.normal(size=samples)


def _banded(bands: int, samples: int, most: float, gigabytes: float) -> Row:
    """A fit with the prior to two thirds and bands of the last, in a child."""
    figures = json.loads(in_child("-m", "benchmarks.real_records", bands, samples, "bands"))
    accuracy = f"{figures['inside']:.1%} of the readings within; error {figures['error']:.3%}; "
    accuracy += f"peak {figures['peak_gb']:.2f} of {gigabytes} GB"
    good = LEAST <= figures["inside"] <= MOST and figures["peak_gb"] <= gigabytes
    what = f"identify L = {bands}, N = {samples:,}, like real, prior and bands"
    return within(what, figures["seconds"], most, accuracy, good)


def _piezo() -> Row:
    table = np.genfromtxt(DATA / PIEZO, delimiter=",", names=True)[200:7000]
    u, y = table["input_V"], table["displacement_um"]
    options = {
        "levels": 25,
        "holdout": 0.3676,
        **dict.fromkeys(("lag", "diagonal", "slope"), "auto"),
    }
    plain = Options.of({"prior": "none", **options}).identify(Record(u, y))
    found = []
    took = seconds(
        lambda: found.append(Options.of({"prior": "gaussian", **options}).identify(Record(u, y)))
    )
    prior = found[0]
    scored = np.flatnonzero(prior.held_out)
    inside = np.abs((prior.prediction - prior.y)[scored]) <= PER_DEVIATION * prior.deviation(scored)
    errors = prior.holdout_nrmse, plain.holdout_nrmse
    return _held_out("piezo stage", took, *errors, inside.mean(), 4.8e-3)


def _magnet(words: str, name: str, field: str, moment: str, most: float) -> Row:
    """Every other reversal curve is fitted, the others are predicted."""
    u, y = _curves(name, field, moment, 0)
    options = {"levels": 51, "spacing": "adaptive", "start": "positive", **FIXED}
    plain = Options.of({"prior": "none", **options}).identify(Record(u, y))
    found = []
    took = seconds(
        lambda: found.append(Options.of({"prior": "gaussian", **options}).identify(Record(u, y)))
    )
    prior = found[0]
    u, y = _curves(name, field, moment, 1)
    seen = np.isfinite(y)
    span = float(np.ptp(y[seen]))
    errors = [
        float(np.sqrt(np.mean((fit.model.simulate(u, "positive") - y)[seen] ** 2))) / span
        for fit in (prior, plain)
    ]
    inside = prior.predict(u, bands=0.9).covers(y)
    return _held_out(words, took, *errors, inside, most)


def _deeper(words: str, name: str, field: str, moment: str) -> Row:
    """The shallower half of the reversal curves is fitted, the others are predicted."""
    u, y = _curves(name, field, moment, 0, 1)
    top = u.max()
    depth = np.minimum.reduceat(u, np.flatnonzero(u == top))[np.cumsum(u == top) - 1]
    deep = depth < np.median(np.unique(depth))
    levels = np.unique(np.append(u.min(), np.quantile(u, np.linspace(0, 1, 26))))
    fits = []
    took = seconds(
        lambda: fits.append(
            identify(Record(u[~deep], y[~deep], start="positive"), Plane(levels, **FIXED))
        )
    )
    bands, seen = fits[0].predict(u[deep], bands=0.9), y[deep]
    inside = bands.covers(seen)
    half = float(bands.half_width.mean() / np.ptp(y[np.isfinite(y)]))
    return Row(
        f"{words}, curves deeper than those fitted",
        took,
        required=f"bands cover >= {LEAST:g}",
        met=inside >= LEAST,
        accuracy=f"bands cover {inside:.0%}, half as wide as {half:.0%} of the range",
    )


def _between() -> list[Row]:
    """Every fifth reversal curve without outputs, in the record of the others."""
    words, name, field, moment, _ = MAGNETS[0]
    u, y = _curves(name, field, moment, 0, 1)
    out = np.cumsum(u == u.max()) % 5 == 3
    errors, took = {}, 0.0
    for prior in ("gaussian", "none", "auto"):
        fits = list[Identification]()
        record = Record(u, np.where(out, np.nan, y), start="positive")
        law = Plane(51, spacing="adaptive", **FIXED)
        identified = partial(identify, record, law, prior=prior_of(prior))
        took = seconds(lambda: fits.append(identified()))  # noqa: B023
        off = (fits[0].prediction - y)[out & np.isfinite(y)]
        errors[prior] = float(np.sqrt(np.mean(off**2)) / np.ptp(y[out & np.isfinite(y)]))
    return [_default(f"{words}, every fifth curve without outputs, default", took, errors)]


def _default(what: str, took: float, errors: dict[str, float]) -> Row:
    """Error of the default fit beside those with the prior and with smoothing."""
    return Row(
        what,
        took,
        required=f"<= {NOT_WORSE:g} of the better",
        met=errors["auto"] <= NOT_WORSE * min(errors["gaussian"], errors["none"]),
        accuracy=f"{errors['auto']:.3%}; prior {errors['gaussian']:.3%}, "
        f"smoothness {errors['none']:.3%}",
    )


def _held_out(
    words: str, took: float, prior: float, plain: float, inside: float, most: float
) -> Row:
    return Row(
        f"{words}, held out, with the prior",
        took,
        required="error <= 1.02 of smoothness"
        + f", {most:.2%}" * bool(np.isfinite(most))
        + "; bands 0.8 to 0.98",
        met=bool(prior <= min(1.02 * plain, most) and 0.8 <= inside <= 0.98),
        accuracy=f"{prior:.3%}, smoothness {plain:.3%}; bands cover {inside:.0%}",
    )


def _curves(name: str, field: str, moment: str, first: int, step: int = 2) -> tuple[Array, Array]:
    """Every other curve of a file of reversal curves, each from the largest field."""
    table = np.genfromtxt(DATA / name, delimiter=",", names=True, dtype=None, encoding="utf-8")
    u, y = [], []
    for curve in np.unique(table["curve"])[first::step]:
        part = table[(table["curve"] == curve) & (table["kind"] == "curve")]
        u += [table[field].max(), *part[field]]
        y += [np.nan, *part[moment]]
    return np.array(u), np.array(y)


def _ferrite() -> list[Row]:
    """Loops of a ferrite, each predicted by the others."""
    table = np.genfromtxt(DATA / FERRITE, delimiter=",", names=True)
    loop, u, y = table["loop"], table["H_A_per_m"], table["B_T"]
    found = []
    for out in np.unique(loop):
        errors, took, kept = {}, 0.0, loop != out
        for prior in ("gaussian", "none", "auto"):
            fits = list[Identification]()
            record = Record(u[kept], y[kept], curves=loop[kept], start_of_curve="demagnetised")
            identified = partial(identify, record, Plane(25, **FIXED), prior=prior_of(prior))
            took = seconds(lambda: fits.append(identified()))  # noqa: B023
            off = fits[0].predict(u[~kept], curves=loop[~kept]) - y[~kept]
            errors[prior] = float(np.sqrt(np.mean(off**2)) / np.ptp(y[~kept]))
        what = f"ferrite, loop to {u[~kept].max():.0f} A/m held out, default"
        found.append(_default(what, took, errors))
    return found


def main(bands: int, samples: int, banded: bool) -> None:
    """``python -m benchmarks.real_records BANDS SAMPLES [bands]``: seconds, memory and accuracy."""
    options = FIXED | ({"holdout": 1 / 3} if banded else {"smoothness": 0.0})
    for sizes in ((10, 500), (50, 2_000), (20, 30_000)):
        small, u, y = a_record(*sizes)
        found = Options.of({"levels": small.levels, **options}).identify(
            Record(u, y)
        )  # loads the kernels
    if banded:
        identify(u[:500], y[:500], Plane(30, **FIXED), prior=Gaussian()).predict(u[:9], bands=0.9)
    model, u, y = a_record(bands, samples)
    fits = []

    def work() -> None:
        found = Options.of({"levels": model.levels, **options}).identify(Record(u, y))
        fits.append((found, found.deviation(np.flatnonzero(found.held_out)) if banded else None))

    figures = {"seconds": seconds(work), "peak_gb": peak_gigabytes()}
    found, deviation = fits[0]
    if banded:
        off = (found.prediction - y)[found.held_out]
        figures["inside"] = float(np.mean(np.abs(off) <= PER_DEVIATION * deviation))
        off = (found.prediction - model.simulate(u))[found.held_out]
        figures["error"] = float(np.sqrt(np.mean(off**2)) / np.ptp(y))
    else:
        figures["kkt"] = violation(found.model, u, y, 100)
    print(json.dumps(figures))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:] == ["bands"])
