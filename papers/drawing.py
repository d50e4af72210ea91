"""Drawing of the figures of all studies, as panels. Matplotlib is imported for the first one.

A panel is a function that paints axes; `panel`, `bars` and `photo` make those that studies share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.drawing.layout import new_figure
from minorloop.positioning_report import COLOURS, HOUR, MINUTE
from papers.claims import Claim, figure

__all__ = ["COLOURS", "HOUR", "MINUTE", "every_specimen", "new_figure"]

Paint: TypeAlias = Callable[[Any], None]
"""Draws on axes."""
WITH_ROOM = {"loc": "upper center", "bbox_to_anchor": (0.5, 1.2)}
"""Place of a legend above its axes."""
ABOVE = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 3}
"""The same in one row, for axes without a title."""


def draw(*panels: Paint, columns: int = 1, height: float = 3.8, **options: Any) -> Any:
    """Return a figure with panels, row by row; options are those of ``Figure.subplots``."""
    rows = -(-len(panels) // columns)
    drawn, axes = new_figure(rows, columns, height, squeeze=False, **options)
    for one in axes.flat[len(panels) :]:
        one.set_axis_off()
    for one, paint in zip(axes.flat, panels, strict=False):
        paint(one)
    return drawn


def panel(x: str, y: str, *lines: Any, legend: Any = None, **options: Any) -> Paint:
    """Return a panel of curves.

    ``x`` and ``y``: labels of the axes. ``lines``: abscissae, ordinates, look and, for a legend,
    words; or a panel to draw over. A look is a colour, a form of matplotlib such as ``o-``, and a
    width of the line or size of marks: ``C0 o- 0.8``. ``legend``: options of the legend.
    ``options``: as of ``Axes.set``.
    """

    def paint(axes: Any) -> None:
        for line in lines:
            if callable(line):
                line(axes)
                continue
            across, up, look, *words = line
            axes.plot(across, up, label=words[0] if words else None, **_style(look))
        axes.set(xlabel=x, ylabel=y, **options)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, **(legend or {}))

    return paint


def _style(look: str) -> dict[str, Any]:
    colour, *rest = look.split()
    form, size = (*rest, *("-", "1.0")[len(rest) :])
    line = next((each for each in ("--", "-", ":") if each in form), "")
    return {
        "color": colour,
        "ls": line or "none",
        "marker": form.replace(line, "") or None,
        "lw": float(size) if line else None,
        "ms": 3.5 if line else float(size),
    }


def on_axes(method: str, *values: Any, **options: Any) -> Paint:
    """Return a panel that calls a method of the axes."""
    return lambda axes: getattr(axes, method)(*values, **options)


def level(value: float, look: str = "0.3 - 0.8") -> Paint:
    """Return a horizontal line."""
    style = {key: each for key, each in _style(look).items() if key in ("color", "ls", "lw")}
    return on_axes("axhline", value, **style)


def bars(x: str, y: str, groups: Mapping[str, tuple[npt.ArrayLike, str]], **options: Any) -> Paint:
    """Return a panel of values (n,) by their words, with a colour each, side by side."""
    width = 0.8 / len(groups)

    def paint(axes: Any) -> None:
        for number, (words, (values, colour)) in enumerate(groups.items()):
            place = np.arange(np.size(values)) + 1
            shift = (number - 0.5 * (len(groups) - 1)) * width
            axes.bar(place + shift, values, width=0.96 * width, color=colour, label=words)
        axes.set_xticks(place)
        panel(x, y, level(0.0), **options)(axes)

    return paint


def photo(
    image: Any,
    title: str = "",
    *lines: Any,
    middle: npt.ArrayLike | None = None,
    half: float = np.inf,
    **options: Any,
) -> Paint:
    """Return a picture (H, W), if any, with lines over it, or the part of it about a pixel.

    ``lines``: as of `panel`. ``middle`` (2,): the pixel; the whole picture is drawn without it.
    ``half``: half the side of the part in pixels. ``options``: as of ``Axes.imshow``.
    """

    def paint(axes: Any) -> None:
        axes.grid(False)
        panel("", "", *lines, title=title, xticks=[], yticks=[])(axes)
        if image is not None:
            axes.imshow(image, **{"cmap": "gray", "vmin": 0, "vmax": 255} | options)
        if middle is not None and np.isfinite([*np.ravel(middle), half]).all():
            u, v = np.ravel(middle)
            axes.set(xlim=(u - half, u + half), ylim=(v + half, v - half))

    return paint


def every_specimen(claims: Sequence[Claim], runs: Sequence[Mapping[str, Any]], seed: int) -> Any:
    """Draw every bounded figure of every specimen, relative to its bound; None of a single one.

    A figure with an upper bound is divided by the bound; a lower bound is divided by its figure:
    values below 1 meet the bound. Figures over all specimens together are left out.
    """
    if len(runs) == 1:
        return None
    from matplotlib.ticker import LogLocator

    bounded = []
    for claim in claims:
        # A count of 0 has no logarithm.
        limit = claim.most if np.isfinite(claim.most) and claim.most > 0 else claim.least
        with suppress(KeyError):
            found = [figure(run, claim.key) for run in runs]
            if np.isfinite(limit) and not isinstance(found[0], bool):
                bounded.append((claim, np.array(found, dtype=np.float64)))
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
