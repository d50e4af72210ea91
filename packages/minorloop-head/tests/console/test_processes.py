"""The real control loop and plant under a supervisor; camera and server are stand-ins."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time

import msgspec
import pytest

from console_rig import SMALL, STILL, control
from minorloop_head.console import camera_process, loop, messages, supervisor, watchdog
from minorloop_head.console.camera_protocol import CameraReport
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.processes import PIPES
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import Part, Supervisor
from offspring import PRELOADED, forking

PRELOADED.extend(f"minorloop_head.console.{name}" for name in ("camera_process", "watchdog"))


class BlankCamera:
    """A camera without pictures that answers at once."""

    image, jobs, shown = None, (), False

    def tick(self, request):
        return CameraReport(number=request.number)


def see(handle):
    server, asked = NewestPipe(), NewestPipe()
    over = handle.begin(server=server, loop=asked, plant=NewestPipe())
    pipe = camera_process._introduced(SMALL.to_dict(), asked, over)
    camera_process._serve(BlankCamera(), pipe, server, handle, over)


def relay(handle, test):
    """Pass messages between the loop and the test."""
    asked = NewestPipe()
    over = handle.begin(loop=asked, camera=NewestPipe())
    pipe = None
    while not over.is_set():
        handle.beat()
        pipe = asked.next(pipe, 0.0) or pipe
        for source in multiprocessing.connection.wait([test, *([pipe] if pipe else [])], 0.05):
            try:
                content = source.recv_bytes()
            except (EOFError, OSError):
                pipe = asked.next(pipe, 0.05)
                continue
            asked.send(content) if source is test else test.send_bytes(content)


class Console:
    """All processes, and a pilot."""

    def __init__(self, folder):
        self.pipe, theirs = forking().Pipe()
        settings = LoopSettings(folder=str(folder), timeout=5.0)
        # On a loaded machine they may be slow: what hangs is not looked for here.
        patience = 20.0
        self.supervisor = Supervisor(
            [
                Part(name="plant", target=watchdog.run, args=(settings,), patience=patience),
                Part(
                    name="loop",
                    target=loop.run,
                    args=(settings, None, control()),
                    patience=patience,
                ),
                Part(name="camera", target=see),
                Part(name="server", target=relay, args=(theirs,)),
            ],
            PIPES,
        )
        self.supervisor.start()
        self.seq = 0

    def order(self, kind, **content):
        self.seq += 1
        order = kind(seq=self.seq, t=0.0, grant=1, **content)
        self.pipe.send_bytes(msgspec.msgpack.encode(order))

    def until(self, holds):
        """The next state that meets a condition; the supervisor runs meanwhile."""
        deadline = time.monotonic() + 120
        while time.monotonic() < deadline:
            if not self.pipe.poll():
                self.supervisor.check()
                continue
            message = json.loads(self.pipe.recv_bytes())
            if message["type"] == "state" and holds(message):
                return message
        raise AssertionError("the condition was never met")

    def steer(self):
        """Press HEAD until it is on."""

        def steering(message):
            self.order(messages.Drive, **STILL)
            self.order(messages.SetMode, mode="HEAD")
            return message["mode"] == "HEAD"

        self.until(steering)

    def fault(self, name, how):
        began = time.monotonic()  # before it: the others may notice before this process continues
        os.kill(self.supervisor.pid(name), how)
        return began


@pytest.fixture
def console(tmp_path, monkeypatch):
    monkeypatch.setattr(supervisor, "_CONTEXT", forking())
    found = Console(tmp_path)
    yield found
    found.supervisor.end()


def test_the_head_is_safe_without_its_loop_and_the_pilot_can_continue(console):
    console.steer()
    began = console.fault("loop", signal.SIGKILL)
    first = console.until(lambda message: message["safe_at"] > began)
    assert first["mode"] == "HOLD"
    assert "loop ended, and the head was made safe" in first["reason"]
    console.steer()


def test_the_supervisor_imports_nothing_that_only_its_processes_need():
    code = "import sys, minorloop_head.console.processes as p; print({*sys.argv} & {*sys.modules})"
    heavy = ["numba", "scipy", "starlette", "uvicorn"]
    found = subprocess.run([sys.executable, "-c", code, *heavy], capture_output=True, check=True)
    assert found.stdout.strip() == b"set()"
