import json
import multiprocessing

import msgspec
import pytest

from minorloop.teleop import loop, messages
from minorloop.teleop.recording import PICTURE, TEXT, entries
from minorloop.teleop.sight import Look
from seats import view

AHEAD = {"pose": (0.0, 0.0, 0.0, 1.0), "age": 0.0, "stick": (0.0, 0.0), "clutch": False}


class Running:
    """A loop in a process of its own, and this end of its pipe."""

    def __init__(self, folder, **settings):
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.eyes, looking = context.Pipe()
        wanted = loop.LoopSettings(folder=str(folder), timeout=5.0, **settings)
        self.process = context.Process(target=loop.run, args=(theirs, looking, wanted), daemon=True)
        self.process.start()
        theirs.close()
        looking.close()
        self.eyes.send_bytes(msgspec.json.encode(view().told()))
        self.seq = 0

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


@pytest.fixture
def running(tmp_path):
    found = Running(tmp_path / "sessions")
    yield found
    found.pipe.close()
    found.process.join(20)
    found.process.kill()


def test_what_is_recorded_survives_the_end_of_the_server(running, tmp_path):
    assert running.until("hello")["planes"]
    running.order(messages.Drive, **AHEAD)
    running.order(messages.Mode, mode="HEAD")
    running.order(messages.Record, on=True)
    name = running.until("recording")["name"]
    while not msgspec.msgpack.decode(running.eyes.recv_bytes(), type=Look).keep:
        pass
    picture = messages.picture(messages.IMAGE, 1, 2.0, (0.0, 0.0, 0.0, 0.0), b"jpeg")
    running.eyes.send_bytes(loop.PICTURED + picture)
    last = running.until("state", lambda told: told["mode"] == "HEAD")
    for _ in range(10):
        last = running.until("state")
    running.pipe.close()  # as when the server is killed
    running.process.join(60)
    assert running.process.exitcode == 0
    path = tmp_path / "sessions" / f"{name}.session"
    told = [json.loads(content) for kind, _, content in entries(path) if kind == TEXT]
    states = [each for each in told if each["type"] == "state"]
    assert told[0]["type"] == "hello"
    assert last["seq"] in [state["seq"] for state in states]
    assert [content for kind, _, content in entries(path) if kind == PICTURE] == [picture]
    numbers = [state["seq"] for state in states]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_nobody_steers_at_first_and_the_loop_ends_when_it_is_told(running):
    first = running.until("state")
    later = running.until("state", lambda told: told["seq"] > first["seq"] + 10)
    assert later["mode"] == "HOLD"
    running.pipe.send_bytes(loop.END)
    running.process.join(60)
    assert running.process.exitcode == 0


def test_what_cannot_be_steered_is_said(tmp_path):
    running = Running(tmp_path, address="twin:nothing")
    assert "nothing to steer" in running.until("failed")["text"]
    running.process.join(60)
    assert running.process.exitcode == 0


def test_the_outbox_keeps_events_and_of_states_the_newest():
    box = loop._Outbox()
    for k in range(5):
        box.event(b"%d" % k)
        box.newest(b"state %d" % k)
    assert box.wait() == ([b"0", b"1", b"2", b"3", b"4"], b"state 4")


def test_eyes_that_stand_still_cost_the_loop_no_tick_and_lose_no_wish(running):
    running.until("hello")
    running.order(messages.Pick, u=3.0, v=4.0)  # nobody reads what is told to the eyes
    running.order(messages.Find)
    first = running.until("state")
    later = running.until("state", lambda told: told["seq"] >= first["seq"] + 60)
    assert later["target"] is None
    wishes = []
    while len(wishes) < 2:
        wishes += msgspec.msgpack.decode(running.eyes.recv_bytes(), type=Look).wishes
    assert wishes == [("pick", [3.0, 4.0]), ("find", [])]


def test_eyes_that_do_not_open_are_told_of(tmp_path):
    context = multiprocessing.get_context("spawn")
    (pipe, theirs), (eyes, looking) = context.Pipe(), context.Pipe()
    eyes.close()
    loop.run(theirs, looking, loop.LoopSettings(folder=str(tmp_path)))
    assert "eyes did not start" in json.loads(pipe.recv_bytes())["text"]


def test_a_recording_tells_its_size_and_ends_when_its_pilot_has_left(running):
    running.until("hello")
    running.order(messages.Record, on=True)
    told = running.until("recording", lambda told: told["name"] and told["seconds"] > 0.5)
    assert told["size"] > 1000
    running.order(messages.Release)
    assert running.until("recording", lambda told: told["name"] is None)
