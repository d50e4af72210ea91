"""The report of the study of fewer holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from papers.design import run_study
from papers.drawing import draw, level, panel
from papers.harness import Results, Study

_LOOKS = {
    "staircase": ("decaying staircase, no prior", "C3", "s"),
    "random": ("random inputs, prior", "0.6", "v"),
    "design": ("designed without data, prior", "C2", "^"),
    "adaptive": ("chosen one by one, prior", "C0", "o"),
}
_NAMES = {"ipmc": "ionic polymer strip", "fibre": "polyaniline fibre"}
_TICKS = ((8, 12, 16, 20, 28, 56), (0.5, 1, 2, 5, 10))


def draw_curves(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw the positioning error against the number of holds, median and middle half."""
    panels = []
    for twin, title in _NAMES.items():
        lines: list[Any] = []
        for method, (words, colour, mark) in _LOOKS.items():
            curves = [run[twin]["curves"][method] for run in runs]
            holds = curves[0]["holds"]
            errors = 100 * np.array([curve["positioning"] for curve in curves])
            low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75], axis=0)
            lines.append((holds, middle, f"{colour} {mark}- 1.2", words))
            lines.append(partial(_band, x=holds, ends=(low, high), color=colour))
        y = "positioning error, rms [% of full scale]"
        frame: dict[str, Any] = {"title": title, "xscale": "log", "yscale": "log"}
        panels.append(panel("settled holds", y, *lines, _ticks, legend={"fontsize": 9}, **frame))
    return draw(*panels, columns=2, height=4.2, sharey=True)


def _band(axes: Any, x: Any, ends: Any, color: str) -> None:
    axes.fill_between(x, *ends, color=color, alpha=0.15, lw=0)


def _ticks(axes: Any) -> None:
    axes.set(xscale="log", yscale="log")
    for axis, places in zip((axes.xaxis, axes.yaxis), _TICKS, strict=True):
        axis.set_ticks(places, [f"{each:g}" for each in places])
    axes.minorticks_off()


def draw_bands(one: Results) -> Any:
    """Draw predictions of unseen inputs with bands, and the chosen inputs."""
    half = np.vstack([one.shown.half_width, one.shown.half_width]) / one.scale * 100
    error = (one.shown.y - one.truth) / one.scale * 100
    style = {"fmt": "o", "ms": 3, "lw": 0.9, "color": "C0", "label": "90 % band"}
    y, hold = "predicted minus true [% of full scale]", np.arange(1, one.inputs.size + 1)
    return draw(
        panel(
            "unseen input", y, level(0.0),
            lambda axes: axes.errorbar(np.arange(one.truth.size), error, half, **style),
        ),
        panel(
            "hold", "input chosen [V]", (hold, one.inputs, "C0 o- 0.7"),
            lambda axes: axes.axvline(12.5, color="0.5", lw=0.8, ls="--"),
        ),
        columns=2, width_ratios=[2, 1],
    )  # fmt: skip


STUDY = Study(
    "design", "Fewer holds: prior, bands and the next best input", run_study, page=__name__
)
