import random
import subprocess
import threading

import numpy as np
import pytest

import compiled
from board_process import OneChannelBoard as Board
from minorloop import Channel, InstrumentError, Preisach
from minorloop.export.c99 import source
from minorloop.lab.drivers import serial_board
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.drivers.bench_file import open_bench
from minorloop.lab.drivers.scripted import SILENCE, Script
from minorloop.lab.drivers.serial_line import parse, write


def ok(sequence, *words):
    return write(sequence, "OK", *words)


HELLO = (write(1, "HELLO"), ok(1, "minorloop", "2", "-1", "1", "30"))


def board(*lines):
    return Board(Script([HELLO, *lines]))


def test_late_and_damaged_answers_are_thrown_away():
    late, damaged = ok(1, "9.9"), ok(2, "7.7").replace("7.7", "7.8")
    one = board((write(2, "GET"), "\n".join([late, damaged, "", "\x00ÿ", ok(2, "1.5")])))
    assert one.read() == 1.5


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (SILENCE, "no answer"),
        ("garbage", "no valid answer to GET, last 'garbage'; check the cable and the baud rate"),
        ("\n".join(["garbage"] * 9), "no valid answer to GET"),
        (write(2, "ERR", "no", "sensor"), "refuses GET: no sensor"),
        (ok(2), "with 0 words"),
        (ok(2, "1", "2"), "with 2 words"),
        (ok(2, "abc"), "not a number"),
        (ok(2, "nan"), "with nan"),
        (ok(2, "inf"), "with inf"),
    ],
)
def test_answers_that_cannot_be_used(answer, message):
    with pytest.raises(InstrumentError, match=message):
        board((write(2, "GET"), answer)).read()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        *[(w, "another protocol") for w in (("minorloop", "1", "-1", "1"), ("other",), ())],
        *[(("minorloop", "2", "-1", "1", p), "patience") for p in ("0", "nan", "1e300")],
    ],
)
def test_another_firmware_is_refused(words, message):
    with pytest.raises(InstrumentError, match=message):
        Board(Script([(write(1, "HELLO"), ok(1, *words))]))


def test_a_board_that_went_safe_by_itself_is_not_read():
    with pytest.raises(InstrumentError, match=r"set to 0.25 and answers 0.5"):
        board((write(2, "SET", "0.25"), ok(2, "0.5"))).set(0.25)
    set_, get = write(2, "SET", "0.25"), write(3, "GET")
    one = board((set_, ok(2, "0.25")), (get, write(3, "ERR", "safe")))
    one.set(0.25)
    with pytest.raises(InstrumentError, match="went to its safe input by itself"):
        one.read()


@pytest.mark.parametrize(
    "answer",
    [SILENCE, ok(2)[:-4], write(2, "ERR", "unknown", "command"), ok(1), "\n".join("?" * 9)],
)
def test_a_board_that_does_not_say_that_it_is_safe_is_not_taken_for_safe(answer):
    with pytest.raises(InstrumentError):
        board((write(2, "SAFE"), answer)).safe()


def test_a_board_that_was_made_safe_is_not_kept_alive():
    one = board((write(2, "SET", "0.25"), ok(2, "0.25")), (write(3, "SAFE"), ok(3)))
    one.set(0.25)
    one.safe()
    one._asked = -np.inf
    assert one._stay() == pytest.approx(0.01)  # the script has nothing more to ask


class Listener(Script):
    """A board that says when it has been asked for a reading so many times."""

    def __init__(self, count):
        super().__init__([])
        self.count, self.enough = count, threading.Event()

    def ask(self, text):
        sequence, command = text.split()[:2]
        if command == "GET":
            self.count -= 1
            if self.count == 0:
                self.enough.set()
        words = {"HELLO": "minorloop 2 -1 1 30", "SET": "0.25", "GET": "1"}.get(command, "")
        return ok(int(sequence), *words.split())


def test_a_board_that_is_on_is_kept_alive_until_nobody_has_it():
    link, others = Listener(3), set(threading.enumerate())
    one = Board(link)
    one.keep_alive()
    one.set(0.25)
    assert link.enough.wait(20)
    one.safe()
    keepers = [thread for thread in threading.enumerate() if "_keep" in thread.name]
    keepers = [thread for thread in keepers if thread not in others]
    assert keepers
    del one
    for thread in keepers:
        thread.join(20)
        assert not thread.is_alive()


def test_a_board_of_a_bench_file_is_kept_alive(tmp_path, monkeypatch):
    link = Listener(4)  # two readings are asked for
    monkeypatch.setattr(serial_board, "opened", lambda how, folder: link)
    (tmp_path / "bench.json").write_text(
        '{"board": {"resource": "ASRL1::INSTR"}, "tick": 0.001, "output": {"name": "tip"},'
        ' "input": {"name": "voltage", "low": -1, "high": 1}}'
    )
    bench = open_bench(tmp_path / "bench.json")
    bench.exchange(0.25)
    assert link.enough.wait(20)
    bench.safe()


# The firmware that the C export sketches.


class Pipe:
    """The firmware as a process, on a line."""

    def __init__(self, program):
        self.name = "firmware"
        self.process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def send(self, text):
        self.process.stdin.write(f"{text}\r\n")
        self.process.stdin.flush()

    def ask(self, text):
        self.send(text)
        return self.read()

    def read(self):
        return self.process.stdout.readline().rstrip("\n")

    def close(self):
        out, _ = self.process.communicate(timeout=20)
        assert self.process.returncode == 0
        return out


@pytest.fixture(scope="module")
def model():
    rng = np.random.default_rng(0)
    levels = np.linspace(-1.23456789049, 1.23456789951, 9)
    return Preisach(levels, np.tril(rng.uniform(size=(8, 8))), 0.2)


@pytest.fixture(scope="module")
def program(model, tmp_path_factory):
    folder = source(model, firmware=True).write(tmp_path_factory.mktemp("firmware"))
    sources = ["minorloop.c", "minorloop_firmware.c"]
    return compiled.build(folder, sources, "-DMINORLOOP_HOST", *compiled.SANITIZED)


def test_the_firmware_speaks_the_protocol(program, model):
    link = Pipe(program)
    one = Board(link)
    limits = list(map(float, one.hello[2:4]))
    assert limits == [model.levels[0], model.levels[-1]]

    def asked(question, number):
        return one._numbers(1, question, repr(float(number)))[0]

    u = np.random.default_rng(1).uniform(-1, 1, 50)
    for sample, expected in zip(u, model.simulate(np.append(0.0, u))[1:], strict=True):
        one.set(sample)
        assert one.read() == pytest.approx(expected, rel=1e-6, abs=1e-6)
    for sample, expected in zip(u, model.simulate(u), strict=True):
        assert asked("STEP", sample) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    target = 0.3 * sum(model.range)
    assert asked("STEP", asked("AIM", target)) == pytest.approx(target, rel=1e-6, abs=1e-6)
    with pytest.raises(InstrumentError, match="beyond the limits"):
        one.set(1.5)
    one.safe()
    assert one.read() == pytest.approx(model.simulate([*[0.0], *u, 0.0])[-1], abs=1e-6)
    for limit in limits:
        one.set(limit)
    link.close()


@pytest.fixture(scope="module")
def clocked(model, tmp_path_factory):
    code, folder = source(model, firmware=True), tmp_path_factory.mktemp("clocked")
    return compiled.board(code, folder, "-DCLOCK", *compiled.SANITIZED)


def test_a_board_that_heard_nothing_says_that_its_input_is_lost(clocked):
    link = Pipe(clocked)
    assert parse(link.ask(write(1, "GET")), 1) == (False, ["safe"])  # it may have lost its power
    one = Board(link)
    assert one.patience == 1.0
    link.send("@")
    one.set(0.5)  # nothing was on, so nothing was lost
    assert one.read() == 0.5
    link.send("@")
    for act in (one.read, lambda: one.set(0.5), one.read):
        with pytest.raises(InstrumentError, match="went to its safe input by itself"):
            act()
    one.safe()
    assert one.read() == 0.0
    one.set(0.25)
    assert one.read() == 0.25
    link.close()


def test_a_hold_longer_than_the_board_is_patient_is_measured_with_its_input_on(clocked):
    link = Pipe(clocked)
    one = Board(link)
    one.keep_alive()
    voltage = Channel("voltage", "V", -1.0, 1.0)
    record = Bench(one, one, voltage, Channel("tip", "mm")).apply(0.5, 1.5, 1.5)
    assert list(record.y) == [0.5]
    one.safe()
    link.close()


def test_the_firmware_compiles_in_single_precision(model, tmp_path):
    source(model, firmware=True, float32=True, inverse=False, name="wing").write(tmp_path)
    for option in ("-DWING_HOST", "-DNONE"):
        compiled.build(tmp_path, ["wing_firmware.c"], option, "-c", program="one.o")


def test_thousands_of_damaged_lines_do_nothing_to_the_firmware(program):
    rng = random.Random(1)
    letters = "".join(map(chr, range(32, 127)))
    lines = []
    for k in range(30_000):
        sound = write(k % 65_536, "SET", f"{rng.uniform(-1, 1):.9g}")
        line = list(sound)
        for _ in range(rng.randint(1, 4)):
            line[rng.randrange(len(line))] = rng.choice(letters)
        damaged = "".join(line) * rng.choice([1, 1, 1, 9])
        if damaged != sound:
            lines.append(damaged)
    text = "\n".join([write(5, "HELLO"), *lines, write(5, "GET")]) + "\n"
    done = subprocess.run(
        [program], input=text.encode(), capture_output=True, timeout=120, check=True
    )
    _, answer = done.stdout.decode().splitlines()
    untouched = Pipe(program)
    untouched.ask(write(5, "HELLO"))
    assert answer == untouched.ask(write(5, "GET"))
    untouched.close()
