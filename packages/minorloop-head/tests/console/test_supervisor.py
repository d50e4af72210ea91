import contextlib
import os
import signal
import time
from pathlib import Path

import pytest

from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.supervisor import Part, Supervisor


def ticking(handle, folder):
    """Write the process id to a file, and send it to the other; for a process of its own."""
    other = next(name for name in handle.names if name != handle.name)
    channel = NewestPipe()
    stop = handle.begin(**{other: channel})
    (Path(folder) / f"{handle.name}-{os.getpid()}{'-again' if handle.again else ''}").touch()
    last = None
    while not stop.wait(0.01):
        handle.beat()
        pipe = channel.next(last, 0)
        if pipe is not None:
            last = pipe
            with contextlib.suppress(OSError):
                pipe.send_bytes(str(os.getpid()).encode())
        if last is not None and last.poll():
            with contextlib.suppress(EOFError, OSError):
                other_pid = last.recv_bytes().decode()
                (Path(folder) / f"{handle.name}-{os.getpid()}-met-{other_pid}").touch()
    (Path(folder) / f"{handle.name}-{os.getpid()}-stop").touch()


class Watched:
    """Two processes that exchange their ids, and the files that they write."""

    def __init__(self, folder):
        parts = [
            Part(name=name, target=ticking, args=(str(folder),), patience=2.0) for name in "ab"
        ]
        self.notes, self.folder = [], folder
        self.supervisor = Supervisor(parts, [("a", "b")], notify=self.notes.append)
        self.supervisor.start()

    def until(self, pattern):
        """The id of the process that wrote a file by a pattern; the supervisor runs meanwhile."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            for path in self.folder.glob(pattern):
                return int(path.name.split("-")[1])
            self.supervisor.check()
        raise AssertionError(f"{pattern} never came")


@pytest.fixture
def watched(tmp_path):
    found = Watched(tmp_path)
    yield found
    found.supervisor.end()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_ended_or_hangs_is_restarted_and_meets_the_other(watched, how):
    other, before = watched.until("a-*-met-*"), watched.until("b-*-met-*")
    os.kill(before, how)
    after = watched.until("b-*-again")
    assert watched.until(f"a-*-met-{after}") == other
    assert watched.until(f"b-{after}-met-*") == after
    what = {signal.SIGKILL: "has ended; it is", signal.SIGSTOP: "hangs; it is killed and"}
    assert watched.notes == [f"the b process {what[how]} restarted"]
    with pytest.raises(ProcessLookupError):
        os.kill(before, 0)


def checked_until(supervisor, holds):
    """Run the supervisor until a condition is met."""
    deadline = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < deadline, "it was never met"
        supervisor.check()


def leading(handle):
    """Have a pipe to the other process; for a process of its own."""
    handle.begin(b=NewestPipe()).wait()


def following(handle, met):
    """End when the other process does; for a process of its own."""
    channel = NewestPipe()
    handle.begin(a=channel)
    pipe = channel.next()
    Path(met).touch()
    with contextlib.suppress(EOFError, OSError):
        pipe.recv_bytes()


def test_of_a_process_that_ends_because_another_did_nothing_is_said(tmp_path):
    said, met = [], tmp_path / "met"
    parts = [Part(name="a", target=leading), Part(name="b", target=following, args=(str(met),))]
    supervisor = Supervisor(parts, [("a", "b")], notify=said.append)
    supervisor.start()
    try:
        before = {supervisor.pid(name) for name in "ab"}
        checked_until(supervisor, met.exists)
        os.kill(supervisor.pid("a"), signal.SIGKILL)
        checked_until(supervisor, lambda: not {supervisor.pid(name) for name in "ab"} & before)
        assert said == ["the a process has ended; it is restarted"]
    finally:
        supervisor.end()


def waiting(handle):
    """Begin, and never give a heartbeat; for a process of its own."""
    handle.begin().wait()


@pytest.mark.skipif(not hasattr(os, "waitid"), reason="the system does not tell who is stopped")
def test_a_process_that_is_stopped_before_its_first_heartbeat_is_restarted():
    said = []
    supervisor = Supervisor([Part(name="a", target=waiting, patience=0.2)], [], notify=said.append)
    supervisor.start()
    try:
        before = supervisor.pid("a")
        os.kill(before, signal.SIGSTOP)
        checked_until(supervisor, lambda: supervisor.pid("a") != before)
        assert said == ["the a process hangs; it is killed and restarted"]
    finally:
        supervisor.end()


def test_all_processes_end_with_the_supervisor(watched, tmp_path):
    pids = watched.until("a-*-met-*"), watched.until("b-*-met-*")
    for pid in pids:
        os.kill(pid, signal.SIGINT)  # as a terminal does
    watched.supervisor.end()
    assert len(list(tmp_path.glob("*-stop"))) == 2
    assert watched.notes == []
