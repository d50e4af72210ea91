"""Figures that show themselves."""

import io

from matplotlib.figure import Figure

_RESOLUTION = 80
"""Dots per inch: sharp enough for a cell, and a few tens of kilobytes in the saved notebook."""


class ShownFigure(Figure):
    """A figure that a notebook shows without a magic line."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=_RESOLUTION)
        return content.getvalue()
