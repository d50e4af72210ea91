import contextlib
import os
import signal
import time
from pathlib import Path

import pytest

from minorloop.head.console.channel import NewestPipe
from minorloop.head.console.supervisor import Part, Supervisor, tie


def ticking(post, folder):
    """Write down who this is, and answer the other; for a process of its own."""
    other = next(name for name in post.names if name != post.name)
    channel = NewestPipe()
    over = post.begin(**{other: channel})
    (Path(folder) / f"{post.name}-{os.getpid()}{'-again' if post.again else ''}").touch()
    last = None
    while not over.wait(0.01):
        post.beat()
        pipe = channel.next(last, 0)
        if pipe is not None:
            last = pipe
            with contextlib.suppress(OSError):
                pipe.send_bytes(str(os.getpid()).encode())
        if last is not None and last.poll():
            with contextlib.suppress(EOFError, OSError):
                told = last.recv_bytes().decode()
                (Path(folder) / f"{post.name}-{os.getpid()}-met-{told}").touch()
    (Path(folder) / f"{post.name}-{os.getpid()}-over").touch()


class Watched:
    """Two processes that meet, and what they wrote down."""

    def __init__(self, folder):
        parts = [
            Part(name=name, target=ticking, args=(str(folder),), patience=2.0) for name in "ab"
        ]
        self.said, self.folder = [], folder
        self.supervisor = Supervisor(parts, [("a", "b")], said=self.said.append)
        self.supervisor.start()

    def until(self, pattern):
        """The process that wrote down what matches a pattern, while they are looked after."""
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            for path in self.folder.glob(pattern):
                return int(path.name.split("-")[1])
            self.supervisor.look_after()
        raise AssertionError(f"{pattern} never came")


@pytest.fixture
def watched(tmp_path):
    found = Watched(tmp_path)
    yield found
    found.supervisor.end()


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_what_ended_or_stands_still_is_started_anew_and_meets_the_other(watched, how):
    other, before = watched.until("a-*-met-*"), watched.until("b-*-met-*")
    os.kill(before, how)
    after = watched.until("b-*-again")
    assert watched.until(f"a-*-met-{after}") == other
    assert watched.until(f"b-{after}-met-*") == after
    what = {signal.SIGKILL: "has ended; it is", signal.SIGSTOP: "stands still; it is ended and"}
    assert watched.said == [f"the b process {what[how]} started anew"]
    with pytest.raises(ProcessLookupError):
        os.kill(before, 0)


def waiting(post):
    """Begin, and never give a sign of life; for a process of its own."""
    post.begin().wait()


@pytest.mark.skipif(not hasattr(os, "waitid"), reason="the system does not tell who is stopped")
def test_what_is_stopped_before_its_first_sign_of_life_is_started_anew():
    said = []
    supervisor = Supervisor([Part(name="a", target=waiting, patience=0.2)], [], said=said.append)
    supervisor.start()
    try:
        before, deadline = supervisor.pid("a"), time.monotonic() + 60
        os.kill(before, signal.SIGSTOP)
        while supervisor.pid("a") == before and time.monotonic() < deadline:
            supervisor.look_after()
        assert supervisor.pid("a") != before
        assert said == ["the a process stands still; it is ended and started anew"]
    finally:
        supervisor.end()


def test_at_the_end_all_of_them_end(watched, tmp_path):
    pids = watched.until("a-*-met-*"), watched.until("b-*-met-*")
    for pid in pids:
        os.kill(pid, signal.SIGINT)  # as a terminal does
    watched.supervisor.end()
    assert len(list(tmp_path.glob("*-over"))) == 2
    assert watched.said == []


def test_a_process_is_named_after_its_part():
    before = Path("/proc/self/comm")
    if not before.exists():
        pytest.skip("only Linux names processes")
    name = before.read_text().strip()
    tie("minorloop-test", 0)
    assert before.read_text() == "minorloop-test\n"
    tie(name, 0)
