"""Instruments that know whether they are on, and do one thing wrong at a line that was chosen."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import struct
import subprocess
import threading
import time
import tty
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from minorloop.lab.drivers.serial_line import write

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
TROUBLES = ("reset", "half", "silence", "mute")
LONGEST = 30.0
"""Seconds to wait for anything."""


@dataclass(frozen=True)
class Fault:
    """What goes wrong when a line comes.

    Parameters
    ----------
    kind : str
        A signal to the process that runs; ``double``: three of them, one a line; ``reset``: the
        line is lost and the connection with it; ``half``: of an answer; ``silence``: none;
        ``mute``: none from there on.
    at : int
        Number of the line, counted from 0; -1 for none.
    """

    kind: str = "none"
    at: int = -1


class Supply:
    """A source and a meter in one that speak SCPI, and what is on.

    Parameters
    ----------
    fault : Fault
    folder : Path
        Where a line to it may get a name.
    """

    def __init__(self, fault: Fault, folder: Path) -> None:
        self.fault, self.folder = fault, folder
        self.level, self.is_on, self.heard = 0.0, False, 0
        self.errors: deque[str] = deque()
        self.victim: int | None = None
        self.lock, self.over = threading.RLock(), threading.Event()
        self.begin()

    def begin(self) -> None:
        """Begin to listen."""

    @property
    def energised(self) -> bool:
        """Whether the output is on, at zero too: switched off is what safe means here."""
        return self.is_on

    def trouble(self) -> str:
        """Count a line; give what goes wrong at it, after sending the signals that come now."""
        at, self.heard = self.heard, self.heard + 1
        after = at - self.fault.at
        if self.fault.at < 0 or after < 0:
            return ""
        if self.fault.kind == "double" and after < len(SIGNALS):
            self.interrupt(SIGNALS[after])
        elif self.fault.kind in SIGNALS and after == 0:
            self.interrupt(self.fault.kind)
        if self.fault.kind == "mute" or (self.fault.kind in TROUBLES and after == 0):
            return self.fault.kind
        return ""

    def interrupt(self, name: str) -> None:
        """Send a signal to the process that runs, if it is still there."""
        if self.victim is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.victim, getattr(signal, name))

    def obey(self, line: str) -> str | None:
        """Do what a line says; give the answer if it is a question."""
        words = line.split()
        match words:
            case []:
                return None
            case ["VOLT", number]:
                try:
                    self.level = float(number)
                except ValueError:
                    self.errors.append('-121,"Invalid character in number"')
            case ["OUTP", "ON" | "OFF" as state]:
                self.is_on = state == "ON"
            case ["VOLT?"]:
                return f"{self.level:+.6E}"
            case ["OUTP?"]:
                return f"{self.is_on:d}"
            case ["READ?"]:
                return f"{2.0 * self.level if self.is_on else 0.0:+.6E}"
            case ["SYST:ERR?"]:
                return self.errors.popleft() if self.errors else '+0,"No error"'
            case ["*OPC?"]:
                return "1"
            case _:
                self.errors.append('-113,"Undefined header"')
        return None

    def close(self) -> None:
        """Stop listening."""
        self.over.set()


class Tcp(Supply):
    """Source and meter at one port, each connection in a thread of its own."""

    name = "tcp"
    ports = 1

    def begin(self) -> None:
        self.connections: set[socket.socket] = set()
        self.listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(self.ports)]
        for listener in self.listeners:
            threading.Thread(target=self.accept, args=(listener,), daemon=True).start()

    def bench(self) -> dict:
        ports = [listener.getsockname()[1] for listener in self.listeners]
        resources = [f"TCPIP0::127.0.0.1::{port}::SOCKET" for port in ports]
        return {
            "source": {"resource": resources[0], "on": ["OUTP ON"], "safe": ["VOLT 0", "OUTP OFF"]},
            "meter": {"resource": resources[-1]},
        }

    def accept(self, listener: socket.socket) -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            with self.lock:
                self.connections.add(connection)
            threading.Thread(target=self.talk, args=(connection,), daemon=True).start()

    def talk(self, connection: socket.socket) -> None:
        with contextlib.suppress(OSError), connection.makefile("r", newline="\n") as lines:
            acknowledge_late(connection)
            for line in lines:
                with self.lock:
                    if not self.hear(connection, line):
                        break
                acknowledge_late(connection)
        with self.lock:
            self.connections.discard(connection)
        connection.close()

    def hear(self, connection: socket.socket, line: str) -> bool:
        """Whether the connection is still there after a line."""
        trouble = self.trouble()
        if trouble == "reset":
            linger = struct.pack("ii", 1, 0)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            return False
        answer = self.obey(line)
        if trouble == "half":
            answer = answer or "1.0"  # an answer to what is no question, too
            connection.sendall(answer[: len(answer) // 2].encode())
        elif answer is not None and not trouble:
            connection.sendall(f"{answer}\n".encode())
        return True

    def settle(self) -> None:
        """Wait until nobody is connected, so that all that was sent was heard."""
        end = time.monotonic() + LONGEST
        while self.connections and time.monotonic() < end:
            self.over.wait(0.002)

    def close(self) -> None:
        super().close()
        for listener in self.listeners:
            listener.shutdown(socket.SHUT_RDWR)
            listener.close()


class TwoPorts(Tcp):
    """Source and meter at ports of their own."""

    name = "two ports"
    ports = 2


def acknowledge_late(connection: socket.socket) -> None:
    """Let the other end wait for the acknowledgement of what it sends, where the system can."""
    if hasattr(socket, "TCP_QUICKACK"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 0)


class Serial(Supply):
    """Source and meter on one pseudo-terminal."""

    name = "serial"

    def begin(self) -> None:
        self.path = self.folder / "port"
        self.ends: tuple[int, int] = (-1, -1)
        self.plug()
        self.thread = threading.Thread(target=self.listen, daemon=True)
        self.thread.start()

    def bench(self) -> dict:
        resource = f"ASRL{self.path}::INSTR"
        source = {
            "resource": resource,
            "on": ["OUTP ON"],
            "safe": ["VOLT 0", "OUTP OFF"],
            "confirm": "VOLT?",
            "errors": "SYST:ERR?",
            "safe_query": "OUTP?",
            "safe_answer": "0",
        }
        return {"source": source, "meter": {"resource": resource}}

    def plug(self) -> None:
        """Put the cable in, or out and in again: whoever has the port open has nothing then."""
        before, self.ends = self.ends, os.openpty()
        tty.setraw(self.ends[1])
        link = self.path.with_name("next")
        link.symlink_to(os.ttyname(self.ends[1]))
        link.replace(self.path)
        for end in before:
            if end >= 0:
                os.close(end)

    def listen(self) -> None:
        found = b""
        while not self.over.is_set():
            if not select.select([self.ends[0]], [], [], 0.05)[0]:
                continue
            found += os.read(self.ends[0], 4096)
            *lines, found = found.split(b"\n")
            for line in lines:
                with self.lock:
                    if not self.hear(line.decode("ascii", "replace")):
                        found = b""
                        break

    def hear(self, line: str) -> bool:
        """Whether the cable is still in after a line."""
        trouble = self.trouble()
        if trouble == "reset":
            self.plug()
            return False
        if trouble in ("silence", "mute"):  # the line is lost
            return True
        if trouble == "half" and not line.endswith("?"):
            line = line[: len(line) // 2]
        self.give(self.obey(line), trouble)
        return True

    def give(self, answer: str | None, trouble: str) -> None:
        if answer is not None:
            text = answer[: len(answer) // 2] if trouble == "half" else f"{answer}\n"
            os.write(self.ends[0], text.encode())

    def settle(self) -> None:
        """Wait until all that was sent was heard."""
        end = time.monotonic() + LONGEST
        while time.monotonic() < end:
            with self.lock:
                if not select.select([self.ends[0]], [], [], 0)[0]:
                    return
            self.over.wait(0.002)

    def close(self) -> None:
        super().close()
        self.thread.join(LONGEST)
        for end in self.ends:
            os.close(end)


class Firmware(Serial):
    """A board with the exported firmware, whose own watchdog never goes off.

    What makes it safe is what runs on the other end, then, and nothing else.
    """

    name = "firmware"
    program: Path

    def begin(self) -> None:
        self.spoilt, self.done = "", threading.Event()
        self.log = (self.folder / "inputs").open("w+")
        self.process = subprocess.Popen(
            [self.program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.log
        )
        super().begin()
        self.answers = threading.Thread(target=self.pass_on, daemon=True)
        self.answers.start()

    def bench(self) -> dict:
        return {"board": {"resource": f"ASRL{self.path}::INSTR"}}

    @property
    def energised(self) -> bool:
        """Whether the last input that was put on is another than the safe one."""
        self.log.flush()
        return float((self.folder / "inputs").read_text().split()[-1]) != 0

    def hear(self, line: str) -> bool:
        trouble = self.trouble()
        if trouble == "reset":
            self.plug()
            return False
        if trouble in ("silence", "mute"):  # the line is lost
            return True
        self.spoilt = trouble
        self.process.stdin.write(f"{line}\n".encode())
        self.process.stdin.flush()
        return True

    def pass_on(self) -> None:
        for line in self.process.stdout:
            if line.startswith(b"65535 "):
                self.done.set()
                continue
            with self.lock:
                spoilt, self.spoilt = self.spoilt, ""
                self.give(line.decode().rstrip("\n"), spoilt)

    def settle(self) -> None:
        """Wait until the program has read all, which it says with the answer to one line more."""
        super().settle()
        self.done.clear()
        with self.lock:
            self.process.stdin.write(f"{write(65535, 'GET')}\n".encode())
            self.process.stdin.flush()
        self.done.wait(LONGEST)

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(LONGEST)
        self.answers.join(LONGEST)
        super().close()
        self.process.stdout.close()
        self.log.close()


def build_firmware(folder: Path) -> Path:
    """The program of a board with the exported firmware, compiled in a folder."""
    import numpy as np

    import compiled
    from minorloop.export.c99 import source
    from minorloop.operators.preisach import Preisach

    model = Preisach(np.linspace(-1, 1, 9), np.tril(np.ones((8, 8))), 0.2)
    code = source(model, firmware=True)
    return compiled.board(code, folder, "-DMINORLOOP_PATIENCE_MS=60u")


def use_firmware(program: Path) -> None:
    """Let boards be of that program."""
    Firmware.program = program


KINDS: dict[str, type[Supply]] = {kind.name: kind for kind in (Tcp, TwoPorts, Serial, Firmware)}
