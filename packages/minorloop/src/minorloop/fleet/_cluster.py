"""Identification on the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import atexit
import logging
import socket
import time
import uuid
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from functools import partial
from typing import Any

from minorloop.errors import FleetError, MissingExtraError, ParameterError
from minorloop.fleet._fitting import Found, Task
from minorloop.fleet._worker import FitProcesses, Work

_CONNECT = 10.0
"""Seconds to wait for the first answer of a scheduler."""
SILENT = 4.0
"""Seconds without a report after which a message says so; workers report up to twice a second."""
_PER_WORKER = 0.02
"""Seconds that each worker adds, because Dask makes reports rarer by 0.005 s for each."""
_EVERY = 0.5
"""Seconds between two requests to the scheduler."""
_CLOSE = 1.0
"""Seconds to wait for the disconnection from a scheduler."""
_AHEAD = 3
"""Specimens that are read or queued for each thread of the workers."""

_workers = FitProcesses()
"""On a worker of the cluster: its processes, idle ones for the next specimens."""
atexit.register(_workers.close)


def _fit_on_worker(work: Work, task: Task, limit: float, topic: str) -> Found:
    """Do as `FitProcesses.run` on a worker of the cluster, with messages in a topic of Dask."""
    from distributed import get_worker

    return _workers.run(work, task, limit, partial(get_worker().log_event, topic))


class Cluster:
    """The workers of the Dask scheduler at an address, which do work as of `FitProcesses.run`.

    ``patience`` are the seconds to wait for a worker or for an answer.

    Raises a `ParameterError` if there is no scheduler at the address.
    """

    def __init__(
        self, address: str, patience: float, work: Work, limit: float, say: Callable[[str], None]
    ) -> None:
        self._address, self._patience, self._say = address, patience, say
        self._topic = f"minorloop-fleet-{uuid.uuid4().hex}"
        self._fit = partial(_fit_on_worker, work, limit=limit, topic=self._topic)
        self.ahead = _AHEAD
        self._sent: dict[str, Future[Found | None]] = {}
        self._reports: dict[str, tuple[float, float]] = {}
        self._answering: list[str] = []
        self._silent: list[str] = []
        self._trouble, self._closed = "", False
        self._client = _connect(address)
        self._answered = self._worked = time.monotonic()
        self._client.subscribe_topic(self._topic, lambda event: say(str(event[1])))
        self._watching = self._begin(self._watch())

    def fit(self, task: Task) -> Found:
        """Return the result of a task; raises a `FleetError` if the scheduler is gone."""
        while True:
            future = self._client.submit(
                self._fit,
                task,
                pure=False,
                workers=self._answering if self._silent else None,
                allow_other_workers=bool(self._silent),
            )
            answer: Future[Found | None] = self._begin(_gathered(self._client, future))
            self._sent[future.key] = answer
            found = None
            with suppress(CancelledError, OSError):  # its worker is silent, or left with the result
                self._check_connection()
                found = answer.result()
            del self._sent[future.key]
            if found is not None:
                return found
            self._check_connection()
            if future.status == "error":
                error = future.exception(timeout=_CLOSE)
                reason = f"every worker ended during its fit: {type(error).__name__}: {error}"
                return task.failed(reason)

    def look(self) -> None:
        """Say what does not answer.

        Raises a `FleetError` if the scheduler is gone, or it or all workers do not answer within
        the patience.
        """
        self._check_connection()
        now, most = time.monotonic(), min(SILENT, self._patience)
        trouble, since = f"the scheduler at {self._address} does not answer", self._answered
        if now - since < most:
            trouble, since = f"no worker at {self._address} answers", self._worked
        if now - since < most:
            trouble = ""
        elif now - since >= self._patience:
            raise FleetError(
                f"{trouble} within {self._patience:g} s; start one, or give a longer patience"
            )
        if trouble != self._trouble:
            self._say(f"{trouble}; waiting" if trouble else f"{self._address} answers again")
            self._trouble = trouble

    def close(self) -> None:
        """Cancel what was sent, and disconnect."""
        self._closed = True
        for answer in (self._watching, *list(self._sent.values())):
            answer.cancel()
        with suppress(Exception):  # the scheduler may be gone; its state is not needed
            self._client.close(timeout=_CLOSE)

    def _begin(self, coroutine: Any) -> Future[Any]:
        """Start a coroutine on Dask's own thread, because it may never end."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._client.loop.asyncio_loop)

    def _check_connection(self) -> None:
        if self._closed or self._client.status != "running":
            raise FleetError(f"the scheduler at {self._address} is gone: it closed the connection")

    async def _watch(self) -> None:
        """Ask again and again which workers answer, and take specimens from those that do not."""
        while True:
            with suppress(OSError):  # seen by its status, or asked again
                await self._ask()
            await asyncio.sleep(_EVERY)

    async def _ask(self) -> None:
        scheduler, now = self._client.scheduler, time.monotonic
        workers = (await scheduler.identity())["workers"]
        before, self._reports, self._answered = self._reports, {}, now()
        for name, one in workers.items():
            # The time of a report is by the clock of the scheduler: only its change counts.
            known, report = before.get(name), one["last_seen"]
            self._reports[name] = known if known and known[0] == report else (report, now())
        self._worked = max([self._worked, *(when for _, when in self._reports.values())])
        self.ahead = _AHEAD * max(1, sum(one["nthreads"] for one in workers.values()))
        most = SILENT + _PER_WORKER * len(workers)
        self._answering = [one for one, (_, when) in self._reports.items() if now() - when < most]
        silent, known_silent = sorted(workers.keys() - self._answering), self._silent
        self._silent = silent
        if not (silent and self._answering):
            return
        if new := [one for one in silent if one not in known_silent]:
            named = " and ".join(new)
            self._say(
                f"worker {named} has not answered for {most:.0f} s; its specimens go to others"
            )
        held = [
            await scheduler.processing(workers=silent),
            await scheduler.has_what(workers=silent),
        ]
        for key in (key for each in held for keys in each.values() for key in keys):
            if answer := self._sent.get(key):
                answer.cancel()


async def _gathered(client: Any, future: Any) -> Found | None:
    """Return a result; None if it was lost."""
    found: Found | None = await client.gather(future, errors="skip", asynchronous=True)
    return found


def _connect(address: str) -> Any:
    """Return a client of a scheduler; what listens nowhere is refused at once."""
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("dask.distributed", "fleet") from None
    scheme, _, place = address.partition("://")
    host, _, port = place.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not port.isdecimal():
        raise ParameterError(
            f"address is {address!r}; give that of a Dask scheduler, such as tcp://10.0.0.1:8786"
        )
    # Losses are reported in one sentence; Dask would add a page of traceback.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT).close()
        return Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, OverflowError, ValueError, TimeoutError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None
