"""The report of the study of fewer holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from papers.design import METHODS, Comparison, gather, run_study
from papers.drawing import new_figure
from papers.harness import Study

_LOOKS = {
    "staircase": ("decaying staircase, no prior", "C3", "s"),
    "random": ("random inputs, prior", "0.6", "v"),
    "design": ("designed without data, prior", "C2", "^"),
    "adaptive": ("chosen one by one, prior", "C0", "o"),
}
_NAMES = {"ipmc": "ionic polymer strip", "fibre": "polyaniline fibre"}


def draw_curves(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw the positioning error against the number of holds, median and middle half."""
    figure, axes = new_figure(1, 2, height=4.2, sharey=True)
    for one, twin in zip(axes, _NAMES, strict=True):
        for method in METHODS:
            words, colour, marker = _LOOKS[method]
            curves = [run[twin]["curves"][method] for run in runs]
            holds = curves[0]["holds"]
            errors = 100 * np.array([curve["positioning"] for curve in curves])
            low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75], axis=0)
            one.plot(holds, middle, marker=marker, ms=5, lw=1.2, color=colour, label=words)
            one.fill_between(holds, low, high, color=colour, alpha=0.15, lw=0)
        one.set(xscale="log", yscale="log", title=_NAMES[twin], xlabel="settled holds")
        one.set_xticks([8, 12, 16, 20, 28, 56], ["8", "12", "16", "20", "28", "56"], minor=False)
        one.set_yticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
        one.minorticks_off()
    axes[0].set_ylabel("positioning error, rms [% of full scale]")
    axes[0].legend(frameon=False, fontsize=9)
    return figure


def draw_bands(one: Comparison) -> Any:
    """Draw predictions of unseen inputs with bands, and the chosen inputs."""
    figure, (left, right) = new_figure(1, 2, height=3.8, width_ratios=[2, 1])
    sample = np.arange(one.truth.size)
    half = np.vstack([one.shown.half_width, one.shown.half_width]) / one.scale * 100
    error = (one.shown.y - one.truth) / one.scale * 100
    left.errorbar(sample, error, half, fmt="o", ms=3, lw=0.9, color="C0", label="90 % band")
    left.axhline(0.0, color="0.3", lw=0.8)
    left.set(xlabel="unseen input", ylabel="predicted minus true [% of full scale]")
    left.legend(frameon=False)
    hold = np.arange(1, one.inputs.size + 1)
    right.plot(hold, one.inputs, "o-", ms=4, lw=0.7, color="C0")
    right.axvline(12.5, color="0.5", lw=0.8, ls="--")
    right.set(xlabel="hold", ylabel="input chosen [V]")
    return figure


STUDY = Study(
    "design",
    "Fewer holds: prior, bands and the next best input",
    run_study,
    gather,
    page=__name__,
)
