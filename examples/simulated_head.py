"""Two heated wires behind the converters of an emulated board, on a network port.

It is a program of its own, made of Python's standard library only. The firmware that
`minorloop head board` writes has a second serial port in place of its converters: the emulator
connects it to this program, which is sent the currents in A and the digital lines, "0.25 0.1 7",
and answers with the angles in degrees, "12.5 3.25"::

    python examples/simulated_head.py --port 7002 --log head.log
    make -C firmware run

The amplifiers of the wires go to rest when the board sends nothing for a while or is gone, as those
with a pull-down resistor do.
"""

import argparse
import contextlib
import math
import os
import random
import socket
import time

REST = 0.0
NOISE = 0.02
"""Standard deviation of a sensor, in degrees."""
PULLED_DOWN = 0.5
"""Seconds without the board after which the currents are at rest."""


LAG, HEATING = 1.5, 700.0
"""Seconds in which a wire cools, and degrees Celsius for a square ampere."""
HALF_WIDTH = 6.0
"""Half the width of the hysteresis, in degrees Celsius."""


class Wire:
    def __init__(self):
        self.temperature = 20.0
        self.memory = 20.0

    def advance(self, seconds, current):
        final = 20.0 + HEATING * current**2
        self.temperature = final + (self.temperature - final) * math.exp(-seconds / LAG)
        low, high = self.temperature - HALF_WIDTH, self.temperature + HALF_WIDTH
        self.memory = min(max(self.memory, low), high)

    def angle(self):
        return 62.0 / (1.0 + math.exp(-(self.memory - 75.0) / 12.0)) - 0.625


class Head:
    def __init__(self, log):
        self.wires, self.currents, self.lines = [Wire(), Wire()], [REST, REST], 0
        self.log, self.now, self.there = log, time.monotonic(), False

    def advance(self):
        now = time.monotonic()
        for wire, current in zip(self.wires, self.currents, strict=True):
            wire.advance(now - self.now, current)
        self.now = now

    def drive(self, currents, lines):
        if (currents, lines, True) != (self.currents, self.lines, self.there):
            self.currents, self.lines, self.there = currents, lines, True
            self.note("DRIVE", *currents, lines)

    def note(self, *words):
        print(*words, file=self.log, flush=True)

    def answer(self, line):
        """Return the readings for a line of the board; None if it is damaged."""
        self.advance()
        try:
            *currents, lines = line.split()
            currents, lines = [float(current) for current in currents], int(lines)
        except ValueError:
            return None
        if len(currents) != len(self.wires) or not all(math.isfinite(each) for each in currents):
            return None
        self.drive(currents, lines)
        return " ".join(f"{random.gauss(wire.angle(), NOISE):.4f}" for wire in self.wires) + "\n"

    def pulled_down(self, why):
        self.advance()
        if self.there or why == "gone":
            self.currents, self.there = [REST, REST], False
            self.note("BOARD", why)
            self.note("DRIVE", *self.currents, self.lines)


def serve(board, head):
    """Answer a board until it is gone."""
    board.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    board.settimeout(PULLED_DOWN)
    received = b""
    while True:
        try:
            came = board.recv(4096)
        except TimeoutError:
            head.pulled_down("silent")
            continue
        except OSError:
            came = b""
        if not came:
            head.pulled_down("gone")
            return
        *lines, received = (received + came).split(b"\n")
        for line in lines:
            answer = head.answer(line.decode("ascii", "replace"))
            if answer is not None:
                with contextlib.suppress(OSError):
                    board.sendall(answer.encode())


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--port", type=int, default=0, help="of this machine; any without it")
    options.add_argument("--log", default=os.devnull, help="file for all currents")
    given = options.parse_args()
    with socket.create_server(("127.0.0.1", given.port)) as server, open(given.log, "a") as log:
        print(server.getsockname()[1], flush=True)
        head = Head(log)
        while True:
            board, _ = server.accept()
            with board:
                head.note("BOARD there")
                serve(board, head)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
