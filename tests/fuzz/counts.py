"""Run cases and count the results."""

from __future__ import annotations

import signal
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from random import Random
from typing import Any

from fuzz.readers import Reader, WrongAcceptance

LONGEST = 10.0
"""Seconds after which a case counts as hanging."""
_SHOWN = 5


class Hang(BaseException):
    """A case took too long."""


@dataclass
class Counts:
    """Results of the cases of one reader."""

    reader: str
    cases: int = 0
    accepted: int = 0
    crashes: int = 0
    hangs: int = 0
    wrong: int = 0
    seconds: float = 0.0
    notes: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether no case failed."""
        return not (self.crashes or self.hangs or self.wrong)

    @property
    def refused(self) -> int:
        """Cases that were correctly refused."""
        return self.cases - self.accepted - self.crashes - self.hangs - self.wrong


def run_cases(reader: Reader, numbers: range) -> Counts:
    """Run cases on a reader, each made from its number."""
    counts, began = Counts(reader.name), time.perf_counter()
    for number in numbers:
        case = reader.make(Random(f"{reader.name} {number}"))
        counts.cases += 1
        try:
            with _in_time(), warnings.catch_warnings():
                warnings.simplefilter("error")
                counts.accepted += reader.accepts(case)
        except WrongAcceptance as error:
            counts.wrong += 1
            _note(counts, number, case, f"wrongly accepted: {error}")
        except Hang:
            counts.hangs += 1
            _note(counts, number, case, "hangs")
        except Exception:
            counts.crashes += 1
            _note(counts, number, case, traceback.format_exc(limit=-4))
    counts.seconds = time.perf_counter() - began
    return counts


def table(all_counts: list[Counts]) -> str:
    """Return the counts as a table, one row for each reader."""
    names = ("cases", "accepted", "refused", "crashes", "hangs", "wrong")
    head = " ".join(f"{name:>9}" for name in names)
    rows = [f"{'reader':<12} {head}   seconds"]
    for one in all_counts:
        figures = " ".join(f"{getattr(one, name):>9}" for name in names)
        rows.append(f"{one.reader:<12} {figures} {one.seconds:>9.1f}")
    figures = " ".join(f"{sum(getattr(one, name) for one in all_counts):>9}" for name in names)
    rows.append(f"{'all':<12} {figures} {sum(one.seconds for one in all_counts):>9.1f}")
    return "\n".join(rows)


def _note(counts: Counts, number: int, case: Any, what: str) -> None:
    if len(counts.notes) < _SHOWN:
        counts.notes.append(f"{counts.reader}, case {number}: {what}\n    {case!r:.2000}")


@contextmanager
def _in_time() -> Iterator[None]:
    """Raise `Hang` if a case takes too long, where the platform can do this."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def stop(*_: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
