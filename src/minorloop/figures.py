"""Find the drawing function of a model or result."""

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
