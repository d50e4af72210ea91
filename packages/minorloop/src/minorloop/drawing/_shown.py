"""Figures that show themselves."""

import io

from matplotlib.figure import Figure


class ShownFigure(Figure):
    """A figure that a notebook shows without a magic line."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        # Dots per inch: sharp enough for a cell, and a few tens of kilobytes in the saved notebook
        self.savefig(content, format="png", dpi=80)
        return content.getvalue()
