"""Find the drawing function of a model or result, and show it in notebooks."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def figure_of(result: object, **options: Any) -> Any:
    """Return the matplotlib figure of a model or result, drawn by `minorloop.drawing`.

    The package is imported when something is drawn, so that results do not depend on it.

    Parameters
    ----------
    result : model or result
        The object to draw.
    **options
        Options of its drawing function, such as ``input_label``.
    """
    return import_module("minorloop.drawing").draw(result, **options)


class NotebookView:
    """A model or result that a notebook shows as a small figure and a table."""

    def _repr_html_(self) -> str:
        html: str = import_module("minorloop.drawing.notebook").as_html(self)
        return html
