"""HTML of models and results for notebooks: a small figure and a table."""

from __future__ import annotations

import base64
import io
from html import escape
from typing import TYPE_CHECKING, Any

from minorloop.drawing.identification import draw_loop_and_plane
from minorloop.drawing.operators import input_range
from minorloop.figures import plot

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

Rows = list[tuple[str, str]]

_RESOLUTION = 80
"""Dots per inch: sharp enough for a cell, and a few tens of kilobytes in the saved notebook."""
_WIDTH = 640
"""Width of the picture in pixels, at most."""


def as_html(result: Any) -> str:
    """Return figure, table and advice of a model or result that `minorloop.plot` draws.

    A result without a table of its own is shown as it prints.
    """
    name = type(result).__name__
    rows = _ROWS[name](result) if name in _ROWS else _summary(result)
    text = _table(rows) if rows else f"<pre>{escape(str(result))}</pre>"
    advice = getattr(result, "advice", getattr(result, "notes", ())) if rows else ()
    figure = draw_loop_and_plane(result) if name == "Identification" else plot(result)
    return f"<div><b>{name}</b>{text}{_list(advice)}{_picture(figure)}</div>"


def _picture(figure: Any) -> str:
    """Return the figure as PNG: also pages that show notebooks accept it."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_RESOLUTION)
    data = base64.b64encode(content.getvalue()).decode()
    style = f"width:100%;max-width:{_WIDTH}px"
    return f'<img alt="figure" style="{style}" src="data:image/png;base64,{data}">'


def _table(rows: Rows) -> str:
    cells = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{''.join(cells)}</table>"


def _list(sentences: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""


def _summary(result: Any) -> Rows:
    return [*result.summary()] if hasattr(result, "summary") else []


def _preisach(model: Any) -> Rows:
    return [
        ("bands", f"{model.bands}"),
        *_ranges(model),
        ("offset", f"{model.offset:.6g}"),
        ("slope", f"{model.slope:.6g}"),
        ("relay", model.relay),
        ("diagonal", model.diagonal),
    ]


def _relays(model: Any) -> Rows:
    return [
        ("levels", f"{model.levels.size}"),
        ("input", _interval(input_range(model))),
        ("offset", f"{model.offset:.6g}"),
        ("relay", model.relay),
    ]


def _plays(model: Any) -> Rows:
    return [
        ("plays", f"{model.radii.size}"),
        ("radii", _interval((model.radii[0], model.radii[-1]))),
        ("slope after a reversal", f"{model.slopes[0]:.6g}"),
        ("slope with all plays", f"{model.slopes[-1]:.6g}"),
        ("offset", f"{model.offset:.6g}"),
    ]


def _bent_plays(model: Any) -> Rows:
    zones = [("dead zones", f"{model.zones.thresholds.size}"), ("output", _interval(model.range))]
    return [*_plays(model.plays)[:-1], *zones, ("offset", f"{model.offset:.6g}")]


def _polynomial(model: Any) -> Rows:
    terms = [(f"coefficient of u^{k}", f"{c:.6g}") for k, c in enumerate(model.coefficients)]
    return [("degree", f"{len(terms) - 1}"), *_ranges(model), *terms]


def _ranges(model: Any) -> Rows:
    return [("input", _interval(input_range(model))), ("output", _interval(model.range))]


def _interval(ends: tuple[float, float]) -> str:
    return f"{ends[0]:.6g} to {ends[1]:.6g}"


_ROWS: dict[str, Callable[[Any], Rows]] = {
    "Preisach": _preisach,
    "RelayModel": _relays,
    "PrandtlIshlinskii": _plays,
    "GeneralisedPrandtlIshlinskii": _bent_plays,
    "Polynomial": _polynomial,
}
