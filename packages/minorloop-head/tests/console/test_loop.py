import json
import socket
import threading

import msgspec
import pytest

from console_rig import STILL, control, view
from minorloop_head.console import loop, messages
from minorloop_head.console.camera_protocol import CameraReport, CameraRequest
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.plant import open_plant
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import ProcessHandle
from minorloop_head.console.watchdog import WatchedPlant
from offspring import PRELOADED, forking

PRELOADED.append("minorloop_head.console.loop")
NAMES = ("loop", "plant", "camera", "server")


class Running:
    """A loop in a process of its own, with a plant, and this end of its pipes.

    Without a plant, it has to identify its wires.
    """

    def __init__(self, folder, *, plant=True, **settings):
        self.context = forking()
        self.control, theirs = socket.socketpair()
        beats = self.context.RawArray("d", len(NAMES))
        handle = ProcessHandle("loop", NAMES, theirs, beats)
        wanted = LoopSettings(folder=str(folder), timeout=5.0, **settings)
        given = (handle, wanted, None, control() if plant else None)
        self.process = self.context.Process(target=loop.run, args=given)
        self.process.start()
        theirs.close()
        self.pipe, self.camera = self.give("server"), self.give("camera")
        self.seq = 0
        self.beats, self.over = beats, threading.Event()
        if plant:
            self.open()

    def open(self, why=""):
        """Replace the plant by another one, in a thread."""
        self.over.set()
        self.over, self.watched = threading.Event(), WatchedPlant(open_plant("twin:pipe"), 5.0, why)
        given = (
            NewestPipe(self.give("plant")),
            ProcessHandle("plant", NAMES, self.control, self.beats),
        )
        threading.Thread(target=self.watched.serve, args=(*given, self.over)).start()

    def give(self, name):
        """This end of a new pipe, of which the loop gets the other."""
        ours, theirs = self.context.Pipe()
        socket.send_fds(self.control, [bytes([NAMES.index(name)])], [theirs.fileno()])
        theirs.close()
        return ours

    def introduce(self):
        """Introduce the camera."""
        self.camera.send_bytes(msgspec.json.encode(view().to_dict()))
        return self

    def answer(self):
        """The newest request, which is answered."""
        request = msgspec.msgpack.decode(self.camera.recv_bytes(), type=CameraRequest)
        self.camera.send_bytes(msgspec.msgpack.encode(CameraReport(number=request.number)))
        return request

    def order(self, kind, **content):
        self.seq += 1
        order = kind(seq=self.seq, t=0.0, grant=1, **content)
        self.pipe.send_bytes(msgspec.msgpack.encode(order))

    def until(self, kind, holds=lambda message: True):
        """The next message of a kind that meets a condition."""
        while self.pipe.poll(120):
            content = self.pipe.recv_bytes()
            if content[:1] == b"{":
                message = json.loads(content)
                if message["type"] == kind and holds(message):
                    return message
        raise AssertionError(f"nothing of kind {kind} came")

    def end(self):
        self.over.set()
        self.control.close()
        self.process.join(60)
        self.process.kill()


@pytest.fixture
def running(tmp_path):
    found = Running(tmp_path / "sessions").introduce()
    yield found
    found.end()


def test_every_server_is_sent_why_nothing_can_be_steered(tmp_path):
    running = Running(tmp_path, plant=False, address="twin:nothing")
    assert "nothing to steer" in running.until("failed")["text"]
    running.pipe = running.give("server")
    assert "nothing to steer" in running.until("failed")["text"]
    running.end()
    assert running.process.exitcode == 0


def test_a_camera_that_hangs_delays_no_tick_and_loses_no_command(running):
    running.until("hello")
    running.order(messages.Pick, u=3.0, v=4.0)  # nobody reads the requests to the camera
    running.order(messages.Find)
    first = running.until("state")
    later = running.until("state", lambda message: message["seq"] >= first["seq"] + 60)
    assert later["target"] is None
    commands = []
    while len(commands) < 2:
        commands += msgspec.msgpack.decode(running.camera.recv_bytes(), type=CameraRequest).commands
    assert commands == [("pick", [3.0, 4.0]), ("find", [])]


def test_a_camera_that_does_not_open_is_reported(tmp_path):
    running = Running(tmp_path)
    running.camera.send_bytes(msgspec.json.encode({"failed": "opencv is missing"}))
    assert "opencv is missing" in running.until("failed")["text"]
    running.end()


def test_a_restarted_plant_stays_cold_until_a_mode_is_requested(running):
    running.until("state")
    running.order(messages.Drive, **STILL)
    running.order(messages.SetMode, mode="HEAD")
    running.until("state", lambda message: min(message["current"]) > 0.1)
    running.open("its process was restarted")
    rests = running.until("state", lambda message: message["safe_at"] > 0)
    assert rests["safe_at"] == running.watched.safe_at
    assert "restarted, and the head was made safe" in rests["reason"]
    for _ in range(25):
        running.answer()
        message = running.until("state")
    assert (message["mode"], message["current"], message["trouble"]) == ("HOLD", [0.0, 0.0], "")
    assert message["angle"][0] < -25
    running.order(messages.Drive, **STILL)
    running.order(messages.SetMode, mode="HEAD")
    while running.until("state")["angle"][0] < -5:
        running.answer()
