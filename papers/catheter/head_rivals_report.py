"""All controllers of the head beside each other, and the figures on which a rival is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from minorloop.report import Table
from papers.catheter.head_loop import NOISE, TICK
from papers.claims import cell

_ROUNDING = 1e-9
"""Of times that are whole ticks."""
WORDS = {
    "observer": "observer",
    "feedforward": "open loop",
    "pi": "PI alone",
    "internal_model": "internal model",
    "adaptive": "adaptive",
    "feedforward_pi": "inverse and PI",
    "model_reference": "model reference",
}
"""Name of each controller in reports, the default first."""


class ControllerFigure(NamedTuple):
    """A figure of a controller, of which less is better."""

    key: str
    words: str
    unit: str
    digits: int = 2
    """Behind the decimal point."""
    least: float = 0.0
    """Difference that counts if it is exceeded."""

    @property
    def heading(self) -> str:
        """Heading of a column."""
        return f"{self.words}, {self.unit}"

    def text(self, figures: Mapping[str, float]) -> str:
        """Return the figure of one controller as a cell of a table."""
        return cell(figures[self.key], f".{self.digits}f")

    def less(self, one: Mapping[str, float], other: Mapping[str, float]) -> bool:
        """Return whether one controller is better than another, by a difference that counts."""
        low, high = float(one[self.key]), float(other[self.key])
        shown = round(low, self.digits) < round(high, self.digits)
        return shown and not high - low <= self.least + _ROUNDING


_LOWEST = 20.0
"""The lowest step of the paper in degrees: of its overshoot the noise of a reading is most."""
STEP = (
    ControllerFigure("settle_s", "settling", "s", 1, least=TICK),
    ControllerFigure("overshoot_pct", "overshoot", "%", 1, least=100 * NOISE / _LOWEST),
    ControllerFigure("steady_rms_deg", "steady rms", "deg"),
)
"""Figures of steps."""


def rivals_table(
    quantities: Sequence[ControllerFigure], figures: Mapping[str, Mapping[str, float]]
) -> Table:
    """Return the figures of all controllers, one row for each."""
    columns = ("controller", *(each.heading for each in quantities))
    rows = [
        (WORDS[name], *(each.text(own) for each in quantities)) for name, own in figures.items()
    ]
    return Table(columns, rows)


def where_better(
    quantities: Sequence[ControllerFigure], figures: Mapping[str, Mapping[str, float]], default: str
) -> str:
    """Return in words on which figures another controller is better than the default.

    Figures count as they are shown: a difference behind the last digit is none. Nor is one of up to
    a tick of the loop in a time, or the noise of a reading in an overshoot.
    """
    said = ""
    for each in quantities:
        better = [name for name, of in figures.items() if each.less(of, figures[default])]
        if better:
            parts = [f"{WORDS[name]} {each.text(figures[name])}" for name in (default, *better)]
            said += f" {each.words[0].upper()}{each.words[1:]} in {each.unit}: {', '.join(parts)}."
    if not said:
        return f"No other controller is better than the {WORDS[default]} on any of these figures."
    return f"On these figures others are better than the {WORDS[default]}:{said}"
