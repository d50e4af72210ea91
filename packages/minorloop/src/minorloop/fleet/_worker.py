"""Processes that identify one specimen after another and can be ended at any time.

A fit may run without end inside a compiled loop, and memory may run out; neither can be caught in
the same process. So each fit runs in a separate process, which holds no result or file that others
need. It ends when the process that started it is gone, or when it has received no task for `IDLE`
seconds. The workers of a Dask cluster also start such processes.
"""

from __future__ import annotations

import math
import os
import pickle
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
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
sys.path[:] = sys.argv[2:]
from minorloop.fleet._worker import serve
serve(int(sys.argv[1]))
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
                worker.ready.result(300.0)
            except Exception:
                why = self._end(worker)
            else:
                return worker
        raise FleetError(f"workers cannot be started: the last of {STARTS} ended ({why})")

    def _follow(
        self, worker: Worker, work: Work, task: Task, limit: float, say: Callable[[str], None]
    ) -> Found | str:
        """Return the result of a fit within the limit, or the end of the worker in words."""
        answer = worker.ask(work, task, worker.scratch)
        try:
            found: Found = answer.result(limit if limit < math.inf else None)
        except TimeoutError:
            self._end(worker)
            name = task.specimen.name
            say(f"specimen {name} has reached the limit of {limit:g} s and is stopped")
            return task.failed(
                f"no model within the limit of {limit:g} s; check the record, or allow more time"
            )
        except Exception:
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
        alive, self._alive = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND, str(alive), *sys.path],
            pass_fds=(alive,),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            env={**os.environ, **dict.fromkeys(_ONE_THREAD, "1")},
            process_group=0,
        )
        os.close(alive)
        self.pid = self._process.pid
        self.ready = self.ask(load_kernels)

    @property
    def ended(self) -> bool:
        """Whether the process is gone."""
        return self._process.poll() is not None

    def ask(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Call a function in the process; the future has an exception if the process ends."""
        answer: Future[Any] = Future()
        message = function, arguments
        threading.Thread(target=self._exchange, args=(message, answer), daemon=True).start()
        return answer

    def _exchange(self, message: Any, answer: Future[Any]) -> None:
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
            answer.set_result(pickle.load(self._process.stdout))
        except Exception as error:  # after any error this worker is replaced
            answer.set_exception(error)

    def end(self) -> str:
        """Kill the process; return its exit status and the last line that it wrote."""
        self._process.kill()
        status = self._process.wait()
        with self._ending:
            if self._stderr.closed:
                return ""
            for stream in (self._process.stdin, self._process.stdout):
                with suppress(OSError, ValueError):
                    if stream is not None:
                        stream.close()
            os.close(self._alive)
            shutil.rmtree(self.scratch, ignore_errors=True)
            self._stderr.seek(0)
            said = self._stderr.read()[-2000:].decode(errors="replace").strip()
            self._stderr.close()
        how = f"exit status {status}" if status >= 0 else f"signal {-status}"
        with suppress(ValueError):
            how = signal.Signals(-status).name
        return ": ".join([how, *said.splitlines()[-1:]])


def serve(alive: int) -> None:
    """Call functions from stdin, and answer on stdout, until the pipe ``alive`` closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with(alive)
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # text that a library prints must not mix with answers
    while select.select([tasks], [], [], IDLE)[0]:
        function, arguments = pickle.load(tasks)
        pickle.dump(function(*arguments), answers)
        answers.flush()


def _end_with(alive: int) -> None:
    """Let the system end this process when the pipe closes, even inside a compiled loop."""
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(alive, fcntl.F_SETOWN, os.getpid())
        flags = fcntl.fcntl(alive, fcntl.F_GETFL)
        fcntl.fcntl(alive, fcntl.F_SETFL, flags | os.O_ASYNC)
