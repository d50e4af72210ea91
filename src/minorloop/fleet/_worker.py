"""A process that identifies one specimen after another and can be ended at any time.

A fit may run for ever inside a compiled loop, and memory may run out; neither can be caught in
the process in which it happens. So each fit runs in a separate process, which holds no
result and no file that anybody else needs. It ends by itself when the process that started it is
gone, or when nothing was asked of it for `IDLE` seconds.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from minorloop.fleet._fitting import Found, Task, load_kernels

Work = Callable[[Task, Path], Found]
"""What a worker does; a function of a module, because it is sent by its name."""

IDLE = 60.0
"""Seconds without a task after which a worker ends."""
GRACE = 60.0
"""Seconds past the limit after which a worker that nobody watches is ended by the system."""
_LONGEST_ALARM = 1e8
"""Seconds, three years; the system refuses far longer ones."""
_COMMAND = """
import sys
sys.path[:] = sys.argv[2:]
from minorloop.fleet._worker import serve
serve(int(sys.argv[1]))
"""
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class Worker:
    """The process, seen from the one that started it.

    It is in a process group of its own, so that Control-C at a terminal does not reach it.

    Parameters
    ----------
    work : callable
        What it does with a task.
    limit : float
        Seconds that a task may take.
    """

    def __init__(self, work: Work, limit: float) -> None:
        self._scratch = Path(tempfile.gettempdir(), f"minorloop-{os.urandom(8).hex()}.csv")
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        alive, self._alive = os.pipe()
        self._process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND, str(alive), *sys.path],
            pass_fds=(alive,),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            env={**os.environ, **dict.fromkeys(_ONE_THREAD, "1")},
            process_group=0,
        )
        os.close(alive)
        self.ready = self.ask((work, self._scratch, limit))

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def ended(self) -> bool:
        """Whether the process is gone."""
        return self._process.poll() is not None

    def ask(self, message: Any) -> Future[Any]:
        """Send a message; gives the answer, or an exception if the process ends before."""
        answer: Future[Any] = Future()
        threading.Thread(target=self._exchange, args=(message, answer), daemon=True).start()
        return answer

    def _exchange(self, message: Any, answer: Future[Any]) -> None:
        try:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
            found = pickle.load(self._process.stdout)
        except Exception as error:  # whatever it is, this worker is of no more use
            answer.set_exception(error)
        else:
            answer.set_result(found)

    def is_stopped(self) -> bool:
        """Whether the process is stopped, as by SIGSTOP; False where the system does not say."""
        try:
            status = Path(f"/proc/{self.pid}/stat").read_text()
        except OSError:
            return False
        return status.rpartition(")")[2].split()[0] in ("T", "t")

    def end(self) -> str:
        """End the process at once; says how it ended, and the last line it wrote."""
        self._process.kill()
        status = self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError, ValueError):
                if stream is not None:
                    stream.close()
        if self._said.closed:
            return ""
        os.close(self._alive)
        self._scratch.unlink(missing_ok=True)
        self._said.seek(0)
        last = self._said.read()[-2000:].decode(errors="replace").strip().splitlines()[-1:]
        self._said.close()
        return ": ".join([_how(status), *last])


def _how(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"signal {-status}"


def serve(alive: int) -> None:
    """Answer tasks from stdin on stdout until there are no more: the process itself.

    Parameters
    ----------
    alive : int
        A pipe whose other end is open for as long as the process is that started this one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with(alive)
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a library prints is no answer
    work, scratch, limit = pickle.load(tasks)
    inbox: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(tasks, inbox, scratch), daemon=True).start()
    load_kernels()
    _send(answers, None)
    while True:
        try:
            task = inbox.get(timeout=IDLE)
        except queue.Empty:
            _leave(scratch)
        _set_alarm(limit + GRACE)
        found = work(task, scratch)
        _set_alarm(0)
        _send(answers, found)


def _listen(tasks: BinaryIO, inbox: queue.SimpleQueue[Task], scratch: Path) -> None:
    """Pass tasks on; the end of them is the end of the process, in the middle of a fit too."""
    try:
        while True:
            inbox.put(pickle.load(tasks))
    except Exception:
        _leave(scratch)


def _send(answers: BinaryIO, found: Any) -> None:
    pickle.dump(found, answers)
    answers.flush()


def _end_with(alive: int) -> None:
    """Let the system end this process when the pipe closes, even inside a compiled loop.

    Where it cannot, `_listen` does so when the loop lets it.
    """
    with suppress(ImportError, AttributeError, OSError):
        import fcntl

        fcntl.fcntl(alive, fcntl.F_SETOWN, os.getpid())
        flags = fcntl.fcntl(alive, fcntl.F_GETFL)
        fcntl.fcntl(alive, fcntl.F_SETFL, flags | os.O_ASYNC)


def _set_alarm(seconds: float) -> None:
    """Let the system end this process after that time, even inside a compiled loop."""
    if hasattr(signal, "setitimer") and seconds < float("inf"):
        signal.setitimer(signal.ITIMER_REAL, min(seconds, _LONGEST_ALARM))


def _leave(scratch: Path) -> None:
    scratch.unlink(missing_ok=True)
    os._exit(0)
