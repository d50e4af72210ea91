"""Formulas as MathML, drawn by the browser: no script, no font, no network.

docutils translates LaTeX to MathML; Sphinx only has to be told to take it.
"""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging


def translated(node: nodes.Element, *, as_block: bool) -> str:
    """The formula as MathML; one that docutils cannot read is a warning, and stays as it is."""
    text = node.astext().strip()
    try:
        return str(latex2mathml.tex2mathml(text, as_block=as_block))
    except MathError as error:
        logging.getLogger(__name__).warning("%s: %s", text, error, location=node)
        return text


def inline(self: Any, node: nodes.math) -> None:
    self.body.append(translated(node, as_block=False))
    raise nodes.SkipNode


def displayed(self: Any, node: nodes.math_block) -> None:
    self.body.append(self.starttag(node, "div", CLASS="math"))
    self.body.append(translated(node, as_block=True))
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
