"""Claims of a paper beside the figures of a study: rows, tables, medians over specimens."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context
from typing import Any, TypeVar

import numpy as np

from minorloop.report import Table
from minorloop.threads import one_thread

T = TypeVar("T")


@dataclass(frozen=True)
class Claim:
    """One row: what a paper reports, what this project requires, and the figure of this run.

    Parameters
    ----------
    what : str
        The figure in words.
    key : str
        Name of the figure, with dots for nesting, such as ``steady.curves_nrmse``.
    paper : str
        What the paper reports.
    least, most : float
        Bounds of the figure; infinite where it is only reported.
    percent : bool
        Whether the figure is shown in percent.
    count : str
        Name of the figure with the size of the sample, which is shown beside this one.
    enough : int
        Least sample for a verdict.
    bound : str
        Whose the bound is, as it is shown: the paper's or ours.
    """

    what: str
    key: str
    paper: str
    least: float = -math.inf
    most: float = math.inf
    percent: bool = False
    count: str = ""
    enough: int = 0
    bound: str = "ours"

    def row(self, figures: Mapping[str, Any]) -> tuple[str, str, str, str, str]:
        """Return the cells of the row: figure, paper, this run, required, verdict."""
        value = figure(figures, self.key)
        asked = self._asked(value)
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

    def _asked(self, value: float) -> str:
        """Return the bounds and whose they are as a short text; empty where there is none."""
        bounds = self._bounds(value)
        return f"{bounds} ({self.bound})" if bounds else ""

    def _bounds(self, value: float) -> str:
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


def specimens(runs: Sequence[Mapping[str, Any]]) -> str:
    """Return the number of specimens in words."""
    return f"{len(runs)} simulated specimen{'s' if len(runs) > 1 else ''}"


def medians(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the median of each figure over specimens; the least if its key ends in ``_min``.

    A truth value is true if it is true for any specimen. Of other values the first is taken.
    """
    return {key: _over(key, [run[key] for run in runs]) for key in runs[0]}


def _over(key: str, values: Sequence[Any]) -> Any:
    if isinstance(values[0], Mapping):
        return medians(values)
    if key.endswith("_min"):
        return min(values)
    if isinstance(values[0], bool):
        return any(values)
    if isinstance(values[0], int | float | np.number):
        return float(np.median(values))
    if isinstance(values[0], list | tuple | np.ndarray):
        return np.median(np.array(values, dtype=np.float64), axis=0).tolist()
    return values[0]


def for_each(
    work: Callable[[int], T], specimens: int, seed: int, *, ordered: bool = True
) -> Iterator[T]:
    """Yield ``work(seed)``, ``work(seed + 1)``, ...: on all cores, one process and one thread each.

    Unless they are to be ``ordered``, results come as they are ready. The processes are ended at
    once when the iterator is closed before its last result.
    """
    if specimens == 1:
        yield _alone(work, seed)
        return
    with begun(work, specimens, seed, ordered=ordered) as results:
        yield from results


@contextmanager
def begun(
    work: Callable[[int], T], specimens: int, seed: int, *, ordered: bool = True
) -> Iterator[Iterator[T]]:
    """Begin the work of `for_each`, and give its results; what is not done at the end is ended."""
    others = set(active_children())
    # A terminal sends its interruption to all processes; the first one ends the others.
    ignoring = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=ignoring) as pool:
        tasks: list[Future[T]] = []
        try:
            tasks += [pool.submit(_alone, work, each) for each in range(seed, seed + specimens)]
            yield (task.result() for task in (tasks if ordered else as_completed(tasks)))
        finally:
            if not (tasks and all(task.done() for task in tasks)):
                for child in set(active_children()) - others:
                    child.terminate()


def _alone(work: Callable[[int], T], seed: int) -> T:
    with one_thread():
        return work(seed)
