"""The firmware of a board: compiled for this machine, and on an emulated Cortex-M4F."""

import contextlib
import ctypes
import random
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import compiled
from benchmarks import _board, _cortex
from console_rig import Pilot
from minorloop import Channel, InstrumentError, ParameterError, Preisach, RelayModel
from minorloop.lab.drivers import link
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
from minorloop.lab.drivers.serial_board import SerialBoard
from minorloop.lab.drivers.serial_line import parse, write
from minorloop_head.board import HEAD_LINES, BoardAxis, board_source
from minorloop_head.console.plant import open_plant
from minorloop_head.console.watchdog import Command, WatchedPlant

EXAMPLES = Path(__file__).parents[3] / "examples"
PARTS = "control.c", "protocol.c", "numbers.c", "axis0.c", "axis1.c"
PORTS = """
#include "control.h"
#include "hal.h"
#include "protocol.h"
#include <string.h>
double inputs[8], outputs[8];
int lines[8], readable = 1;
char said[300];
uint32_t hal_milliseconds(void) { return 0u; }
int32_t hal_receive(void) { return -1; }
void hal_send(const char *text) { (void)strcpy(said, text); }
void hal_set(uint32_t input, double value) { inputs[input] = value; }
int hal_get(uint32_t output, double *value) { *value = outputs[output]; return readable; }
void hal_switch(uint32_t line, int on) { lines[line] = on; }
void hear(const char *text);
void pass(uint32_t milliseconds);
void hear(const char *text)
{
    while (*text != '\\0') { protocol_hear(*text++); }
}
void pass(uint32_t milliseconds)
{
    while (milliseconds-- > 0u) { protocol_millisecond(); control_millisecond(); }
}
"""


class Firmware:
    """A firmware without its ports, compiled for this machine: a link of the driver."""

    name = "firmware"

    def __init__(self, folder, axes, **options):
        board_source(axes, **options).write(folder)
        (folder / "ports.c").write_text(PORTS)
        options = "-O2", "-shared", "-fPIC", "-Wno-missing-declarations"
        built = compiled.build(folder, [*PARTS, "ports.c"], *options, program="board.so")
        self.library = ctypes.CDLL(str(built))
        self.values = {
            name: (kind * 8).in_dll(self.library, name)
            for name, kind in (
                ("inputs", ctypes.c_double),
                ("outputs", ctypes.c_double),
                ("lines", ctypes.c_int),
            )
        }
        self.said = (ctypes.c_char * 300).in_dll(self.library, "said")

    def ask(self, text):
        self.said.value = b""
        self.library.hear(f"{text}\n".encode("latin-1"))
        return self.said.value.decode().strip()

    def put(self, *words):
        """Ask a question; return whether the answer is OK, and its words."""
        return parse(self.ask(write(7, *words)), 7)

    def numbers(self, *words):
        ok, answer = self.put(*words)
        assert ok, answer
        return [float(word) for word in answer]

    def let(self, milliseconds):
        getattr(self.library, "pass")(milliseconds)

    @property
    def inputs(self):
        return list(self.values["inputs"][:2])

    @property
    def lines(self):
        return list(self.values["lines"][:4])


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A head's firmware; every test begins it again."""
    options = {"coupling": _board.COUPLING, "lines": HEAD_LINES, "patience": 0.5}
    return Firmware(tmp_path_factory.mktemp("board"), _board.heated_axes(), **options)


def begun(firmware):
    """Return a firmware as after power-up."""
    firmware.library.control_begin()
    firmware.library.protocol_begin()
    return firmware


@pytest.fixture
def board(built):
    return begun(built)


def test_the_driver_finds_the_limits_and_units_of_the_axes(board):
    channels = [
        DeviceChannel(f"{name} current", {}, "A", low=0.0, high=0.4) for name in ("pan", "tilt")
    ]
    sensors = [DeviceChannel(name, {}, "deg") for name in ("pan", "tilt")]
    lines = [DeviceChannel(name, {}, rest=float(rest)) for name, rest in HEAD_LINES]
    driver = SerialBoard(
        board, DevicePlan("board", {}, tuple(channels), tuple(sensors), tuple(lines))
    )
    assert driver.patience == 0.5
    board.values["outputs"][:2] = [12.5, -1e-7]
    np.testing.assert_array_equal(driver.read(), [12.5, -1e-7])
    driver.set(np.array([0.1, 0.2]))
    driver.switch({0: False, 3: True})
    assert board.lines == [0, 1, 1, 1]
    board.let(100)
    assert board.inputs == [0.1, 0.2]
    driver.safe()
    assert (board.inputs, board.lines) == ([0.0, 0.0], [1, 1, 1, 0])


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("SET", "0.1", "0.41"), "beyond the limits"),
        (("SET", "-1e-9", "0.1"), "beyond the limits"),
        (("SET", "1e999", "0.1"), "that is no number"),
        (("SET", "inf", "0.1"), "that is no number"),
        (("SET", "", "0.1"), "that is no number"),
        (("SET", "0.1"), "unknown command"),
        (("SET", "0.1", "0.1", "0.1"), "unknown command"),
        (("FOLLOW", "10", "60.1"), "out of reach"),
        (("LINE", "4", "1"), "unknown command"),
        (("LINE", "0", "2"), "unknown command"),
        (("OUTPUT", "x"), "unknown command"),
    ],
)
def test_a_command_that_is_refused_changes_nothing(board, words, why):
    board.put("HELLO")
    board.put("SET", "0.2", "0.2")
    board.let(60)
    assert board.put(*words) == (False, why.split())
    board.let(60)
    assert (board.inputs, board.lines) == ([0.2, 0.2], [1, 1, 1, 0])


def test_a_silent_host_loses_its_inputs_and_has_to_acknowledge_it(board):
    board.put("HELLO")
    board.put("SET", "0.2", "0.2")
    board.put("LINE", "3", "1")
    board.let(500)
    assert board.inputs == [0.2, 0.2]
    board.let(1)
    assert (board.inputs, board.lines) == ([0.0, 0.0], [1, 1, 1, 0])
    for words in (("SET", "0.1", "0.1"), ("GET",), ("FOLLOW", "1", "1")):
        assert board.put(*words) == (False, ["safe"])
    assert board.put("SAFE") == (True, ["0", "0"])
    assert board.put("SET", "0.1", "0.1")[0]


def test_a_board_that_had_no_power_is_not_taken_for_one_that_is_on(board):
    assert board.put("SET", "0.1", "0.1") == (False, ["safe"])


def test_damaged_lines_change_nothing_and_do_not_keep_the_board_alive(board):
    board.put("HELLO")
    board.put("SET", "0.2", "0.2")
    rng, good = random.Random(1000), write(9, "SET", "0.1", "0.1")
    for _ in range(1000):
        line = list(good)
        for _ in range(rng.randint(1, 4)):
            line[rng.randrange(len(line))] = chr(rng.randrange(11, 256))
        if "".join(line) != good:
            assert board.ask("".join(line)) == ""
    assert board.ask(500 * "x") == ""
    assert board.ask(good[:20]) == ""
    board.let(60)
    assert board.inputs == [0.2, 0.2]
    board.let(441)
    assert board.inputs == [0.0, 0.0]


def test_a_sensor_without_a_reading_is_refused(board):
    board.put("HELLO")
    readable = ctypes.c_int.in_dll(board.library, "readable")
    readable.value = 0
    assert board.put("GET") == (False, ["no", "reading"])
    readable.value = 1
    assert board.put("GET")[0]


def test_targets_are_followed_until_inputs_are_set(board):
    axes = _board.heated_axes()
    targets = np.tile([20.0, 30.0], (100, 1))
    expected = _board.expected_inputs(axes, targets, _board.COUPLING)
    board.put("HELLO")
    board.let(39)
    assert board.numbers("FOLLOW", "20", "30") == [20.0, 30.0]
    for wanted in expected:
        board.let(40)
        np.testing.assert_allclose(board.numbers("ON"), wanted, rtol=0, atol=4e-12)
    board.put("SET", "0.3", "0.1")
    board.let(200)
    assert board.inputs == [0.3, 0.1]


def test_numbers_are_read_and_written_as_python_does(board):
    rng = np.random.default_rng(1000)
    values = [*(rng.uniform(-1, 1, 2000) * 10.0 ** rng.integers(-30, 30, 2000)), 0.0, 1.0, 99999.0]
    text, read = ctypes.create_string_buffer(24), ctypes.c_double()
    write_number = board.library.number_write
    write_number.argtypes = [ctypes.c_char_p, ctypes.c_double]
    for value in map(float, values):
        for given in (repr(value), f"{value:.9g}", f"{value:.20e}"):
            assert board.library.number_read(given.encode(), ctypes.byref(read))
            assert read.value == pytest.approx(float(given), rel=1e-14)
        write_number(text, value)
        assert float(text.value) == pytest.approx(value, rel=1e-11)


@pytest.fixture(scope="module")
def static(tmp_path_factory):
    """A firmware of axes without dynamics."""
    return Firmware(tmp_path_factory.mktemp("static"), _board.static_axes())


def test_axes_without_dynamics_follow_python_for_ten_thousand_ticks(static):
    axes = _board.static_axes()
    targets = _board.targets_of(axes, 10_000)
    expected = _board.expected_inputs(axes, targets, None)
    one, found = begun(static), []
    one.put("HELLO")
    one.let(39)
    for row in targets.tolist():
        one.ask(write(7, "FOLLOW", *map(repr, row)))
        one.let(40)
        found.append(one.inputs)
    assert np.abs(np.array(found) - expected).max() <= 1e-6 * 2.0


def axis(**known):
    model = Preisach([0.0, 0.5, 1.0], [[1, 0], [1, 1]])
    given = {"model": model, "input": Channel("u", "V", 0.0, 1.0), "output": Channel("y", "um")}
    return BoardAxis(**{**given, **known})


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"model": RelayModel([0.0, 1.0], [[1, 0], [1, 1]])}, "is a RelayModel"),
        ({"input": Channel("u", "V")}, "u has no limits"),
        ({"rest": 2.0}, "u rests at 2"),
        ({"model": _board.heated_axes()[0].model, "input": Channel("u", "A", -1.0, 1.0)}, "-1 A"),
        ({"output": Channel("y", "deg C")}, "unit 'deg C'"),
    ],
)
def test_axes_that_cannot_be_exported_are_refused(known, message):
    with pytest.raises(ParameterError, match=message):
        axis(**known)


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    """The firmware of a head, built for the emulator; it waits two seconds for its host."""
    missing = _cortex.missing_tools()
    if missing:
        pytest.skip(f"needs {', '.join(missing)}, which is not installed")
    folder = tmp_path_factory.mktemp("image")
    board_source(_board.heated_axes(), lines=HEAD_LINES, patience=2.0).write(folder, force=True)
    _cortex.run(["make", "-s", "CC=arm-none-eabi-gcc -DSTALE=60000u"], folder)
    return folder


@contextlib.contextmanager
def emulated(image, head_port):
    """Yield the emulator, which runs a firmware, and the port of its host."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        host = f"socket,id=host,fd={server.fileno()},server=on,wait=off,nodelay=on"
        command = ["qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-monitor", "none"]
        command += ["-kernel", "firmware.elf", "-chardev", host, "-serial", "chardev:host"]
        command += ["-serial", f"tcp:127.0.0.1:{head_port},nodelay=on"]
        with subprocess.Popen(command, cwd=image, pass_fds=[server.fileno()]) as emulator:
            try:
                yield emulator, server.getsockname()[1]
            finally:
                emulator.kill()


@contextlib.contextmanager
def simulated_head():
    """Yield the port of the wires, and the lines of their log as they come."""
    program = [sys.executable, "-I", "-S", EXAMPLES / "simulated_head.py", "--log", "/dev/stdout"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield int(process.stdout.readline()), process.stdout
        finally:
            process.kill()


def until(log, *words):
    """Read a log up to a line that begins with words."""
    wanted = " ".join(words)
    return next(line for line in log if line.startswith(wanted))


class SocketLink:
    """A link that waits for a slow machine, and not for a board that is gone."""

    def __init__(self, resource, **_):
        self.name = resource
        self.wire = socket.create_connection(("127.0.0.1", int(resource)), timeout=60)
        self.line = self.wire.makefile("rw")

    def ask(self, text):
        try:
            self.line.write(f"{text}\n")
            self.line.flush()
            return self.read()
        except OSError as error:
            raise InstrumentError(f"{self.name}: {error}") from None

    def read(self):
        line = self.line.readline()
        if not line:
            raise InstrumentError(f"{self.name} is gone")
        return line.strip()

    def close(self):
        with contextlib.suppress(OSError):
            self.line.close()
        self.wire.close()


@pytest.mark.whole
def test_the_console_steers_wires_through_an_emulated_board_until_it_is_killed(
    image, tmp_path, monkeypatch
):
    monkeypatch.setattr(link, "VisaLink", SocketLink)
    with simulated_head() as (head_port, log), emulated(image, head_port) as (emulator, port):
        until(log, "DRIVE 0.0 0.0")
        text = (image / "bench.toml").read_text()
        text = text.replace("TCPIP0::127.0.0.1::7001::SOCKET", str(port))
        (tmp_path / "bench.toml").write_text(text)
        plant = open_plant(f"bench:{tmp_path / 'bench.toml'}")
        plant.flood(True)
        until(log, "DRIVE 0.0 0.0 15")
        pilot = Pilot(plant=plant).steering(30)
        assert pilot.session.state.mode == "HEAD"
        drives = [until(log, "DRIVE").split() for _ in range(3)]
        assert 0.0 < float(drives[-1][1]) <= 0.4
        emulator.kill()
        watched = WatchedPlant(plant, 60.0)
        watched._carry_out(Command(0.0, [0.1, 0.1, 0.0, 0.0]))
        assert np.isnan(watched._y).all()  # no reading, so the head is held
        assert not watched.is_safe  # the board cannot confirm
        until(log, "BOARD gone")
        assert log.readline() == "DRIVE 0.0 0.0 15\n"
        plant.close()


def test_an_emulated_board_computes_what_python_does():
    missing = _cortex.missing_tools()
    if missing:
        pytest.skip(f"needs {', '.join(missing)}, which is not installed")
    axes = _board.heated_axes()
    targets = _board.targets_of(axes, 500)
    expected = _board.expected_inputs(axes, targets, _board.COUPLING)
    found = _board.count_board(axes, targets, coupling=_board.COUPLING)
    assert max(found.errors(axes, expected)) <= 1e-6
    assert 20_000 < found.mean_tick <= found.worst_tick < 100_000
    assert 5_000 < found.mean_question <= found.worst_question < 30_000
    assert 200 < found.stack < 2048
