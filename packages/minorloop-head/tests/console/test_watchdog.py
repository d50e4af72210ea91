import multiprocessing
import socket
import threading
from multiprocessing import Pipe
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from minorloop.errors import InstrumentError, LimitError, MissingExtraError, SafetyError
from minorloop_head.console import watchdog
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import ProcessHandle
from minorloop_head.console.watchdog import (
    Answer,
    Command,
    LineCommand,
    RemotePlant,
    RemoteWires,
    WatchedPlant,
    carry_out,
)

HELD = np.array([0.3, 0.2, 1.0, 0.0])


class Wires:
    """A plant that keeps a list of its commands."""

    tick, time = 0.04, None

    def __init__(self):
        self.done = []

    def exchange(self, u):
        if u[0] > 1:
            raise LimitError("0.5 A is the most")
        self.done.append(tuple(u))
        return u + 1

    def stance(self):
        return (1.0, 2.0)

    def safe(self):
        self.done.append("safe")


class Bench:
    """A plant behind its watchdog, and the loop's side of it."""

    def __init__(self, why="", patience=0.05):
        self.wires, self.channel, self.over = Wires(), NewestPipe(), threading.Event()
        self.watched = WatchedPlant(self.wires, patience, why)
        self.theirs = NewestPipe()
        beats = multiprocessing.get_context("spawn").RawArray("d", 1)
        self._sockets = socket.socketpair()
        self.handle = ProcessHandle("plant", ("plant",), self._sockets[0], beats)
        given = self.channel, self.handle, self.over
        self._thread = threading.Thread(target=self.watched.serve, args=given)
        self._thread.start()

    def loop(self):
        """Another loop."""
        ours, theirs = Pipe()
        self.channel.renew(theirs)
        self.plant = RemotePlant(NewestPipe(ours), 60.0)
        assert self.plant.meet(60.0)
        return ours

    def until_safe(self):
        deadline = threading.Event()
        for _ in range(6000):
            if self.wires.done[-1] == "safe":
                return
            deadline.wait(0.01)
        raise AssertionError("it was never made safe")

    def end(self):
        self.over.set()
        self._thread.join()
        for each in self._sockets:
            each.close()


@pytest.fixture
def bench():
    found = Bench()
    yield found
    found.end()


def test_commands_go_to_the_plant_and_readings_come_back(bench):
    bench.loop()
    np.testing.assert_array_equal(bench.plant.exchange(HELD), HELD + 1)
    assert bench.wires.done == ["safe", tuple(HELD)]
    assert (bench.plant.tick, bench.plant.stance()) == (0.04, (1.0, 2.0))
    assert bench.handle.beats[0] > 0
    assert bench.plant.time is None
    bench.wires.time = 0.4
    bench.plant.exchange(HELD)
    assert bench.plant.time == 0.4


def test_silence_makes_it_safe_until_the_loop_has_taken_notice(bench):
    bench.loop()
    bench.plant.exchange(HELD)
    bench.until_safe()
    assert not bench.plant.made_safe  # it has not heard of it yet
    bench.plant.exchange(HELD)
    assert bench.wires.done[-1] == "safe"
    assert bench.plant.made_safe
    assert "no command" in bench.plant.answer.why
    bench.plant.accept()
    bench.plant.exchange(HELD)
    assert tuple(HELD) in bench.wires.done[3:]


def test_the_end_of_a_loop_makes_it_safe_at_once_and_the_next_loop_knows():
    bench = Bench(patience=600.0)
    pipe = bench.loop()
    bench.plant.exchange(HELD)
    pipe.close()
    bench.until_safe()
    bench.loop()
    assert bench.plant.made_safe
    assert "ended" in bench.plant.answer.why
    bench.plant.exchange(HELD)
    assert bench.wires.done == ["safe", tuple(HELD), "safe"]
    bench.plant.safe()
    bench.end()


def test_a_command_that_cannot_be_carried_out_makes_it_safe(bench):
    bench.loop()
    bench.plant.exchange(HELD)
    assert np.isnan(bench.plant.exchange(10 * HELD)).all()
    assert "0.5 A is the most" in bench.plant.answer.why
    assert "safe" in bench.wires.done[2:]


def test_a_plant_that_does_not_answer_costs_one_wait_and_reads_nothing():
    ours, theirs = Pipe()
    plant = RemotePlant(NewestPipe(ours), 0.01)
    for _ in range(100):
        assert np.isnan(plant.exchange(HELD)).all()
        assert not plant.responds
    assert not theirs.poll()  # nothing was sent before its first word
    theirs.close()
    assert np.isnan(plant.exchange(HELD)).all()


class Dim(Wires):
    """A plant with lights that may not confirm that it is safe."""

    def __init__(self):
        super().__init__()
        self.lost = False

    def safe(self):
        if self.lost:
            raise SafetyError("the source may still be on, switch it off by hand: no answer")
        super().safe()

    def light(self, lights):
        self.done.append(("lights", *lights))

    def flood(self, on):
        raise InstrumentError("no pump")


def test_a_late_answer_costs_a_reading_and_is_no_silence(monkeypatch):
    now, (ours, theirs) = iter([0.0, 0.03, 0.06, 0.07, 0.08, 0.2]), Pipe()
    plant = RemotePlant(NewestPipe(ours), 0.1, 0.0)
    theirs.send_bytes(msgspec.msgpack.encode(Answer(0.0, "", 0.04, [1.0] * 4, [])))
    assert plant.meet(10.0)
    monkeypatch.setattr(watchdog, "time", SimpleNamespace(monotonic=lambda: next(now)))
    for _ in range(2):  # sent at 0 s, not answered at 0.03 and 0.06 s
        assert np.isnan(plant.exchange(np.zeros(4))).all()
        assert plant.responds
    theirs.recv_bytes()
    assert not theirs.poll()  # one command
    theirs.send_bytes(msgspec.msgpack.encode(Answer(0.0, "", 0.04, [2.0] * 4, [])))
    assert plant.exchange(np.zeros(4)).tolist() == [2.0] * 4
    plant.exchange(np.zeros(4))  # sent at 0.08 s, not answered at 0.2 s
    assert not plant.responds


def test_a_plant_that_does_not_confirm_is_reported_and_made_safe_as_soon_as_it_does():
    wires = Dim()
    watched = WatchedPlant(wires, 60.0)
    wires.lost = True
    watched._carry_out(Command(0.0, [9.0, 0.0, 0.0, 0.0]))
    assert not watched._answer().safe
    assert "switch it off by hand" in watched.why
    ours, theirs = Pipe()
    for _ in range(2):
        ours.send_bytes(msgspec.msgpack.encode(Command(watched.safe_at, HELD.tolist())))
        watched._answer_next(theirs)
        assert wires.done == ["safe"]  # nothing is applied meanwhile
        assert not msgspec.msgpack.decode(ours.recv_bytes())[-1]
    wires.lost = False
    ours.send_bytes(msgspec.msgpack.encode(Command(watched.safe_at, HELD.tolist())))
    watched._answer_next(theirs)
    assert wires.done == ["safe", "safe"]
    assert watched._answer().safe
    assert watched.why == "a device of the head was lost, and is back"


def test_lights_are_switched_between_two_commands_of_the_loop():
    wires, (loop, theirs), (camera, lines) = Dim(), Pipe(), Pipe()
    watched = WatchedPlant(wires, 60.0)
    watched._lines = NewestPipe(lines)
    camera.send_bytes(msgspec.msgpack.encode(LineCommand(number=1, lights=[True, False])))
    watched._switch(lines)
    assert camera.recv_bytes() == b"1 "
    camera.send_bytes(msgspec.msgpack.encode(LineCommand(number=2, pump=True)))
    watched._switch(lines)
    assert camera.recv_bytes() == b"2 no pump"
    camera.close()
    watched._switch(lines)
    assert lines.closed
    loop.send_bytes(msgspec.msgpack.encode(Command(0.0, HELD.tolist())))
    watched._answer_next(theirs)
    assert wires.done == ["safe", ("lights", True, False), tuple(HELD)]


def test_a_plant_that_is_missing_is_opened_as_soon_as_it_is_there_and_the_loop_knows(monkeypatch):
    ours, theirs = Pipe()
    problems = [InstrumentError("the port cannot be opened"), MissingExtraError("pyvisa", "x")]
    done = []

    def open_plant(address, specimen, seed):
        done.append("opened")
        if problems:
            raise problems.pop(0)
        return Wires()

    monkeypatch.setattr(watchdog, "open_plant", open_plant)
    monkeypatch.setattr(watchdog, "_AGAIN", 0.0)
    handle = SimpleNamespace(beat=lambda: done.append("beat"))
    settings = LoopSettings(address="bench:head.toml", interval=0.02)
    plant = watchdog._opened(settings, NewestPipe(theirs), handle, threading.Event())
    assert plant.done == [(0.0,) * 4]
    assert done == ["opened", "beat"] * 2 + ["opened"]  # none before: it may take long to import
    remote = RemotePlant(NewestPipe(ours), 60.0)
    assert remote.meet(60.0)
    assert (remote.tick, remote.made_safe, remote.answer.safe) == (0.02, True, False)
    assert remote.answer.why == "the port cannot be opened"
    over = threading.Event()
    over.set()
    assert watchdog._opened(settings, NewestPipe(), handle, over) is None


def test_lights_and_pump_are_switched_in_the_other_process_before_the_call_returns():
    ours, theirs = Pipe()
    plant, wires = Dim(), RemoteWires(NewestPipe(ours), 60.0)
    both = threading.Thread(target=lambda: [carry_out(plant, theirs) for _ in range(2)])
    both.start()
    wires.light((True, False, True))
    assert plant.done == [("lights", True, False, True)]
    with pytest.raises(InstrumentError, match="were not switched: no pump"):
        wires.flood(True)
    both.join()


def test_a_plant_that_is_silent_or_gone_is_an_error_and_a_late_answer_is_forgotten():
    ours, theirs = Pipe()
    plant, wires = Dim(), RemoteWires(NewestPipe(ours), 0.0)

    def is_silent(wires):
        with pytest.raises(InstrumentError, match="the plant does not answer"):
            wires.light((True,))

    is_silent(wires)
    carry_out(plant, theirs)
    is_silent(wires)
    theirs.close()
    is_silent(wires)
    is_silent(RemoteWires(NewestPipe(), 0.0))
    assert plant.done == [("lights", True)]


def test_an_answer_that_comes_during_the_next_command_is_not_taken_for_its_answer():
    ours, theirs = Pipe()
    wires = RemoteWires(NewestPipe(ours), 0.0)
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        wires.light((True,))

    def answer_both():
        for _ in range(2):
            theirs.recv_bytes()
        theirs.send_bytes(b"1 the lamp is stuck")
        theirs.send_bytes(b"2 ")

    plant = threading.Thread(target=answer_both)
    plant.start()
    wires._patience = 60.0
    wires.light((False,))
    plant.join()
