"""Progress of a run: levels, time left, and the loop measured so far."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from minorloop.cli._braille import scatter
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.identification.adaptive import Adaptive
    from minorloop.lab.run import RunProgress
    from minorloop.lab.store import Store

_WIDTH, _HEIGHT = 48, 10
"""Characters of the drawing: it fits into a terminal of 80 columns and 24 lines with its labels."""
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
    task = bar.add_task("measuring", total=len(store.plan), completed=len(store), left="")
    points = store.points()
    u, y = [point.input for point in points], [point.value for point in points]
    clock, shown = _Clock(store), [""]

    def show(progress: RunProgress) -> None:
        level = f"{progress.input:.5g} {store.outputs[0].unit}"
        doing = f"{what[progress.index] if what else level} for {progress.held:.0f} s"
        if _repeats(progress):
            doing = f"repeating what was measured: {doing}"
        if progress.point is not None:
            u.append(progress.point.input)
            y.append(progress.point.value)
        left = clock.left(progress)
        bar.update(task, description=doing, completed=len(u), left=left)
        if progress.point is not None or progress.index == len(u):
            picture = _drawn(store, u, y) if chooser is None else _banded(store, chooser, u, y)
            shown[:] = [picture]
        live.update(Group(bar, Text(shown[0])))

    with Live(bar, console=Console(stderr=True), refresh_per_second=8) as live:
        yield show


class _Clock:
    """Time left, estimated from how long each second of holding has taken so far."""

    def __init__(self, store: Store) -> None:
        self._longest = store.plan.longest
        self._began = time.monotonic()
        self._held = 0.0
        self._shares: list[float] = []
        self._said = ""

    def left(self, progress: RunProgress) -> str:
        if progress.point is None:
            return self._said
        self._held += progress.held
        self._shares.append(progress.held / float(self._longest[progress.index]))
        share = sum(self._shares) / len(self._shares)
        to_hold = share * float(self._longest[progress.index + 1 :].sum())
        seconds = (time.monotonic() - self._began) * to_hold / self._held
        self._said = "" if seconds < 1 else f"{as_duration(seconds)} left"
        return self._said


def _drawn(store: Store, u: Sequence[float], y: Sequence[float]) -> str:
    x, output = store.outputs
    return "\n".join([f"{output} against {x}", *scatter([(u, y)], _WIDTH, _HEIGHT)])


def _banded(store: Store, chooser: Adaptive, u: list[float], y: list[float]) -> str:
    """Return a drawing of the points, and of the bands along the major loop."""
    if len(u) < _ENOUGH:
        return _drawn(store, u, y)
    ends = [chooser.low, chooser.high]
    rising = [chooser.low + (chooser.high - chooser.low) * k / _LOOP for k in range(_LOOP + 1)]
    loop = [ends[0], *rising, *rising[::-1]]
    shown = chooser.identification(u, y).predict(loop, bands=0.9)
    x, output = store.outputs
    band = f"90 % bands, {2 * float(shown.half_width.mean()):.3g} {output.unit} wide on average"
    lines = [(u, y), (loop, shown.lower.tolist()), (loop, shown.upper.tolist())]
    return "\n".join([f"{output} against {x}: {band}", *scatter(lines, _WIDTH, _HEIGHT)])
