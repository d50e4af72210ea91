"""Claims of a paper beside the figures of a study: rows, verdicts, tables."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from minorloop.report import Table

_FILE = Path(__file__).with_suffix(".md")
"""All claims: a heading for each study or part, and a row for each claim."""


@dataclass(frozen=True)
class Claim:
    """One row: the figures of the paper and of this run, and the bounds that we require."""

    what: str
    """The figure in words."""
    key: str
    """Name of the figure, with dots for nesting, such as ``steady.curves_nrmse``."""
    paper: str
    """Value in the paper."""
    least: float = -math.inf
    most: float = math.inf
    """Bounds of the figure; infinite if it is only reported."""
    percent: bool = False
    """Whether the figure is shown in percent."""
    count: str = ""
    """Name of the figure with the size of the sample, which is shown beside this one."""
    enough: int = 0
    """Least sample for a verdict."""
    bound: str = "ours"
    """Source of the bound, as shown: the paper's or ours."""

    def row(self, figures: Mapping[str, Any]) -> tuple[str, str, str, str, str]:
        """Return the cells of the row: figure, paper, this run, required, verdict."""
        value = figure(figures, self.key)
        bounds = self._bounds(value)
        asked = f"{bounds} ({self.bound})" if bounds else ""
        if isinstance(value, bool):
            known = math.isfinite(self.most) or math.isfinite(self.least)
            wanted = self.least > 0 if math.isfinite(self.least) else self.most > 0
            verdict = "reported" if not known else "met" if value == wanted else "not met"
            words = ("no", "yes")
            asked = f"{words[wanted]} ({self.bound})" if known else "-"
            return self.what, self.paper, words[value], asked, verdict
        verdict = "reported"
        count = figure(figures, self.count) if self.count else math.inf
        if count < self.enough:
            verdict = "too few"
        elif math.isnan(value):
            verdict = "nothing to count" if not asked else "not met"
        elif asked:
            verdict = "met" if self.least <= value <= self.most else "not met"
        text = self._text(value)
        if verdict == "not met" and text in asked.split():  # rounding would hide by how little
            text = cell(value, ".6g")
        shown = f"{text} (of {count:.0f})" if self.count else text
        return self.what, self.paper, shown, asked or "-", verdict

    def _bounds(self, value: float) -> str:
        """Return the bounds as a short text; empty without bounds."""
        if math.isfinite(self.least) and math.isfinite(self.most):
            return f"{self._text(self.least)} to {self._text(self.most)}"
        if math.isfinite(self.least):
            return f">= {self._text(self.least)}"
        if math.isfinite(self.most):
            # A count is not negative.
            return "0" if self.most == 0 and value >= 0 else f"<= {self._text(self.most)}"
        return ""

    def _text(self, value: float) -> str:
        text = cell(value, ".2%" if self.percent else ".3g")
        return f"{float(text):.0f}" if "e+" in text else text


@cache
def claims_of(name: str) -> tuple[Claim, ...]:
    """Return the claims of a study or a part, in the order of the file."""
    _, _, section = _FILE.read_text("utf-8").partition(f"\n## {name}\n")
    return tuple(_claims(section.partition("\n## ")[0]))


def _claims(section: str) -> Iterator[Claim]:
    for row in (row for line in section.splitlines()[3:] for row in _each(line)):
        what, *cells = (part.strip() for part in row.strip("|").split("|"))
        if part := re.fullmatch(r"all of (\w+)", what):
            yield from claims_of(part[1])
        elif cells:
            key, paper, least, most, form, count, enough, bound = cells + [""] * (8 - len(cells))
            bounds = float(least or -math.inf), float(most or math.inf)
            few, whose = int(enough or 0), bound or "ours"
            yield Claim(what, key, paper, *bounds, form == "%", count, few, whose)


def _each(line: str) -> Iterator[str]:
    """Yield the rows for which a line stands: one for each of the values in its braces."""
    text, *parts = re.split(r"\{(.*?)\}", line)
    for values in zip(*(part.split(", ") for part in parts[::2]), strict=True) if parts else [()]:
        yield text + "".join(a + b for a, b in zip(values, parts[1::2], strict=True))


def cell(value: float, form: str) -> str:
    """Return a number as text in a format: ``none`` if it is NaN, ``not reached`` if infinite."""
    if math.isnan(value):
        return "none"
    return "not reached" if math.isinf(value) else format(value, form)


def figure(figures: Mapping[str, Any], key: str) -> Any:
    """Return the figure with a dotted key."""
    found: Any = figures
    for part in key.split("."):
        found = found[part]
    return found


def claim_table(claims: Sequence[Claim], figures: Mapping[str, Any]) -> Table:
    """Return all rows as a table."""
    columns = ("", "the paper", "this run", "required", "verdict")
    return Table(columns, [claim.row(figures) for claim in claims])


def paper_table(claims: Sequence[Claim], figures: Mapping[str, Any]) -> Table:
    """Return the rows on the claims of the paper itself."""
    return claim_table([claim for claim in claims if claim.paper != "-"], figures)
