"""Worker processes for long computations, so that the server keeps answering.

Each worker does one task at a time and may report its stages. A worker is killed and replaced if it
takes too long, is stopped, or its page has closed. All workers end with the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections.abc import AsyncIterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from minorloop.errors import MinorloopError
from minorloop.page.process import BEGINNING, be_nice, bind_to_parent, is_stopped, limit_resources

TASKS = "minorloop.page.lab_work"
_POLL = 0.01


@dataclass(frozen=True)
class Work:
    """Tasks and limits of a worker, as in `Workers`."""

    tasks: str
    nice: int
    memory: int
    file: int


class Workers:
    """A pool of ``count`` worker processes with a niceness.

    A task may take at most ``longest`` seconds. ``tasks`` is the module of the tasks, with a
    function ``warm_up``. ``memory`` and ``file`` are the most bytes of memory of a worker, and of a
    file that it writes, on systems that have such limits.
    """

    def __init__(
        self,
        count: int,
        *,
        longest: float = 180.0,
        tasks: str = TASKS,
        nice: int = 10,
        memory: int = 4 * 1024**3,
        file: int = 64 * 1024**2,
    ) -> None:
        self._count, self._longest = count, longest
        self._work = Work(tasks, nice, memory, file)
        self._idle: asyncio.Queue[_Worker] = asyncio.Queue()
        self._all: set[_Worker] = set()

    def start(self) -> None:
        """Start the processes if they do not run; they import and compile their code.

        The first task also starts them; an earlier start saves its user the wait.
        """
        if not self._all:
            for _ in range(self._count):
                self._add()

    async def stop(self) -> None:
        """Kill the processes."""
        for worker in self._all:
            worker.end()

    async def run(self, task: str, **options: Any) -> AsyncIterator[dict[str, Any]]:
        """Yield the reports of a task; an error is ``{"error": sentence}``."""
        self.start()
        if self._idle.empty():
            yield {"stage": "waiting for others to finish"}
        worker = await self._idle.get()
        while worker.ended():  # while it was idle
            self._replace(worker)
            worker = await self._idle.get()
        whole = False
        try:
            async with asyncio.timeout(BEGINNING):
                await worker.ready()
            worker.pipe.send((task, options))
            async with asyncio.timeout(self._longest):
                async for report in worker.reports():
                    yield report
            whole = True
        except TimeoutError:
            yield {
                "error": f"this took over {self._longest:g} s; use fewer rows or levels, or try "
                "again when the machine has less to do"
            }
        except (EOFError, OSError):
            yield {"error": "the computation ended unexpectedly; use fewer levels or fewer rows"}
        finally:
            if whole:
                self._idle.put_nowait(worker)
            else:  # its result is not needed any more
                self._replace(worker)

    async def ask(self, task: str, **options: Any) -> dict[str, Any]:
        """Return the last report of a task."""
        last: dict[str, Any] = {}
        async for report in self.run(task, **options):
            last = report
        return last

    def _replace(self, worker: _Worker) -> None:
        worker.end()
        self._all.discard(worker)
        self._add()

    def _add(self) -> None:
        worker = _Worker(self._work)
        self._all.add(worker)
        self._idle.put_nowait(worker)


class _Worker:
    def __init__(self, work: Work) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, work), daemon=True)
        self._process.start()
        self._ready = False
        theirs.close()

    async def ready(self) -> None:
        """Wait for the start of the worker, which does not count as time of a task."""
        if not self._ready:
            await self._next()
            self._ready = True

    async def reports(self) -> AsyncIterator[dict[str, Any]]:
        """Yield reports until the task is done."""
        while True:
            report = await self._next()
            if report is None:
                return
            yield report

    async def _next(self) -> Any:
        while not self.pipe.poll():
            if self._stopped():
                raise EOFError
            await asyncio.sleep(_POLL)
        return self.pipe.recv()

    def _stopped(self) -> bool:
        """Return whether a signal has stopped the worker, so that it would never answer."""
        return is_stopped(self._process.pid or 0)

    def ended(self) -> bool:
        """Return whether the worker cannot work any more."""
        return self._stopped() or not self._process.is_alive()

    def end(self) -> None:
        with contextlib.suppress(OSError):
            self.pipe.close()
        self._process.kill()  # the only signal that ends a stopped process


def serve(pipe: Connection, work: Work) -> None:
    """Do tasks until the pipe closes; runs in a separate process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, which ends its workers
    be_nice(work.nice)
    bind_to_parent("page-worker", signal.SIGKILL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    tasks = importlib.import_module(work.tasks)
    tasks.warm_up()
    limit_resources(work.memory, work.file)
    with contextlib.suppress(EOFError, OSError):
        pipe.send(None)  # ready
        while True:
            task, options = pipe.recv()
            try:
                for report in getattr(tasks, task)(**options):
                    pipe.send(report)
            except MinorloopError as error:
                pipe.send({"error": str(error)})
            except MemoryError:
                most = f"{work.memory / 1024**3:.3g} GiB of memory"
                sentence = f"this needs more than the allowed {most}; use fewer rows or levels"
                pipe.send({"error": sentence})
            except (OSError, ValueError) as error:
                pipe.send({"error": f"this cannot be done: {error}"})
            pipe.send(None)


def _end_with_parent() -> None:
    """End this process when its parent ends; runs in a separate thread."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
