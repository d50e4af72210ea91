"""Pool of local workers: time limits, and processes that end or are stopped."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from itertools import islice
from types import TracebackType
from typing import Any

from minorloop.errors import FleetError
from minorloop.fleet._fitting import Found, Task
from minorloop.fleet._reading import APART, TICK
from minorloop.fleet._worker import Work, Worker

NOTICE = 5.0
"""Seconds of one fit after which a message says so; again each time this has doubled."""
STOPPED = 3.0
"""Seconds after which a worker that is stopped is replaced; debuggers stop one for less."""
LOADING = 300.0
"""Seconds that a worker may take to load what it needs; compiling it takes less than a minute."""
ATTEMPTS = 2
"""Workers that may end during the fit of the same specimen."""
STARTS = 3
"""Workers in a row that may end before they are ready."""
_LONGEST_TICK = 1.0
"""Longest time that one round counts, so that a sleeping machine does not use up a limit."""


@dataclass
class _Slot:
    """One worker and its present task."""

    worker: Worker | None = None
    answer: Future[Any] | None = None
    task: Task | None = None
    spent: float = 0.0
    stopped: float = 0.0
    noticed: float = 0.0

    def begin(self, answer: Future[Any], task: Task | None = None) -> None:
        self.answer, self.task = answer, task
        self.spent = self.stopped = self.noticed = 0.0

    def end(self) -> str:
        worker, self.worker, self.answer, self.task = self.worker, None, None, None
        return "" if worker is None else worker.end()


class Pool:
    """Workers on this machine.

    Parameters
    ----------
    workers : int
        Number of processes.
    limit : float
        Seconds that one specimen may take.
    work : callable
        Function that a worker applies to a task.
    say : callable
        Called with sentences about delays and faults.
    """

    def __init__(self, workers: int, limit: float, work: Work, say: Callable[[str], None]) -> None:
        self.limit, self.work, self.say = limit, work, say
        self._slots = [_Slot() for _ in range(workers)]
        self._ends: Counter[str] = Counter()
        self._bad_starts = 0
        self._last_notice = float("-inf")

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End all workers at once."""
        for slot in self._slots:
            slot.end()

    def run(self, tasks: Iterable[Task | None]) -> Iterator[tuple[Task, Found] | None]:
        """Yield each task with its result; None at intervals without a result.

        Parameters
        ----------
        tasks : iterable of Task or None
            Read as workers become free; None where none is ready yet.

        Raises
        ------
        FleetError
            If no worker can be started.
        """
        coming, waiting = iter(tasks), deque[Task]()
        before = time.monotonic()
        while True:
            awaited = self._hand_out(coming, waiting)
            answers = [slot.answer for slot in self._slots if slot.answer is not None]
            if not answers:
                if not awaited:
                    return
                yield None
                continue
            wait(answers, timeout=TICK, return_when=FIRST_COMPLETED)
            found = [one for slot in self._slots if (one := self._take(slot, waiting))]
            if (elapsed := time.monotonic() - before) >= TICK:
                before += elapsed
                found += self._watch(min(elapsed, _LONGEST_TICK), waiting)
            self._hand_out(coming, waiting)  # before others have time for what was found
            if found:
                yield from found
            else:
                yield None

    def _hand_out(self, coming: Iterator[Task | None], waiting: deque[Task]) -> bool:
        """Give tasks to free workers; return whether a worker waits for a task to be read."""
        for slot in self._slots:
            if slot.answer is not None:
                continue
            if not waiting:
                drawn = list(islice(coming, 1))
                waiting.extend(one for one in drawn if one is not None)
                if not waiting:
                    return bool(drawn)
            if slot.worker is not None and slot.worker.ended:  # idle for long
                slot.end()
            if slot.worker is None:
                slot.worker = Worker(self.work, self.limit)
                slot.begin(slot.worker.ready)
            else:
                task = waiting.popleft()
                slot.begin(slot.worker.ask(task), task)
        return False

    def _take(self, slot: _Slot, waiting: deque[Task]) -> tuple[Task, Found] | None:
        """Result of a worker, if it has answered."""
        if slot.answer is None or not slot.answer.done():
            return None
        if slot.answer.exception() is not None:
            return self._give_up(slot, waiting)
        task, found = slot.task, slot.answer.result()
        slot.answer = slot.task = None
        self._bad_starts = 0
        return None if task is None else (task, found)

    def _give_up(
        self, slot: _Slot, waiting: deque[Task], why: str = ""
    ) -> tuple[Task, Found] | None:
        """Replace a worker that failed; its specimen is tried once more."""
        task = slot.task
        how = slot.end()
        why = why or f"ended ({how})"
        if task is None:
            self._bad_starts += 1
            if self._bad_starts >= STARTS:
                raise FleetError(f"workers cannot be started: the last of {STARTS} {why}")
            return None
        name = task.specimen.name
        self._ends[name] += 1
        if self._ends[name] < ATTEMPTS:
            self.say(f"the worker of specimen {name} {why}; the specimen is tried once more")
            waiting.appendleft(task)
            return None
        del self._ends[name]
        reason = f"{ATTEMPTS} workers ended during its fit, the last one {why}"
        return task, {"error": f"{reason}; look for a lack of memory"}

    def _watch(self, elapsed: float, waiting: deque[Task]) -> list[tuple[Task, Found]]:
        """Count the time, and end workers that are stopped or take too long."""
        found = []
        for slot in self._slots:
            if slot.worker is None or slot.answer is None or slot.answer.done():
                continue
            slot.spent += elapsed
            slot.stopped = slot.stopped + elapsed if slot.worker.is_stopped() else 0.0
            if slot.stopped >= STOPPED:
                one = self._give_up(slot, waiting, f"was stopped for {slot.stopped:.0f} s")
            elif slot.task is None:
                late = slot.spent >= LOADING
                why = f"was not ready after {LOADING:g} s"
                one = self._give_up(slot, waiting, why) if late else None
            else:
                one = self._end_if_late(slot, slot.task)
            if one is not None:
                found.append(one)
        return found

    def _end_if_late(self, slot: _Slot, task: Task) -> tuple[Task, Found] | None:
        name = task.specimen.name
        if slot.spent >= self.limit:
            slot.end()
            self.say(f"specimen {name} has reached the limit of {self.limit:g} s and is given up")
            return task, {
                "error": f"no model within the limit of {self.limit:g} s; look at the record, or "
                "allow more time"
            }
        now = time.monotonic()
        if slot.spent >= max(NOTICE, 2 * slot.noticed) and now - self._last_notice >= APART:
            slot.noticed, self._last_notice = slot.spent, now
            self.say(
                f"specimen {name} has run for {slot.spent:.0f} s; the limit is {self.limit:g} s"
            )
        return None
