"""Progress of a run: levels, time left and warnings."""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

import typer

from minorloop.cli._common import Progress, working
from minorloop.errors import InstrumentError
from minorloop.values import as_duration

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import Choose, ResumeMode, RunProgress
    from minorloop.lab.store import Store


def carry_out_levels(
    plant: Actuator, store: Store, choose: Choose | None, again: str | None = None
) -> tuple[ResumeMode, list[str]]:
    """Carry out the rest of a run and show its progress; if it is stopped, say how to continue.

    ``again`` is that sentence, if not about resume. Returns the mode and the warnings of points.
    """
    if again is None:
        again = f"continue with minorloop resume --store {shlex.quote(str(store.path))}"
    from minorloop.drive import MismatchError
    from minorloop.lab.run import run

    warnings: list[str] = []
    try:
        with working("measuring") as now:
            watch = _shown(store, now, warnings)
            return run(plant, store.plan, store, choose=choose, watch=watch), warnings
    except KeyboardInterrupt:
        if not store.finished:
            safe = "the actuator has confirmed that it is safe"  # or another error comes here
            typer.echo(f"{_kept(store)}; {safe}; {again}", err=True)
        raise
    except InstrumentError as error:
        left = "" if store.finished else f"; {again}"
        if isinstance(error, MismatchError):
            left = (
                "; when that is corrected, begin a new drive with another --store, because "
                "resuming this one gives the same error"
            )
        raise type(error)(f"{error}; {_kept(store)}{left}") from None


def _kept(store: Store) -> str:
    what = "sines" if store.plan.sines else "levels"
    return f"{len(store)} of {len(store.plan)} {what} are kept"


def _shown(store: Store, now: Progress, warnings: list[str]) -> Callable[[RunProgress], None]:
    """Return a function that prints a line for each settled point and each warning of a run.

    On a terminal it also shows the present level and the time left.
    """
    begun, began, left = len(store), time.monotonic(), ""

    def watch(progress: RunProgress) -> None:
        nonlocal left
        if progress.point is not None:
            seconds = time.monotonic() - began
            left = said_left(time_left(store.plan, begun, progress.index + 1, seconds))
        kept = progress.point is not None or _repeats(progress, begun)
        with suppress(OSError):  # the reader of the log may end; the run continues
            now(_line(progress, store, begun, "" if kept else left), kept=kept)
            if progress.warning:
                now(f"! {progress.warning}", kept=True)
        if progress.warning:
            warnings.append(progress.warning)

    return watch


def _repeats(progress: RunProgress, begun: int) -> bool:
    """Whether a level of an earlier session was held again without measuring it."""
    return progress.point is None and progress.index < begun


def _applied(progress: RunProgress, store: Store) -> str:
    """Return in words the sine or the level that a segment of the plan applies."""
    unit = store.outputs[0].unit
    if not store.plan.sines:
        return f"{progress.input:.6g} {unit}"
    sine = store.plan.sines[progress.index]
    return f"{sine.frequency:.6g} Hz, {sine.amplitude:.6g} {unit}"


def _line(progress: RunProgress, store: Store, begun: int, left: str) -> str:
    place = f"{progress.index + 1}/{progress.total}  {_applied(progress, store)}  "
    if _repeats(progress, begun):
        return (
            f"{place}repeated for {progress.held:.6g} s, as it was measured before the run was "
            "stopped"
        )
    verdict = f"{progress.point.verdict} " if progress.point else ""
    read = f"{progress.output:.6g} {store.outputs[1].unit}  {verdict}after {progress.held:.6g} s"
    return "  ".join(filter(None, [f"{place}{read}", left]))


def time_left(plan: Plan, first: int, count: int, seconds: float) -> float:
    """Return the time left of a run, in seconds; NaN if it is unknown.

    The coming holds are expected to take the same share of their longest duration as those so far.

    ``first`` and ``count``: how many levels of the plan were measured when timing began, and are
    now; ``seconds``: how long the levels between took.
    """
    so_far = float(plan.longest[first:count].sum())
    return seconds * float(plan.longest[count:].sum()) / so_far if so_far else math.nan


def said_left(seconds: float) -> str:
    """Return a time left in words; empty if it is unknown, or less than a second."""
    return f"{as_duration(seconds)} left" if seconds >= 1 else ""
