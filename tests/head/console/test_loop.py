import json
import multiprocessing
import socket
import threading

import msgspec
import pytest

from minorloop.head.console import loop, messages
from minorloop.head.console.camera_protocol import PICTURED, CameraReport, CameraRequest
from minorloop.head.console.channel import NewestPipe
from minorloop.head.console.plant import open_plant
from minorloop.head.console.recording import PICTURE, TEXT, entries
from minorloop.head.console.settings import LoopSettings
from minorloop.head.console.supervisor import ProcessHandle
from minorloop.head.console.watchdog import WatchedPlant
from seats import view

NAMES = ("loop", "plant", "camera", "server")
AHEAD = {"pose": (0.0, 0.0, 0.0, 1.0), "age": 0.0, "stick": (0.0, 0.0), "clutch": False}


class Running:
    """A loop in a process of its own, with a plant, and this end of its pipes."""

    def __init__(self, folder, *, plant=True, **settings):
        self.context = multiprocessing.get_context("spawn")
        self.control, theirs = socket.socketpair()
        beats = self.context.RawArray("d", len(NAMES))
        post = ProcessHandle("loop", NAMES, theirs, beats)
        wanted = LoopSettings(folder=str(folder), timeout=5.0, **settings)
        self.process = self.context.Process(target=loop.run, args=(post, wanted))
        self.process.start()
        theirs.close()
        self.pipe, self.eyes = self.give("server"), self.give("camera")
        self.seq = 0
        self.beats, self.over = beats, threading.Event()
        if plant:
            self.open()

    def open(self, why=""):
        """Another plant, in a thread; the one before goes away."""
        self.over.set()
        self.over, self.guarded = threading.Event(), WatchedPlant(open_plant("twin:pipe"), 5.0, why)
        given = (
            NewestPipe(self.give("plant")),
            ProcessHandle("plant", NAMES, self.control, self.beats),
        )
        threading.Thread(target=self.guarded.serve, args=(*given, self.over)).start()

    def give(self, name):
        """This end of a new pipe, of which the loop gets the other."""
        ours, theirs = self.context.Pipe()
        socket.send_fds(self.control, [bytes([NAMES.index(name)])], [theirs.fileno()])
        theirs.close()
        return ours

    def see(self):
        """Introduce the eyes."""
        self.eyes.send_bytes(msgspec.json.encode(view().told()))
        return self

    def pictured(self):
        """The newest look; the eyes say that they have seen it."""
        look = msgspec.msgpack.decode(self.eyes.recv_bytes(), type=CameraRequest)
        self.eyes.send_bytes(msgspec.msgpack.encode(CameraReport(number=look.number)))
        return look

    def order(self, kind, **content):
        self.seq += 1
        order = kind(seq=self.seq, t=0.0, grant=1, **content)
        self.pipe.send_bytes(msgspec.msgpack.encode(order))

    def until(self, kind, holds=lambda told: True):
        """The next text of a kind for which something holds."""
        while self.pipe.poll(120):
            content = self.pipe.recv_bytes()
            if content[:1] == b"{":
                told = json.loads(content)
                if told["type"] == kind and holds(told):
                    return told
        raise AssertionError(f"nothing of kind {kind} came")

    def end(self):
        self.over.set()
        self.control.close()
        self.process.join(60)
        self.process.kill()


@pytest.fixture
def running(tmp_path):
    found = Running(tmp_path / "sessions").see()
    yield found
    found.end()


def test_a_recording_ends_with_the_server_and_the_loop_goes_on_with_another(running, tmp_path):
    assert running.until("hello")["planes"]
    for _ in range(3):
        running.pictured()
    running.order(messages.Drive, **AHEAD)
    running.order(messages.Mode, mode="HEAD")
    running.order(messages.RecordSession, on=True)
    name = running.until("recording", lambda told: told["name"])["name"]
    while not running.pictured().keep:
        pass
    picture = messages.picture(messages.IMAGE, 1, 2.0, (0.0, 0.0, 0.0, 0.0), b"jpeg")
    running.eyes.send_bytes(PICTURED + picture)
    last = running.until("state", lambda told: told["mode"] == "HEAD")
    for _ in range(10):
        running.pictured()
        last = running.until("state")
    running.pipe.close()  # as when the server is killed
    running.pipe = running.give("server")
    assert running.until("hello")["planes"]
    assert running.until("recording")["name"] is None
    first = running.until("state")
    after = running.until("state", lambda told: told["seq"] > first["seq"])
    assert (after["mode"], after["safe_at"]) == ("HOLD", 0.0)
    path = tmp_path / "sessions" / f"{name}.session"
    told = [json.loads(content) for kind, _, content in entries(path) if kind == TEXT]
    states = [each for each in told if each["type"] == "state"]
    assert told[0]["type"] == "hello"
    assert last["seq"] in [state["seq"] for state in states]
    assert [state["mode"] for state in states[-2:]] == ["HEAD", "HOLD"]
    assert [content for kind, _, content in entries(path) if kind == PICTURE] == [picture]
    numbers = [state["seq"] for state in states]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_nobody_steers_at_first_and_the_loop_ends_with_its_supervisor(running):
    first = running.until("state")
    later = running.until("state", lambda told: told["seq"] > first["seq"] + 10)
    assert later["mode"] == "HOLD"
    running.control.close()
    running.process.join(60)
    assert running.process.exitcode == 0


def test_what_cannot_be_steered_is_said_to_every_server(tmp_path):
    running = Running(tmp_path, plant=False, address="twin:nothing")
    assert "nothing to steer" in running.until("failed")["text"]
    running.pipe = running.give("server")
    assert "nothing to steer" in running.until("failed")["text"]
    running.end()
    assert running.process.exitcode == 0


def test_eyes_that_stand_still_cost_the_loop_no_tick_and_lose_no_wish(running):
    running.until("hello")
    running.order(messages.Pick, u=3.0, v=4.0)  # nobody reads what is told to the eyes
    running.order(messages.Find)
    first = running.until("state")
    later = running.until("state", lambda told: told["seq"] >= first["seq"] + 60)
    assert later["target"] is None
    wishes = []
    while len(wishes) < 2:
        wishes += msgspec.msgpack.decode(running.eyes.recv_bytes(), type=CameraRequest).wishes
    assert wishes == [("pick", [3.0, 4.0]), ("find", [])]


def test_eyes_that_do_not_open_are_told_of(tmp_path):
    running = Running(tmp_path)
    running.eyes.send_bytes(msgspec.json.encode({"failed": "opencv is missing"}))
    assert "opencv is missing" in running.until("failed")["text"]
    running.end()


def test_a_plant_that_was_started_anew_stays_cold_until_a_mode_is_asked_for(running):
    running.until("state", lambda told: min(told["current"]) > 0.1)
    running.open("its process was started anew")
    rests = running.until("state", lambda told: told["safe_at"] > 0)
    assert rests["safe_at"] == running.guarded.safe_at
    assert "started anew, and the head was made safe" in rests["reason"]
    for _ in range(25):
        running.pictured()
        told = running.until("state")
    assert (told["mode"], told["current"], told["trouble"]) == ("HOLD", [0.0, 0.0], "")
    assert told["angle"][0] < -25
    running.order(messages.Drive, **AHEAD)
    running.order(messages.Mode, mode="HEAD")
    while running.until("state")["angle"][0] < -5:
        running.pictured()


def test_a_recording_tells_its_size_and_ends_when_its_pilot_has_left(running):
    running.until("hello")
    running.order(messages.RecordSession, on=True)
    told = running.until("recording", lambda told: told["name"] and told["seconds"] > 0.5)
    assert told["size"] > 1000
    running.order(messages.Release)
    assert running.until("recording", lambda told: told["name"] is None)


def test_the_next_pilots_recording_begins_where_the_last_ones_ends(running):
    running.until("hello")
    running.order(messages.RecordSession, on=True)
    first = running.until("recording", lambda told: told["name"])["name"]
    running.order(messages.Release)
    running.pipe.send_bytes(msgspec.msgpack.encode(messages.Taken()))
    running.order(messages.RecordSession, on=True)
    running.until("recording", lambda told: told["name"] not in (None, first))
