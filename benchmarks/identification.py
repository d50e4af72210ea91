"""Identification against dense non-negative least squares, and how it grows."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from benchmarks._timing import Row, best, in_child
from benchmarks.one_fit import a_record
from minorloop import identify
from minorloop.identification.areas import Areas, Form


def rows() -> list[Row]:
    found, dense = [], []
    for kind in ("smooth", "rough"):
        row, seconds = _against_nnls(kind)
        found.append(row)
        dense.append(seconds)
    limit = 5 * max(dense)
    for bands, samples, most, smoothness in (
        (100, 20_000, 4, "0"),
        (100, 20_000, 4, "auto"),
        (100, 100_000, 8, "0"),
        (200, 20_000, 8, "0"),
        (200, 20_000, 8, "auto"),
    ):
        figures = in_child("benchmarks.one_fit", bands, samples, smoothness)
        in_time = figures["seconds"] <= limit or (bands, samples, smoothness) != (100, 20_000, "0")
        met = figures["kkt"] <= 1e-6 and figures["peak_gb"] <= most and in_time
        asked = f"kkt <= 1e-6, {most} GB"
        if (bands, samples, smoothness) == (100, 20_000, "0"):
            asked += f", {limit:.1f} s (5 dense nnls)"
        accuracy = f"kkt {figures['kkt']:.0e}, peak {figures['peak_gb']:.1f} GB"
        what = f"identify L = {bands}, N = {samples}, smoothness {smoothness}"
        found.append(Row(what, figures["seconds"], "s", asked, met, accuracy))
    for bands, samples in ((25, 20_000), (50, 20_000), (100, 2_000)):
        figures = in_child("benchmarks.one_fit", bands, samples, "0")
        what = f"identify L = {bands}, N = {samples}, smoothness 0"
        found.append(Row(what, figures["seconds"], "s", "", None, f"kkt {figures['kkt']:.0e}"))
    return found


def _against_nnls(kind: str) -> tuple[Row, float]:
    """L = 50, N = 2,000; and the seconds that the dense solver took."""
    model, u, y = a_record(50, 2000, rough=kind == "rough")
    areas = Areas(Form(model.levels), u, np.ones(u.size, dtype=bool), "negative")
    matrix = areas.matrix()
    dense = np.column_stack([matrix, -matrix[:, -1]])
    fits, norms = [], []
    ours, theirs = best(
        lambda: fits.append(identify(u, y, levels=model.levels, smoothness=0.0)),
        lambda: norms.append(nnls(dense, y)[1]),
        rounds=4,
    )
    norm = np.sqrt(u.size) * fits[-1].rmse
    accuracy = f"objectives agree to {abs(norm / norms[-1] - 1):.0e}"
    what = f"identify L = 50, N = 2000, {kind} plane: dense nnls / ours"
    return Row(what, theirs / ours, "x", ">= 15", theirs / ours >= 15, accuracy), theirs
