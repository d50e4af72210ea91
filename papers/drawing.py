"""Parts of the figures of all studies. Matplotlib is imported only when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.positioning_report import COLOURS, HOUR, MINUTE
from minorloop.report import Picture
from papers.claims import Claim, figure

__all__ = ["COLOURS", "HOUR", "MINUTE", "draw_specimens", "every_specimen", "new_figure"]


def every_specimen(
    claims: Sequence[Claim], runs: Sequence[Mapping[str, Any]], first_seed: int
) -> list[Picture]:
    """Return `draw_specimens` for a report, if there is more than one specimen."""
    if len(runs) == 1:
        return []
    said = f"Every specimen (points) and the median (bar), {len(runs)} in all."
    return [Picture(draw_specimens(claims, runs, first_seed), said)]


def draw_specimens(
    claims: Sequence[Claim], runs: Sequence[Mapping[str, Any]], first_seed: int
) -> Any:
    """Draw every bounded figure of every specimen, relative to its bound.

    A figure with an upper bound is divided by the bound, one with a lower bound divides it: values
    below 1 meet the bound.
    """
    from matplotlib.ticker import LogLocator

    bounded = [
        claim
        for claim in claims
        if (np.isfinite(claim.least) or (np.isfinite(claim.most) and claim.most > 0))
        and not isinstance(figure(runs[0], claim.key), bool)
    ]
    drawn, axes = new_figure(height=1.2 + 0.32 * len(bounded))
    rng = np.random.default_rng(first_seed)
    for row, claim in enumerate(bounded):
        values = np.array([float(figure(run, claim.key)) for run in runs])
        with np.errstate(divide="ignore"):
            share = values / claim.most if np.isfinite(claim.most) else claim.least / values
        height = row + rng.uniform(-0.15, 0.15, share.size)
        axes.plot(np.maximum(share, 1e-3), height, "o", ms=4, alpha=0.6, color="C0")
        axes.plot([max(float(np.median(share)), 1e-3)] * 2, [row - 0.3, row + 0.3], color="C1")
    axes.axvline(1.0, color="0.3", lw=1.0, ls="--")
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 300 * low else (1,)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter("")
    axes.set_yticks(range(len(bounded)), [claim.what for claim in bounded], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("figure over its bound (left of the dashed line: met)")
    return drawn
