"""HTML of models and results for notebooks: a small figure and a table."""

from __future__ import annotations

import base64
from dataclasses import fields, is_dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop._modelschema import StaticModel
from minorloop.drawing.identification import draw_loop_and_plane
from minorloop.drawing.operators import input_range
from minorloop.figures import plot
from minorloop.operators.relays import RelayModel

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

Rows = list[tuple[str, str]]

_WIDTH = 640
"""Width of the picture in pixels, at most."""


def as_html(result: Any) -> str:
    """Return figure, table and advice of a model or result that `minorloop.plot` draws.

    A result without a table of its own is shown as it prints.
    """
    name = type(result).__name__
    rows = _summary(result)
    text = _table(rows) if rows else f"<pre>{escape(str(result))}</pre>"
    advice = getattr(result, "advice", getattr(result, "notes", ())) if rows else ()
    figure = (
        draw_loop_and_plane(result, **result.drawn_labels)
        if name == "Identification"
        else plot(result)
    )
    return f"<div><b>{name}</b>{text}{_list(advice)}{_picture(figure)}</div>"


def _picture(figure: Any) -> str:
    """Return the figure as PNG, which web pages that show notebooks accept too."""
    data = base64.b64encode(figure._repr_png_()).decode()
    style = f"width:100%;max-width:{_WIDTH}px"
    return f'<img alt="figure" style="{style}" src="data:image/png;base64,{data}">'


def _table(rows: Rows) -> str:
    cells = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{''.join(cells)}</table>"


def _list(sentences: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""


def _summary(result: Any) -> Rows:
    """Rows of a result, or the parameters of an operator with its ranges; none of other types."""
    if hasattr(result, "summary"):
        return [*result.summary()]
    if not isinstance(result, StaticModel):
        return []
    ranges = [("input", input_range(result))]
    if not isinstance(result, RelayModel):
        ranges.append(("output", result.range))
    rows = [(name, f"{low:.6g} to {high:.6g}") for name, (low, high) in ranges]
    return [*rows, *_parameters(result)]


def _parameters(model: Any) -> Iterator[tuple[str, str]]:
    """Yield the parameters of a model; for arrays, their shapes and ranges."""
    for one in fields(model):
        value = getattr(model, one.name)
        if is_dataclass(value):
            yield from _parameters(value)
        elif isinstance(value, np.ndarray):
            shape = " x ".join(map(str, value.shape))
            yield one.name, f"{shape} from {value.min():.6g} to {value.max():.6g}"
        else:
            yield one.name, value if isinstance(value, str) else f"{value:.6g}"
