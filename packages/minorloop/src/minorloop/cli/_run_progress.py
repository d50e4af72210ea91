"""Progress of a run: levels, time left and warnings."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import typer

from minorloop.errors import InstrumentError
from minorloop.values import as_duration

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import Choose, ResumeMode, RunProgress
    from minorloop.lab.store import Store


def carry_out_levels(
    plant: Actuator,
    store: Store,
    choose: Choose | None,
    again: str | None = None,
) -> tuple[ResumeMode, list[str]]:
    """Carry out the rest of a run and show its progress; if it ends, it says how to continue.

    ``again`` says how, if not with resume. Returns the mode, and what was wrong with points.
    """
    if again is None:
        again = f"continue with minorloop resume --store {shlex.quote(str(store.path))}"
    from minorloop.drive import MismatchError
    from minorloop.lab.run import run

    warnings = []

    try:
        with watching(store) as watch:

            def noted(progress: RunProgress) -> None:
                watch(progress)
                if progress.warning:
                    warnings.append(progress.warning)

            return run(plant, store.plan, store, choose=choose, watch=noted), warnings
    except KeyboardInterrupt:
        if not store.finished:
            safe = "the actuator has confirmed that it is safe"  # or another error comes here
            typer.echo(f"{_kept(store)}; {safe}; {again}", err=True)
        raise
    except InstrumentError as error:
        left = "" if store.finished else f"; {again}"
        if isinstance(error, MismatchError):
            left = (
                "; when that is corrected, begin a new drive with another --store, because to "
                "resume this one, with what it keeps, gives the same error"
            )
        raise type(error)(f"{error}; {_kept(store)}{left}") from None


def _kept(store: Store) -> str:
    what = "sines" if store.plan.sines else "levels"
    return f"{len(store)} of {len(store.plan)} {what} are kept"


@contextmanager
def watching(store: Store) -> Iterator[Callable[[RunProgress], None]]:
    """Yield a function that shows each `RunProgress` of a run on stderr.

    On a terminal it shows a bar and the time left. Elsewhere it prints one line for each
    settled point.
    """
    begun = len(store)
    if sys.stderr.isatty():
        with _live(store, begun) as show:
            yield show
        return

    def log(progress: RunProgress) -> None:
        if progress.point is not None or _repeats(progress, begun):
            with suppress(OSError):  # the reader of the log may end; the run continues
                print(_line(progress, store, begun), file=sys.stderr, flush=True)
                if progress.warning:
                    print(f"! {progress.warning}", file=sys.stderr, flush=True)

    yield log


def _repeats(progress: RunProgress, begun: int) -> bool:
    """Whether a level of a session before was held again, unmeasured."""
    return progress.point is None and progress.index < begun


def _applied(progress: RunProgress, store: Store, digits: int) -> str:
    """Return what a segment of the plan is: its sine, or its level with some digits."""
    unit = store.outputs[0].unit
    if not store.plan.sines:
        return f"{progress.input:.{digits}g} {unit}"
    sine = store.plan.sines[progress.index]
    return f"{sine.frequency:.6g} Hz, {sine.amplitude:.6g} {unit}"


def _line(progress: RunProgress, store: Store, begun: int) -> str:
    verdict = progress.point.verdict if progress.point else ""
    level = _applied(progress, store, 6)
    if _repeats(progress, begun):
        return (
            f"{progress.index + 1}/{progress.total}  {level}  repeated for {progress.held:.6g} s, "
            "as it was measured before the run was stopped"
        )
    return (
        f"{progress.index + 1}/{progress.total}  {level}  "
        f"{progress.output:.6g} {store.outputs[1].unit}  {verdict} after {progress.held:.6g} s"
    )


@contextmanager
def _live(store: Store, begun: int) -> Iterator[Callable[[RunProgress], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    began = time.monotonic()

    def show(progress: RunProgress) -> None:
        doing = f"{_applied(progress, store, 5)} for {progress.held:.0f} s"
        if _repeats(progress, begun):
            doing = f"repeating what was measured: {doing}"
        bar.update(task, description=doing, completed=max(progress.index, begun))
        if progress.point is not None:
            done, seconds = progress.index + 1, time.monotonic() - began
            left = said_left(time_left(store.plan, begun, done, seconds))
            bar.update(task, completed=done, left=left)
        if progress.warning:
            bar.console.print(f"! {progress.warning}", markup=False, highlight=False)

    fields = TextColumn("{task.fields[left]}")
    with Progress(*columns, fields, console=Console(stderr=True), refresh_per_second=8) as bar:
        task = bar.add_task("measuring", total=len(store.plan), completed=begun, left="")
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
