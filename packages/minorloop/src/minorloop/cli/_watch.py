"""Progress of a run: levels, time left, and the loop measured so far."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from minorloop.cli._braille import scatter
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.identification.adaptive import Adaptive
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import RunProgress
    from minorloop.lab.store import Store

_WIDTH, _HEIGHT = 48, 10
"""Characters of the drawing: it fits into a terminal of 80 columns and 24 lines with its labels."""
DRAWN = 1000
"""Latest points that are drawn, so that a drawing of a long run takes no longer."""
_ENOUGH, _LOOP = 4, 20
"""Points from which bands are drawn; inputs of each branch of the loop drawn with them."""


@contextmanager
def watching(
    store: Store, chooser: Adaptive | None = None, what: Sequence[str] = ()
) -> Iterator[Callable[[RunProgress], None]]:
    """Yield a function that shows each `RunProgress` of a run on stderr.

    On a terminal it shows a bar, the time left and the loop. Elsewhere it prints one line for each
    settled point. ``what`` says what each level of the plan is; its input if not given.
    """
    if sys.stderr.isatty():
        with _live(store, chooser, what) as show:
            yield show
        return
    units = [quantity.unit for quantity in store.outputs]

    def log(progress: RunProgress) -> None:
        if progress.point is not None or _repeats(progress):
            with suppress(OSError):  # the reader of the log may end; the run continues
                print(_line(progress, units[0], units[1], what), file=sys.stderr, flush=True)
                if progress.warning:
                    print(f"! {progress.warning}", file=sys.stderr, flush=True)

    yield log


def _repeats(progress: RunProgress) -> bool:
    """Whether a level of a session before was held again, unmeasured.

    A sine that begins has no output yet either, and has not been held.
    """
    return progress.point is None and progress.held > 0 and math.isnan(progress.output)


def _line(progress: RunProgress, input_unit: str, output_unit: str, what: Sequence[str]) -> str:
    verdict = progress.point.verdict if progress.point else ""
    level = what[progress.index] if what else f"{progress.input:.6g} {input_unit}"
    if _repeats(progress):
        return (
            f"{progress.index + 1}/{progress.total}  {level}  repeated for {progress.held:.6g} s, "
            "as it was measured before the run was stopped"
        )
    return (
        f"{progress.index + 1}/{progress.total}  {level}  "
        f"{progress.output:.6g} {output_unit}  {verdict} after {progress.held:.6g} s"
    )


@contextmanager
def _live(
    store: Store, chooser: Adaptive | None, what: Sequence[str]
) -> Iterator[Callable[[RunProgress], None]]:
    from rich.console import Console, Group
    from rich.live import Live
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.text import Text

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    bar = Progress(*columns, TextColumn("{task.fields[left]}"))
    begun = len(store)
    task = bar.add_task("measuring", total=len(store.plan), completed=begun, left="")
    points = store.points(max(begun - DRAWN, 0) if chooser is None else 0)
    most = DRAWN if chooser is None else None
    u = deque([point.input for point in points], most)
    y = deque([point.value for point in points], most)
    began, left, shown = time.monotonic(), "", ""

    def show(progress: RunProgress) -> None:
        nonlocal left, shown
        level = f"{progress.input:.5g} {store.outputs[0].unit}"
        doing = f"{what[progress.index] if what else level} for {progress.held:.0f} s"
        if _repeats(progress):
            doing = f"repeating what was measured: {doing}"
        if progress.point is not None:
            u.append(progress.point.input)
            y.append(progress.point.value)
            seconds = time.monotonic() - began
            left = said_left(time_left(store.plan, begun, progress.index + 1, seconds))
        done = progress.index + (progress.point is not None)
        bar.update(task, description=doing, completed=max(done, begun), left=left)
        if progress.point is not None or not shown:
            shown = drawn(store, u, y) if chooser is None else _banded(store, chooser, u, y)
        live.update(Group(bar, Text(shown)))
        if progress.warning:
            live.console.print(f"! {progress.warning}", markup=False, highlight=False)

    with Live(bar, console=Console(stderr=True), refresh_per_second=8) as live:
        yield show


def time_left(plan: Plan, first: int, count: int, seconds: float) -> float:
    """Return the time left of a run, in seconds; NaN if it is not known.

    Holds to come are expected to take as large a share of the longest as those so far.

    Parameters
    ----------
    plan : Plan
        The plan.
    first, count : int
        How many levels were measured when the time began to count, and are now.
    seconds : float
        How long the levels from ``first`` to ``count`` took.
    """
    so_far = float(plan.longest[first:count].sum())
    return seconds * float(plan.longest[count:].sum()) / so_far if so_far else math.nan


def said_left(seconds: float) -> str:
    """Return a time left in words; empty if it is not known, or less than a second."""
    return f"{as_duration(seconds)} left" if seconds >= 1 else ""


def drawn(store: Store, u: Iterable[float], y: Iterable[float]) -> str:
    """Return a drawing of points of a store, and what is drawn.

    Parameters
    ----------
    store : Store
        The store.
    u, y : iterable of float
        Inputs and outputs, as many.
    """
    x, output = store.outputs
    return "\n".join([f"{output} against {x}", *scatter([([*u], [*y])], _WIDTH, _HEIGHT)])


def _banded(store: Store, chooser: Adaptive, u: Iterable[float], y: Iterable[float]) -> str:
    """Return a drawing of the points, and of the bands along the major loop."""
    u, y = [*u], [*y]
    if len(u) < _ENOUGH:
        return drawn(store, u, y)
    ends = [chooser.low, chooser.high]
    rising = [chooser.low + (chooser.high - chooser.low) * k / _LOOP for k in range(_LOOP + 1)]
    loop = [ends[0], *rising, *rising[::-1]]
    shown = chooser.identification(u, y).predict(loop, bands=0.9)
    x, output = store.outputs
    band = f"90 % bands, {2 * float(shown.half_width.mean()):.3g} {output.unit} wide on average"
    lines = [(u, y), (loop, shown.lower.tolist()), (loop, shown.upper.tolist())]
    return "\n".join([f"{output} against {x}: {band}", *scatter(lines, _WIDTH, _HEIGHT)])
