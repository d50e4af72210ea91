"""New figures with axes, in one layout."""

from typing import Any

import numpy as np


def new_figure(
    rows: int = 1,
    columns: int = 1,
    height: float = 3.6,
    width: float = 9.2,
    *,
    grid: bool = True,
    **options: Any,
) -> tuple[Any, Any]:
    """Return a matplotlib figure, by default as wide as a page of a report, and its axes.

    ``rows`` and ``columns``: number of axes in each direction; ``height`` and ``width``: size in
    inches; ``grid``: whether the axes have a grid; ``**options``: options of ``Figure.subplots``.
    """
    from minorloop.drawing._shown import ShownFigure

    figure = ShownFigure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, **options)
    for one in np.atleast_1d(axes).ravel() if grid else ():
        one.grid(alpha=0.25)
    return figure, axes
