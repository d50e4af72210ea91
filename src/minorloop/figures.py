"""The way from a model or result to its figure."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def figure_of(result: object, **options: Any) -> Any:
    """Matplotlib figure of a model or result, drawn by `minorloop.drawing`.

    The package is looked up when something is drawn, so that no result depends on how it is drawn.

    Parameters
    ----------
    result : model or result
        What is drawn.
    **options
        Of its drawing function, such as ``input_label``.
    """
    return import_module("minorloop.drawing").draw(result, **options)
