"""Figures of models and results, drawn by the function that is registered for their class.

The entry points of the group `minorloop.drawing` are functions by the name of the class that they
draw; other packages may add theirs. The entry point ``html`` shows a drawn object in a notebook.
"""

from typing import Any

from minorloop.errors import ParameterError
from minorloop.registry import loaded, registered

_GROUP = "minorloop.drawing"


def plot(x: object, **options: Any) -> Any:
    """Draw a model or a result as a matplotlib figure.

    Raises a `ParameterError` if nothing draws this class.

    Parameters
    ----------
    x : model or result
    **options
        Options of the function that draws its class, in `minorloop.drawing`: ``input_label`` and
        ``output_label``, names and units for the axes, of most of them.

    Examples
    --------
    >>> figure = ml.plot(ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5]))
    >>> figure.savefig("loops.png")
    """
    known = registered(_GROUP)
    for each in type(x).__mro__:
        if each.__name__ in known:
            return loaded(known[each.__name__], each.__name__)(x, **options)
    raise ParameterError(
        f"{type(x).__name__} cannot be drawn; give one of {', '.join(sorted(known))}"
    )


class Drawn:
    """A model or result that can be drawn, and that a notebook shows as a figure and a table."""

    def plot(self, **options: Any) -> Any:
        """Draw it: see `minorloop.plot`."""
        return plot(self, **options)

    def _repr_html_(self) -> str:
        html: str = loaded(registered(_GROUP)["html"], "html")(self)
        return html
