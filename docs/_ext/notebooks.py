"""What the gallery of notebooks needs: figures of minorloop, and warnings as errors."""

from __future__ import annotations

import warnings
from typing import Any

from matplotlib import pyplot
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst


def figures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save the figures that a block drew: those of pyplot, and its last value if it is one."""
    drawn = [pyplot.figure(number) for number in pyplot.get_fignums()]
    last = block_vars["example_globals"].get("___")
    drawn += [last] if isinstance(last, Figure) else []
    paths = [next(block_vars["image_path_iterator"]) for _ in drawn]
    for figure, path in zip(drawn, paths, strict=True):
        figure.savefig(path, dpi=100)
    pyplot.close("all")
    return str(figure_rst(paths, gallery_conf["src_dir"]))


def strictly(gallery_conf: dict[str, Any], fname: str, when: str) -> None:
    """Make warnings errors in a notebook, and only there."""
    pyplot.close("all")
    if when == "before":
        warnings.simplefilter("error")
    else:
        warnings.filters.pop(0)
