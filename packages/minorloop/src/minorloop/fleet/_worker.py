"""Processes that identify one specimen after another and can be ended at any time.

A fit may run without end inside a compiled loop, and memory may run out; neither can be caught in
the same process. So each fit runs in a separate process, which holds no result or file that others
need. It ends when the process that started it is gone, or when it has received no task for `IDLE`
seconds. The workers of a Dask cluster also start such processes.
"""

from __future__ import annotations

import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeAlias

from minorloop.errors import FleetError
from minorloop.fleet._fitting import Found, Task, load_kernels

Work: TypeAlias = Callable[[Task, Path], Found]
"""Function that a worker applies to a task; it must belong to a module, because it is pickled."""

_ATTEMPTS = 2
"""Most workers that may end during the fit of one specimen."""
STARTS = 3
"""Most workers in a row that may end before they are ready."""
IDLE = 60.0
"""Seconds without a task after which a worker ends."""
_COMMAND = """
import sys
sys.path[:] = sys.argv[3:]
from minorloop.fleet._worker import serve
serve(int(sys.argv[1]), int(sys.argv[2]))
"""
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class FitProcesses:
    """Processes for fits; a free process is used again. Safe to use in threads."""

    def __init__(self) -> None:
        self._all: set[Worker] = set()
        self._free: list[Worker] = []
        self._closed = False

    def run(self, work: Work, task: Task, limit: float, say: Callable[[str], None]) -> Found:
        """Return the result of ``work`` on a task in a process, or its failure.

        A task is stopped after ``limit`` seconds. If its process ends, it is tried once more.
        ``say`` is called with sentences about faults.

        Raises a `FleetError` if no process can be started, or `close` is called meanwhile.
        """
        for attempt in range(1, _ATTEMPTS + 1):
            worker = self._ready()
            found = self._follow(worker, work, task, limit, say)
            if not isinstance(found, str):
                return found
            self._end(worker)
            if attempt < _ATTEMPTS and not self._closed:
                name = task.specimen.name
                say(f"the worker of specimen {name} {found}; the specimen is tried once more")
        self._check_open()
        reason = f"{_ATTEMPTS} workers ended during its fit, the last {found}"
        return task.failed(f"{reason}; look for a lack of memory")

    def close(self) -> None:
        """End all workers at once."""
        self._closed = True
        for worker in list(self._all):
            self._end(worker)

    def _ready(self) -> Worker:
        """Return a worker that waits for a task."""
        with suppress(IndexError):
            while True:
                worker = self._free.pop()
                if not worker.ended:  # a worker ends if it is idle for a long time
                    return worker
                self._end(worker)
        for _ in range(STARTS):
            self._check_open()
            worker = Worker()
            self._all.add(worker)
            self._check_open()
            try:
                # Seconds that a worker may take to load its kernels; their compilation takes less
                # than a minute
                worker.ask(300.0, load_kernels)
            except Exception:
                why = self._end(worker)
            else:
                return worker
        raise FleetError(f"workers cannot be started: the last of {STARTS} ended ({why})")

    def _follow(
        self, worker: Worker, work: Work, task: Task, limit: float, say: Callable[[str], None]
    ) -> Found | str:
        """Return the result of a fit within the limit, or the end of the worker in words."""
        try:
            found: Found = worker.ask(limit, work, task, worker.scratch)
        except TimeoutError:
            self._end(worker)
            name = task.specimen.name
            say(f"specimen {name} has reached the limit of {limit:g} s and is stopped")
            return task.failed(
                f"no model within the limit of {limit:g} s; check the record, or allow more time"
            )
        except Exception:  # after any error the worker is replaced
            return f"ended ({self._end(worker)})"
        self._free.append(worker)
        return found

    def _end(self, worker: Worker) -> str:
        self._all.discard(worker)
        return worker.end()

    def _check_open(self) -> None:
        if self._closed:
            self.close()  # ends workers that were started after the first call
            raise FleetError("the fleet was ended")


class LocalWorkers:
    """A number of processes on this machine, which do work as of `FitProcesses.run`."""

    def __init__(self, workers: int, work: Work, limit: float, say: Callable[[str], None]) -> None:
        self.ahead = 2 * workers
        self._workers, self._places = FitProcesses(), threading.Semaphore(workers)
        self._rest = work, limit, say

    def fit(self, task: Task) -> Found:
        """Return the result of a task, as `FitProcesses.run`; wait for a free worker."""
        work, limit, say = self._rest
        with self._places:
            return self._workers.run(work, task, limit, say)

    def close(self) -> None:
        """End all workers at once."""
        self._workers.close()


class Worker:
    """Handle of a worker process.

    The process has its own process group, so that Control-C at a terminal does not reach it.
    """

    def __init__(self) -> None:
        self.scratch = Path(tempfile.gettempdir(), f"minorloop-{os.urandom(8).hex()}")
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115
        self._ending = threading.Lock()
        self._pipe, theirs = Pipe()
        alive, self._alive = os.pipe()
        given = theirs.fileno(), alive
        self._process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND, *map(str, given), *sys.path],
            pass_fds=given,
            stdin=subprocess.DEVNULL,
            stdout=self._stderr,
            stderr=self._stderr,
            env={**os.environ, **dict.fromkeys(_ONE_THREAD, "1")},
            process_group=0,
        )
        theirs.close()
        os.close(alive)
        self.pid = self._process.pid

    @property
    def ended(self) -> bool:
        """Whether the process is gone."""
        return self._process.poll() is not None

    def ask(self, limit: float, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a function in the process.

        Raises a `TimeoutError` after ``limit`` seconds; an `EOFError` or an `OSError` if the
        process ends.
        """
        self._pipe.send((function, arguments))
        if not self._pipe.poll(limit if limit < math.inf else None):
            raise TimeoutError
        return self._pipe.recv()

    def end(self) -> str:
        """Kill the process; return its exit status and the last line that it wrote."""
        self._process.kill()
        status = self._process.wait()
        with self._ending:
            if self._stderr.closed:
                return ""
            self._pipe.close()
            os.close(self._alive)
            shutil.rmtree(self.scratch, ignore_errors=True)
            self._stderr.seek(0)
            said = self._stderr.read()[-2000:].decode(errors="replace").strip()
            self._stderr.close()
        how = f"exit status {status}" if status >= 0 else f"signal {-status}"
        with suppress(ValueError):
            how = signal.Signals(-status).name
        return ": ".join([how, *said.splitlines()[-1:]])


def serve(pipe: int, alive: int) -> None:
    """Call functions that a pipe sends, and answer on it, until the pipe ``alive`` closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with(alive)
    tasks = Connection(pipe)
    while tasks.poll(IDLE):
        function, arguments = tasks.recv()
        tasks.send(function(*arguments))


def _end_with(alive: int) -> None:
    """Let the system end this process when the pipe closes, even inside a compiled loop."""
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(alive, fcntl.F_SETOWN, os.getpid())
        flags = fcntl.fcntl(alive, fcntl.F_GETFL)
        fcntl.fcntl(alive, fcntl.F_SETFL, flags | os.O_ASYNC)
