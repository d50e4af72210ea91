"""A process that identifies one specimen after another and can be ended at any time.

A fit may run for ever inside a compiled loop, and memory may run out; neither can be caught in
the process in which it happens. So each fit runs in a separate process, which holds no result or
file that others need. It ends when the process that started it is gone, or when it has received no
task for `IDLE` seconds.
"""

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
"""Function that a worker applies to a task; it must belong to a module, because it is pickled."""

IDLE = 60.0
"""Seconds without a task after which a worker ends."""
GRACE = 60.0
"""Seconds after the time limit at which the system ends a worker that is not watched."""
_LONGEST_ALARM = 1e8
"""Seconds, three years; the system refuses much longer timers."""
_COMMAND = """
import sys
sys.path[:] = sys.argv[2:]
from minorloop.fleet._worker import serve
serve(int(sys.argv[1]))
"""
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


class Worker:
    """Handle of a worker process.

    The process has its own process group, so that Control-C at a terminal does not reach it.

    Parameters
    ----------
    work : callable
        Function that it applies to a task.
    limit : float
        Seconds that a task may take.
    """

    def __init__(self, work: Work, limit: float) -> None:
        self._scratch = Path(tempfile.gettempdir(), f"minorloop-{os.urandom(8).hex()}.csv")
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115
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
        """Send a message; the future gives the answer, or an exception if the process ends."""
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
        except Exception as error:  # after any error this worker is replaced
            answer.set_exception(error)
        else:
            answer.set_result(found)

    def is_stopped(self) -> bool:
        """Whether the process is stopped, as by SIGSTOP; False where /proc does not exist."""
        try:
            status = Path(f"/proc/{self.pid}/stat").read_text()
        except OSError:
            return False
        return status.rpartition(")")[2].split()[0] in ("T", "t")

    def end(self) -> str:
        """Kill the process; returns its exit status and the last line that it wrote."""
        self._process.kill()
        status = self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(OSError, ValueError):
                if stream is not None:
                    stream.close()
        if self._stderr.closed:
            return ""
        os.close(self._alive)
        self._scratch.unlink(missing_ok=True)
        self._stderr.seek(0)
        last = self._stderr.read()[-2000:].decode(errors="replace").strip().splitlines()[-1:]
        self._stderr.close()
        return ": ".join([_exit_text(status), *last])


def _exit_text(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    try:
        return signal.Signals(-status).name
    except ValueError:
        return f"signal {-status}"


def serve(alive: int) -> None:
    """Main loop of the process: answer tasks from stdin on stdout.

    Parameters
    ----------
    alive : int
        A pipe whose other end is open while the parent process runs.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _end_with(alive)
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # text that a library prints must not mix with answers
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
    """Queue the tasks; at the end of stdin the process ends, even during a fit."""
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

    Where the system cannot, `_listen` ends it when the loop releases the GIL.
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
