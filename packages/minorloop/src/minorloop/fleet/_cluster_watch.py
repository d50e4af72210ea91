"""Monitor of a Dask scheduler and its workers."""

import asyncio
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future
from typing import Any, NoReturn

from minorloop.errors import FleetError, ParameterError

SILENT = 4.0
"""Seconds without a report after which a message says so; workers report up to twice a second."""
_PER_WORKER = 0.02
"""Seconds that each worker adds, because Dask makes reports rarer by 0.005 s for each."""
_EVERY = 0.5
"""Seconds between two requests to the scheduler."""


class ClusterWatch:
    """Monitors which workers of a scheduler answer.

    Parameters
    ----------
    client : distributed.Client
        Connected to the scheduler.
    address : str
        Of the scheduler.
    patience : float
        Seconds without any worker, or without an answer of the scheduler, after which it fails.
    say : callable
        Called with sentences about delays and faults.

    Attributes
    ----------
    answering : list of str
        Addresses of workers that report.
    silent : set of str
        Addresses of workers that the scheduler knows and that do not report.
    stuck : set of str
        Keys of tasks at silent workers, if other workers answer.
    """

    def __init__(
        self, client: Any, address: str, patience: float, say: Callable[[str], None]
    ) -> None:
        self._client, self._address, self._patience, self._say = client, address, patience, say
        self.answering: list[str] = []
        self.silent: set[str] = set()
        self.stuck: set[str] = set()
        self._reports: dict[str, tuple[float, float]] = {}
        self._request: Future[Any] | None = None
        self._answered = self._worked = time.monotonic()
        self._asked = float("-inf")
        self._has_answered, self._had_workers, self._last_kind = False, False, ""

    def look(self) -> None:
        """Send a request or read its answer, and check the delays; returns at once.

        Raises a `ParameterError` if no worker connected within the patience; a `FleetError` if the
        scheduler is gone, or no worker answered within the patience.
        """
        if self._client.status != "running":
            self.lose_connection()
        now = time.monotonic()
        if self._request is None and now >= self._asked + _EVERY:
            loop = self._client.loop.asyncio_loop
            self._request = asyncio.run_coroutine_threadsafe(self._ask(), loop)
            self._asked = now
        if self._request is not None and self._request.done():
            request, self._request = self._request, None
            if not request.cancelled() and request.exception() is None:
                reports, held = request.result()
                self._note(reports, held, now)
        self._judge(now)

    def lose_connection(self) -> NoReturn:
        """Raise the error for a lost scheduler."""
        raise FleetError(f"the scheduler at {self._address} is gone: it closed the connection")

    async def _ask(self) -> tuple[dict[str, float], set[str]]:
        """Time of each worker's last report by the scheduler's clock, and tasks of silent ones."""
        scheduler, held = self._client.scheduler, set[str]()
        workers = (await scheduler.identity())["workers"]
        silent = list(self.silent & workers.keys())
        if silent:
            for keys in (await scheduler.processing(workers=silent)).values():
                held.update(keys)
            for keys in (await scheduler.has_what(workers=silent)).values():
                held.update(keys)
        return {name: one["last_seen"] for name, one in workers.items()}, held

    def _note(self, reports: dict[str, float], held: set[str], now: float) -> None:
        self._answered, self._has_answered, before = now, True, self._reports
        self._reports = {
            name: before[name] if before.get(name, (None,))[0] == report else (report, now)
            for name, report in reports.items()
        }
        most = SILENT + _PER_WORKER * len(reports)
        self.answering = [name for name, (_, seen) in self._reports.items() if now - seen < most]
        silent = self._reports.keys() - self.answering
        if self.answering:
            self._worked, self._had_workers = now, True
            if silent - self.silent:
                self._say(
                    f"{_named(silent - self.silent)} has not answered for {most:.0f} s; its "
                    "specimens are sent to others"
                )
        self.silent = set(silent)
        self.stuck = held if self.answering else set()

    def _judge(self, now: float) -> None:
        quiet, idle = now - self._answered, now - self._worked
        if quiet >= SILENT:
            self._say_once(
                f"the scheduler at {self._address} has not answered for {quiet:.0f} s; waiting"
            )
            if quiet >= self._patience:
                raise FleetError(
                    f"the scheduler at {self._address} has not answered for {quiet:.0f} s"
                )
        elif not self._has_answered:
            return
        elif idle >= min(SILENT, self._patience) or (self.silent and not self.answering):
            self._say_once(self._without_workers())
            if idle >= self._patience:
                self._end_without_workers()
        elif self._last_kind:
            self._say(f"the cluster at {self._address} answers again")
            self._last_kind = ""

    def _without_workers(self) -> str:
        if self.silent:
            return f"none of the workers at {self._address} answers ({len(self.silent)}); waiting"
        if self._had_workers:
            return f"no worker is left at {self._address}; waiting"
        return f"no workers at {self._address}; waiting"

    def _end_without_workers(self) -> NoReturn:
        if self._had_workers:
            raise FleetError(
                f"no worker at {self._address} has answered for {self._patience:g} s; start some "
                f"(dask worker {self._address})"
            )
        raise ParameterError(
            f"no worker came to the scheduler at {self._address} within {self._patience:g} s; "
            f"start some (dask worker {self._address}), or give a longer patience"
        )

    def _say_once(self, sentence: str) -> None:
        """Say a sentence once, whatever the number of seconds in it."""
        kind = sentence.partition(" for ")[0]
        if kind != self._last_kind:
            self._last_kind = kind
            self._say(sentence)


def _named(workers: Collection[str]) -> str:
    first = min(workers)
    return (
        f"worker {first}" if len(workers) == 1 else f"each of {len(workers)} workers, {first} too,"
    )
