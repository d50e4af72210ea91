"""Parts of the figures of all studies. Matplotlib is imported only when one is drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop.drawing.layout import new_figure
from minorloop.positioning_report import COLOURS, HOUR, MINUTE
from papers.claims import Claim, figure

__all__ = ["COLOURS", "HOUR", "MINUTE", "every_specimen", "new_figure"]


def every_specimen(claims: Sequence[Claim], runs: Sequence[Mapping[str, Any]], seed: int) -> Any:
    """Draw every bounded figure of every specimen, relative to its bound; None of a single one.

    A figure with an upper bound is divided by the bound, one with a lower bound divides it: values
    below 1 meet the bound. What is gathered over all specimens only is left out.
    """
    if len(runs) == 1:
        return None
    from matplotlib.ticker import LogLocator

    rows = [(claim, _values(claim, runs)) for claim in claims]
    bounded = [(claim, values) for claim, values in rows if values is not None]
    drawn, axes = new_figure(height=1.2 + 0.32 * len(bounded))
    rng = np.random.default_rng(seed)
    for row, (claim, values) in enumerate(bounded):
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
    axes.set_yticks(range(len(bounded)), [claim.what for claim, _ in bounded], fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel("figure over its bound (left of the dashed line: met)")
    return drawn


def _values(claim: Claim, runs: Sequence[Mapping[str, Any]]) -> Any:
    """Return the figure (n,) of each specimen if it is a number with a bound, None otherwise."""
    bounded = np.isfinite(claim.least) or (np.isfinite(claim.most) and claim.most > 0)
    try:
        values = [figure(run, claim.key) for run in runs]
    except KeyError:
        return None
    numbers = not isinstance(values[0], bool)
    return np.array(values, dtype=np.float64) if bounded and numbers else None
