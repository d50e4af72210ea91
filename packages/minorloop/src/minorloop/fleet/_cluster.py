"""Identification on the workers of a Dask cluster."""

from __future__ import annotations

import asyncio
import atexit
import logging
import queue
import socket
import uuid
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from types import TracebackType
from typing import Any

from minorloop.errors import FleetError, MissingExtraError, ParameterError
from minorloop.fleet._cluster_watch import ClusterWatch
from minorloop.fleet._fitting import Found, Task
from minorloop.fleet._pool import Pool
from minorloop.fleet._reading import TICK
from minorloop.fleet._worker import Work

CONNECT = 10.0
"""Seconds to wait for the first answer of a scheduler."""
_CLOSE = 1.0
"""Seconds to wait for the disconnection from a scheduler."""
_AHEAD = 3
"""Batches that are queued for each worker."""
_LOSSES = 3
"""Lost results after which a specimen fails, as many as Dask allows workers to end."""
_BATCH_TIME, _MOST_EACH = 0.5, 64
"""Seconds of work in a batch, and its largest number of specimens."""

"""Key of a batch, and its results if there are any."""

_idle: list[Pool] = []
"""On a worker of the cluster: idle processes for the next batches."""


@atexit.register
def _close_idle() -> None:
    while _idle:
        _idle.pop().close()


def identify_batch(batch: Sequence[Task], limit: float, work: Work, topic: str) -> list[Found]:
    """Identify some specimens; runs on a worker of the cluster, in a process that it can end.

    Parameters
    ----------
    batch : sequence of Task
        What to identify.
    limit : float
        Seconds that one may take.
    work : callable
        Function that is applied to a task.
    topic : str
        Dask topic for messages about delays.
    """
    from distributed import get_worker

    worker = get_worker()
    pool = _idle_pool(limit, work) or Pool(1, limit, work, print)
    pool.say = lambda sentence: worker.log_event(topic, sentence)
    try:
        known = [one for one in pool.run(batch) if one is not None]
    except BaseException:
        pool.close()
        raise
    _idle.append(pool)
    found = {task.specimen.name: one for task, one in known}
    return [found[task.specimen.name] for task in batch]


def _idle_pool(limit: float, work: Work) -> Pool | None:
    with suppress(IndexError):
        while True:
            pool = _idle.pop()
            if (pool.limit, pool.work) == (limit, work):
                return pool
            pool.close()
    return None


class Cluster:
    """The workers of a Dask scheduler.

    Specimens are sent in batches of about half a second of work, so that sending them costs little.
    A batch under which workers end is split, so that only the specimen at fault fails.

    Parameters
    ----------
    address : str
        Address of the scheduler.
    patience : float
        Seconds to wait for a worker or for an answer.
    limit : float
        Seconds that one specimen may take.
    work : callable
        Function that a worker applies to a task.
    say : callable
        Called with sentences about delays and faults.
    total : int
        Largest number of tasks.

    Raises
    ------
    ParameterError
        If there is no scheduler at the address.
    """

    def __init__(
        self,
        address: str,
        patience: float,
        limit: float,
        work: Work,
        say: Callable[[str], None],
        total: int,
    ) -> None:
        self._client = _connect(address)
        self._limit, self._work = limit, work
        self._topic = f"minorloop-fleet-{uuid.uuid4().hex}"
        self._client.subscribe_topic(self._topic, lambda event: say(str(event[1])))
        self._watch = ClusterWatch(self._client, address, patience, say)
        self._sent: dict[str, _SentBatch] = {}
        self._answered: queue.SimpleQueue[tuple[str, Future[list[Found]] | None]] = (
            queue.SimpleQueue()
        )
        self._size, self._total = 1, total
        self._lost: Counter[str] = Counter()

    def __enter__(self) -> Cluster:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for key in list(self._sent):
            self._forget(key)
        with suppress(Exception):  # the scheduler may be gone; its state is not needed
            self._client.close(timeout=_CLOSE)

    def run(self, tasks: Iterable[Task | None]) -> Iterator[tuple[Task, Found] | None]:
        """Yield each task with its result; None at intervals without a result.

        Raises
        ------
        ParameterError
            If no worker comes within the patience.
        FleetError
            If the scheduler is gone, or no worker answers within the patience.
        """
        coming, left = iter(tasks), self._total
        while (left := self._fill(coming, left)) or self._sent:
            self._watch.look()
            for key in self._watch.stuck & self._sent.keys():
                self._send(self._forget(key))
            try:
                answer = self._answered.get(timeout=TICK)
            except queue.Empty:
                yield None
                continue
            found = self._settle(*answer)
            left = self._fill(coming, left)  # before others have time for what was found
            yield from found

    def _fill(self, coming: Iterator[Task | None], left: int) -> int:
        """Send batches until enough are queued; returns the number of tasks left."""
        workers = max(1, len(self._watch.answering))
        while left and len(self._sent) < _AHEAD * workers:
            # Small batches at the end, so that the workers end together.
            size = min(self._size, max(1, left // (2 * workers)))
            drawn = list(islice(coming, size))
            if not drawn:  # the other records could not be read
                return 0
            batch = [one for one in drawn if one is not None]
            if not batch:  # the other records are still being read
                return left
            left -= len(batch)
            self._send(batch)
        return left

    def _send(self, batch: list[Task]) -> None:
        chosen = self._watch.answering if self._watch.silent else None
        future = self._client.submit(
            identify_batch,
            batch,
            self._limit,
            self._work,
            self._topic,
            pure=False,
            workers=chosen,
            allow_other_workers=bool(chosen),
        )
        self._sent[future.key] = _SentBatch(future, batch)
        future.add_done_callback(self._fetch)

    def _fetch(self, future: Any) -> None:
        """Fetch a result on Dask's own thread, because it may never arrive."""
        if future.status != "finished":
            self._answered.put((future.key, None))
            return
        fetched = asyncio.run_coroutine_threadsafe(
            _gather(self._client, future), self._client.loop.asyncio_loop
        )
        fetched.add_done_callback(lambda done: self._answered.put((future.key, done)))

    def _forget(self, key: str) -> list[Task]:
        """Cancel a batch; returns its tasks."""
        sent = self._sent.pop(key)
        with suppress(Exception):  # without a scheduler there is nothing to release
            sent.future.release()
        return sent.batch

    def _settle(self, key: str, fetched: Future[list[Found]] | None) -> list[tuple[Task, Found]]:
        if key not in self._sent:
            return []
        future = self._sent[key].future
        if future.status == "error":  # the worker died, again and again, or could not take it
            return self._split(self._forget(key), future.exception(timeout=_CLOSE))
        if future.status == "cancelled":
            self._watch.lose_connection()
        if fetched is None or fetched.cancelled() or fetched.exception() is not None:
            return self._resend(self._forget(key))  # its worker left with the result
        batch, found = self._forget(key), fetched.result()
        each = sum(one.get("seconds", 0.0) for one in found) / len(batch)
        self._size = min(_MOST_EACH, max(1, round(_BATCH_TIME / max(each, 1e-3))))
        return list(zip(batch, found, strict=True))

    def _resend(self, batch: list[Task]) -> list[tuple[Task, Found]]:
        self._lost.update(task.specimen.name for task in batch)
        if max(self._lost[task.specimen.name] for task in batch) > _LOSSES:
            return self._split(batch, FleetError("its result did not arrive"))
        self._send(batch)
        return []

    def _split(self, batch: list[Task], error: BaseException) -> list[tuple[Task, Found]]:
        if len(batch) == 1:
            reason = f"every worker ended during its fit: {type(error).__name__}: {error}"
            return [(batch[0], {"error": reason})]
        for task in batch:
            self._send([task])
        return []


@dataclass(frozen=True)
class _SentBatch:
    """A batch that was sent, and its future."""

    future: Any
    batch: list[Task]


async def _gather(client: Any, future: Any) -> list[Found]:
    found: list[Found] = await client.gather(future, asynchronous=True)
    return found


def _connect(address: str) -> Any:
    from distributed import Client

    # Losses are reported in one sentence; Dask would add a page of traceback.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        return Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None


def check_address(address: str) -> None:
    """Check that an address is valid and that something listens there.

    Raises a `MissingExtraError` if Dask is not installed; a `ParameterError` if there is no
    scheduler at the address.
    """
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise MissingExtraError("dask.distributed", "fleet") from None
    scheme, _, place = address.partition("://")
    if scheme == "inproc":
        return
    host, _, port = place.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not port.isdecimal():
        raise ParameterError(
            f"address is {address!r}; give that of a Dask scheduler, such as tcp://10.0.0.1:8786"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT).close()
    except (OSError, OverflowError, UnicodeError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None
