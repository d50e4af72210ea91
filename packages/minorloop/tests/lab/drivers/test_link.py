"""Instruments on a network that misbehave: whatever they do, an answer comes or an error does."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import tty

import pytest

from faults.instruments import Fault, Serial
from minorloop.errors import InstrumentError
from minorloop.lab.drivers.link import VisaLink
from minorloop.lab.signals import Stopped, ended_by_signals

pytest.importorskip("pyvisa_py", reason="needs pyvisa and pyvisa-py: minorloop[instruments]")

TIMEOUT = 1.0


class Instrument:
    """Answers READ? badly once, in one of several ways, and soundly from then on."""

    def __init__(self, badly):
        self.badly, self.heard, self.over = badly, [], threading.Event()
        self.began, self.ended = threading.Event(), threading.Event()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.resource = f"TCPIP::127.0.0.1::{self.listener.getsockname()[1]}::SOCKET"
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                line, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.talk, args=(line,), daemon=True).start()

    def talk(self, line):
        try:
            self.listen(line)
        finally:
            self.ended.set()

    def listen(self, line):
        with line, contextlib.suppress(OSError):  # the other end may go at any time
            for text in line.makefile("r", newline="\n"):
                self.heard.append(text.strip())
                if text.strip() != "READ?":
                    continue
                badly, self.badly = self.badly, None
                if badly is None:
                    line.sendall(b"1.5\n")
                elif badly(self, line):
                    line.shutdown(socket.SHUT_RDWR)
                    return


def close(instrument, line):
    return True


def drip(instrument, line):
    while not instrument.over.wait(0.02):
        line.sendall(b"1")


def flood(instrument, line):
    while not instrument.over.wait(1e-3):  # a faster one would keep a core busy
        line.sendall(b"1" * 4096)
        instrument.began.set()


def half(instrument, line):
    line.sendall(b"1.5")


def late(instrument, line):
    instrument.over.wait(1.5 * TIMEOUT)
    line.sendall(b"9.9\n")


def garbage(instrument, line):
    line.sendall(b"#@!\xff\xfe\n")


def answer(instrument, line):
    line.sendall(b"1.5\n")
    instrument.began.set()


def twice(instrument, line):
    line.sendall(b"1.5\n9.9\n")


@pytest.fixture
def linked():
    opened = []

    def linked(badly):
        instrument = Instrument(badly)
        link = VisaLink(instrument.resource, timeout=TIMEOUT)
        opened.append((instrument, link))
        return instrument, link

    yield linked
    for instrument, link in opened:
        instrument.over.set()
        link.close()
        instrument.listener.close()


@pytest.mark.parametrize(
    ("badly", "message"),
    [
        (close, "no answer within 1 s: the other end closed the connection"),
        (drip, r"no whole answer within 1 s: b'1+'( and so on)?, without the end of a line"),
        (flood, "no whole answer within 1 s: b'1{40}' and so on, without the end of a line"),
        (half, "no whole answer within 1 s: b'1.5', without the end of a line"),
        (late, "no answer within 1 s"),
        (garbage, r"answers b'#@!\\xff\\xfe\\n', which is not text"),
    ],
)
def test_an_answer_that_does_not_end_is_an_error_and_the_next_is_sound(linked, badly, message):
    instrument, link = linked(badly)
    with pytest.raises(InstrumentError, match=message):
        link.ask("READ?")
    link.send("VOLT 0")
    assert link.ask("READ?") == "1.5"
    assert instrument.heard == ["READ?", "VOLT 0", "READ?"]


class Unplugged:
    """What is left of a line when the cable is out: whatever is done with it fails."""

    def __setattr__(self, name, value):
        raise OSError("no such device")

    def __getattr__(self, name):
        raise OSError("no such device")


def test_a_line_that_is_gone_is_an_error_and_opened_anew(linked):
    _, link = linked(None)
    link._resource.close()
    link._resource = Unplugged()
    with pytest.raises(InstrumentError, match="cannot be asked"):
        link.ask("READ?")
    assert link.ask("READ?") == "1.5"


def test_a_line_that_never_stops_is_no_line_to_ask_on(linked):
    instrument, link = linked(flood)
    link.send("READ?")
    assert instrument.began.wait(10)
    with pytest.raises(InstrumentError, match="does not stop sending"):
        link.ask("READ?")
    assert link.ask("READ?") == "1.5"


def test_a_second_answer_is_not_taken_for_that_to_the_next_question(linked):
    _, link = linked(twice)
    assert [link.ask("READ?") for _ in range(3)] == ["1.5"] * 3


def test_what_was_sent_arrives_though_an_answer_was_never_read(linked):
    instrument, link = linked(answer)
    lines = [f"VOLT {k}" for k in range(25)]
    for line in [*lines, "READ?"]:
        link.send(line)
    assert instrument.began.wait(20)
    link.send("VOLT 0")
    link.send("OUTP OFF")
    link.close()
    assert instrument.ended.wait(20)
    assert instrument.heard == [*lines, "READ?", "VOLT 0", "OUTP OFF"]


def test_no_line_waits_for_the_one_before_to_be_acknowledged(linked):
    _, link = linked(None)
    wire = link._wire(link._resource)
    assert wire.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_a_connection_in_doubt_ends_with_its_last_lines(linked):
    instrument, link = linked(half)
    link.last_lines = ("VOLT 0", "OUTP OFF")
    with pytest.raises(InstrumentError, match="no whole answer"):
        link.ask("READ?")
    link.send("*IDN?")
    assert instrument.ended.wait(20)
    assert instrument.heard[:3] == ["READ?", "VOLT 0", "OUTP OFF"]


def test_nobody_listens_at_a_port():
    listener = socket.create_server(("127.0.0.1", 0))
    resource = f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"
    listener.close()
    with pytest.raises(InstrumentError, match=r"cannot be opened: .*refused"):
        VisaLink(resource, timeout=TIMEOUT)


@pytest.fixture
def supply(tmp_path):
    supply = Serial(Fault(), tmp_path)
    yield supply
    supply.close()


def test_half_a_line_on_a_serial_port_becomes_no_other_input(supply):
    link = VisaLink(supply.bench()["meter"]["resource"], timeout=TIMEOUT)
    link.send("OUTP ON")
    whole = link._resource.write

    def cut(text):
        link._resource.write_raw(b"VOLT 1.5e-0")
        raise KeyboardInterrupt

    link._resource.write = cut
    with pytest.raises(KeyboardInterrupt):
        link.send("VOLT 1.5e-05")
    link._resource.write = whole
    assert link.ask("VOLT?") == "+0.000000E+00"
    assert link.ask("SYST:ERR?").startswith("-1")
    link.close()


def test_a_signal_waits_for_the_answer(supply):
    link = VisaLink(supply.bench()["meter"]["resource"], timeout=TIMEOUT)
    asked = link._resource.write

    def write(text):
        os.kill(os.getpid(), signal.SIGTERM)
        asked(text)

    link._resource.write = write
    with pytest.raises(Stopped), ended_by_signals():
        link.ask("READ?")
    assert supply.heard == 2  # an empty line, which ends what may have been there, and a whole one
    assert not link._doubtful
    link.close()


SECOND = """
import sys
from minorloop.lab.drivers.link import VisaLink
VisaLink(sys.argv[1])
"""


def test_a_second_program_is_refused_before_it_takes_an_answer_of_the_first():
    device, port = os.openpty()
    tty.setraw(port)
    resource = f"ASRL{os.ttyname(port)}::INSTR"
    link = VisaLink(resource, timeout=20.0)

    def answer():
        heard = b""
        while b"READ?\n" not in heard:
            heard += os.read(device, 100)
        os.write(device, b"0\n")

    thread = threading.Thread(target=answer)
    thread.start()
    assert link.ask("READ?") == "0"
    thread.join()
    os.write(device, b"1.5\n")
    command = [sys.executable, "-c", SECOND, resource]
    second = subprocess.run(command, capture_output=True, check=False, text=True)
    assert "cannot be opened: another program uses it; end that program" in second.stderr
    assert link.read() == "1.5"
    link.close()
    VisaLink(resource).close()
    os.close(device)
    os.close(port)
