"""Whether the scheduler of a cluster and its workers still answer."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Collection
from concurrent.futures import Future
from typing import Any, NoReturn

from minorloop.errors import FleetError, ParameterError

SILENT = 4.0
"""Seconds of silence after which it is said. Workers report twice a second where there are few."""
_PER_WORKER = 0.02
"""Seconds that each worker adds, because Dask makes reports rarer by 0.005 s for each."""
_EVERY = 0.5
"""Seconds between two questions to the scheduler."""


class ClusterWatch:
    """What is known of a scheduler and its workers.

    Parameters
    ----------
    client : distributed.Client
        Connected to the scheduler.
    address : str
        Of the scheduler.
    patience : float
        Seconds without any worker, or without an answer of the scheduler, after which it ends.
    say : callable
        Told in a sentence what is waited for.

    Attributes
    ----------
    answering : list of str
        Addresses of workers that report.
    silent : set of str
        Addresses of workers that are known to the scheduler and do not report.
    stuck : set of str
        Keys of tasks that silent workers have, while others could do them.
    """

    def __init__(
        self, client: Any, address: str, patience: float, say: Callable[[str], None]
    ) -> None:
        self._client, self._address, self._patience, self._say = client, address, patience, say
        self.answering: list[str] = []
        self.silent: set[str] = set()
        self.stuck: set[str] = set()
        self._reports: dict[str, tuple[float, float]] = {}
        self._question: Future[Any] | None = None
        self._answered = self._worked = time.monotonic()
        self._asked = float("-inf")
        self._heard, self._ever, self._told = False, False, ""

    def look(self) -> None:
        """Ask, or take an answer, and judge; returns at once.

        Raises
        ------
        ParameterError
            If no worker came within the patience.
        FleetError
            If the scheduler is gone, or no worker answered for all the patience.
        """
        if self._client.status != "running":
            self.lose_connection()
        now = time.monotonic()
        if self._question is None and now >= self._asked + _EVERY:
            loop = self._client.loop.asyncio_loop
            self._question = asyncio.run_coroutine_threadsafe(self._ask(), loop)
            self._asked = now
        if self._question is not None and self._question.done():
            question, self._question = self._question, None
            if not question.cancelled() and question.exception() is None:
                reports, held = question.result()
                self._note(reports, held, now)
        self._judge(now)

    def lose_connection(self) -> NoReturn:
        """Say that the scheduler is gone, and with it all that was sent there."""
        raise FleetError(f"the scheduler at {self._address} is gone: it closed the connection")

    async def _ask(self) -> tuple[dict[str, float], set[str]]:
        """When each worker reported last, by the scheduler's clock, and what silent ones have."""
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
        self._answered, self._heard, before = now, True, self._reports
        self._reports = {
            name: before[name] if before.get(name, (None,))[0] == report else (report, now)
            for name, report in reports.items()
        }
        most = SILENT + _PER_WORKER * len(reports)
        self.answering = [name for name, (_, seen) in self._reports.items() if now - seen < most]
        silent = self._reports.keys() - self.answering
        if self.answering:
            self._worked, self._ever = now, True
            if silent - self.silent:
                self._say(
                    f"{_named(silent - self.silent)} has not answered for {most:.0f} s; what it "
                    "has goes to others"
                )
        self.silent = set(silent)
        self.stuck = held if self.answering else set()

    def _judge(self, now: float) -> None:
        quiet, idle = now - self._answered, now - self._worked
        if quiet >= SILENT:
            self._tell(
                f"the scheduler at {self._address} has not answered for {quiet:.0f} s; waiting"
            )
            if quiet >= self._patience:
                raise FleetError(
                    f"the scheduler at {self._address} has not answered for {quiet:.0f} s"
                )
        elif not self._heard:
            return
        elif idle >= min(SILENT, self._patience) or (self.silent and not self.answering):
            self._tell(self._without_workers())
            if idle >= self._patience:
                self._end_without_workers()
        elif self._told:
            self._say(f"the cluster at {self._address} answers again")
            self._told = ""

    def _without_workers(self) -> str:
        if self.silent:
            return f"none of the workers at {self._address} answers ({len(self.silent)}); waiting"
        if self._ever:
            return f"no worker is left at {self._address}; waiting"
        return f"no workers at {self._address}; waiting"

    def _end_without_workers(self) -> NoReturn:
        if self._ever:
            raise FleetError(
                f"no worker at {self._address} has answered for {self._patience:g} s; start some "
                f"(dask worker {self._address})"
            )
        raise ParameterError(
            f"no worker came to the scheduler at {self._address} within {self._patience:g} s; "
            f"start some (dask worker {self._address}), or have more patience"
        )

    def _tell(self, sentence: str) -> None:
        """Say it once; the seconds in it may differ."""
        kind = sentence.partition(" for ")[0]
        if kind != self._told:
            self._told = kind
            self._say(sentence)


def _named(workers: Collection[str]) -> str:
    first = min(workers)
    return (
        f"worker {first}" if len(workers) == 1 else f"each of {len(workers)} workers, {first} too,"
    )
