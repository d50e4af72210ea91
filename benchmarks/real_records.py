"""Fits without prior to a record like real ones, beside a sparse programme and dense `nnls`."""

from __future__ import annotations

import json
import sys
from importlib.util import find_spec

import numpy as np
from scipy.optimize import nnls
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, hstack, vstack

from benchmarks._plants import Array
from benchmarks._timing import Row, best, in_child, seconds, within
from benchmarks.one_fit import peak_gigabytes
from minorloop import Preisach, identify
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec

NOISE = 1e-3
PROGRAMME = "clarabel"
"""Compared only where it is installed."""
COMPARED = ((50, 2_000, 0.1, 1.0), (100, 20_000, 3.0, 0.5))
"""Bands, samples, most seconds, and most times the programme's."""
LARGE = ((200, 20_000, 10.0, 2), (100, 1_000_000, 10.0, 2), (400, 100_000, 120.0, 4))
"""Bands, samples, most seconds and gigabytes."""
OPTIMAL = 1e-10


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
        return [_compared(20, 500, 0.1, 1.0)]
    found = [_against_nnls(*COMPARED[0][:2])]
    found += [_compared(*case) for case in COMPARED]
    return found + [_large(*case) for case in LARGE]


def _compared(bands: int, samples: int, most: float, times: float) -> Row:
    """A fit within so many seconds, and so many times those of the sparse programme."""
    model, u, y = a_record(bands, samples)
    fits, squares = [], []
    ours = [lambda: fits.append(identify(u, y, levels=model.levels, smoothness=0.0))]
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
    fit = identify(u, y, levels=model.levels, smoothness=0.0)
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


def main(bands: int, samples: int) -> None:
    """``python -m benchmarks.real_records BANDS SAMPLES``: seconds, gigabytes and violation."""
    for sizes in ((10, 500), (50, 2_000), (20, 30_000)):
        small, u, y = a_record(*sizes)
        identify(u, y, levels=small.levels, smoothness=0.0)  # loads the kernels
    model, u, y = a_record(bands, samples)
    fits = []
    elapsed = seconds(lambda: fits.append(identify(u, y, levels=model.levels, smoothness=0.0)))
    figures = {"seconds": elapsed, "peak_gb": peak_gigabytes()}
    print(json.dumps({**figures, "kkt": violation(fits[0].model, u, y, 100)}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
