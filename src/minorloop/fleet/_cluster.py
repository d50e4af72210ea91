"""Specimens on their way to the workers of a Dask cluster and back."""

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
from minorloop.fleet._worker import Work

CONNECT = 10.0
"""Seconds within which a scheduler has to answer for the first time."""
_TICK = 0.2
_CLOSE = 1.0
"""Seconds to take leave of a scheduler."""
_AHEAD = 3
"""Batches on their way to each worker."""
_LOSSES = 3
"""Results of a specimen that may be lost; Dask bears as many workers that end."""
_STINT, _MOST_EACH = 0.5, 64
"""Seconds of work in a batch, and the most specimens."""

_Answer = tuple[str, "Future[list[Found]] | None"]
"""Key of a batch, and what came back where something did."""

_idle: list[Pool] = []
"""On a worker of the cluster: processes of batches that are done."""


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
        What is done with a task.
    topic : str
        Where to say what takes long.
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

    Specimens go in batches of about half a second of work, so that sending them costs little; a
    batch that no worker survives is taken apart, so that one specimen fails and not its
    neighbours.

    Parameters
    ----------
    address : str
        Of the scheduler.
    patience : float
        Seconds to wait for a worker or for an answer.
    limit : float
        Seconds that one specimen may take.
    work : callable
        What a worker does with a task.
    say : callable
        Told in a sentence what is waited for.
    total : int
        How many tasks there are at most.

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
        with suppress(Exception):  # it may be gone, and has nothing that is of use any more
            self._client.close(timeout=_CLOSE)

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, Found] | None]:
        """What becomes of each task, as it becomes known; None where nothing new is known.

        Raises
        ------
        ParameterError
            If no worker comes within the patience.
        FleetError
            If the scheduler is gone, or no worker answers for all the patience.
        """
        coming, left = iter(tasks), self._total
        while (left := self._fill(coming, left)) or self._sent:
            self._watch.look()
            for key in self._watch.stuck & self._sent.keys():
                self._send(self._forget(key))
            try:
                answer = self._answered.get(timeout=_TICK)
            except queue.Empty:
                yield None
                continue
            found = self._settle(*answer)
            left = self._fill(coming, left)  # before others have time for what was found
            yield from found

    def _fill(self, coming: Iterator[Task], left: int) -> int:
        """Send until enough is on its way; gives how many are left."""
        workers = max(1, len(self._watch.answering))
        while left and len(self._sent) < _AHEAD * workers:
            # Small batches at the end, so that the workers end together.
            size = min(self._size, max(1, left // (2 * workers)))
            batch = list(islice(coming, size))
            if not batch:  # others could not be read
                return 0
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
        """Fetch what came back, on Dask's own thread: it may never come."""
        if future.status != "finished":
            self._answered.put((future.key, None))
            return
        fetched = asyncio.run_coroutine_threadsafe(
            _gather(self._client, future), self._client.loop.asyncio_loop
        )
        fetched.add_done_callback(lambda done: self._answered.put((future.key, done)))

    def _forget(self, key: str) -> list[Task]:
        """Want nothing more of a batch; gives what was in it."""
        sent = self._sent.pop(key)
        with suppress(Exception):  # without a scheduler there is nothing to be released
            sent.future.release()
        return sent.batch

    def _settle(self, key: str, fetched: Future[list[Found]] | None) -> list[tuple[Task, Found]]:
        if key not in self._sent:
            return []
        future = self._sent[key].future
        if future.status == "error":  # the worker died, again and again, or could not take it
            return self._take_apart(self._forget(key), future.exception(timeout=_CLOSE))
        if future.status == "cancelled":
            self._watch.lose_connection()
        if fetched is None or fetched.cancelled() or fetched.exception() is not None:
            return self._do_again(self._forget(key))  # its worker left with the result
        batch, found = self._forget(key), fetched.result()
        each = sum(one.get("seconds", 0.0) for one in found) / len(batch)
        self._size = min(_MOST_EACH, max(1, round(_STINT / max(each, 1e-3))))
        return list(zip(batch, found, strict=True))

    def _do_again(self, batch: list[Task]) -> list[tuple[Task, Found]]:
        self._lost.update(task.specimen.name for task in batch)
        if max(self._lost[task.specimen.name] for task in batch) > _LOSSES:
            return self._take_apart(batch, FleetError("its result did not come back"))
        self._send(batch)
        return []

    def _take_apart(self, batch: list[Task], error: BaseException) -> list[tuple[Task, Found]]:
        if len(batch) == 1:
            reason = f"no worker lived to the end: {type(error).__name__}: {error}"
            return [(batch[0], {"error": reason})]
        for task in batch:
            self._send([task])
        return []


@dataclass(frozen=True)
class _SentBatch:
    """A batch on its way, and what stands for it at the scheduler."""

    future: Any
    batch: list[Task]


async def _gather(client: Any, future: Any) -> list[Found]:
    found: list[Found] = await client.gather(future, asynchronous=True)
    return found


def _connect(address: str) -> Any:
    from distributed import Client

    # What is lost is said in a sentence; Dask would add a page to it, even after the end.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        return Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None


def check_address(address: str) -> None:
    """Refuse at once what is no address, or where nothing listens.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    ParameterError
        If there is no scheduler at the address.
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
