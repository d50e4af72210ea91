"""Instruments on a network that misbehave: whatever they do, an answer comes or an error does."""

import contextlib
import socket
import threading

import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.link import VisaLink

pytest.importorskip("pyvisa_py", reason="needs pyvisa and pyvisa-py: minorloop[instruments]")

TIMEOUT = 1.0


class Instrument:
    """Answers READ? badly once, in one of several ways, and soundly from then on."""

    def __init__(self, badly):
        self.badly, self.heard, self.over = badly, [], threading.Event()
        self.began = threading.Event()
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
    while not instrument.over.is_set():
        line.sendall(b"1" * 65536)
        instrument.began.set()


def half(instrument, line):
    line.sendall(b"1.5")


def late(instrument, line):
    instrument.over.wait(1.5 * TIMEOUT)
    line.sendall(b"9.9\n")


def garbage(instrument, line):
    line.sendall(b"#@!\xff\xfe\n")


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
        (close, "no answer within 1 s"),
        (drip, "without the end of a line"),
        (flood, "without the end of a line"),
        (half, "no answer within 1 s"),
        (late, "no answer within 1 s"),
        (garbage, r"answers b'#@!\\xff\\xfe\\n', which is no text"),
    ],
)
def test_an_answer_that_does_not_end_is_an_error_and_the_next_is_sound(linked, badly, message):
    instrument, link = linked(badly)
    with pytest.raises(InstrumentError, match=message):
        link.ask("READ?")
    link.tell("VOLT 0")
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
    with pytest.raises(InstrumentError, match="in no state to be asked"):
        link.ask("READ?")
    assert link.ask("READ?") == "1.5"


def test_a_line_that_never_stops_is_no_line_to_ask_on(linked):
    instrument, link = linked(flood)
    link.tell("READ?")
    assert instrument.began.wait(10)
    with pytest.raises(InstrumentError, match="does not stop sending"):
        link.ask("READ?")
    assert link.ask("READ?") == "1.5"


def test_a_second_answer_is_not_taken_for_that_to_the_next_question(linked):
    _, link = linked(twice)
    assert [link.ask("READ?") for _ in range(3)] == ["1.5"] * 3
