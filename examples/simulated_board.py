"""A board with two actuators and two sensors, simulated on a pseudo-terminal.

It is a program of its own, made of Python's standard library only: it knows the serial protocol and
nothing else. It prints the name of its terminal and runs until it is ended::

    python examples/simulated_board.py --port /tmp/board --log /tmp/board.log

An actuator is heated by the square of its input, 0.4 A at most unless told otherwise, and cools
again within some seconds. Its output follows the temperature along an S, with hysteresis: some 60
degrees at the highest input, 0.4 degrees when cold again.
"""

import argparse
import contextlib
import math
import os
import pty
import random
import select
import socket
import time
import tty
import zlib

LOW, REST = 0.0, 0.0
PATIENCE = 1.0
"""Seconds without a line after which the board goes to its safe inputs."""
LAG, HEATING = 1.5, 112.0
"""Seconds in which an actuator cools, and degrees Celsius at its highest input."""
NOISE = 0.02
"""Standard deviation of a sensor, in its unit."""
TELLING = 0.01
"""Seconds from one message to the simulated camera to the next."""
HALF_WIDTH = 6.0
"""Half the width of the hysteresis, in degrees Celsius."""


class Actuator:
    def __init__(self):
        self.temperature = 20.0
        self.memory = 20.0 + HALF_WIDTH  # it was heated before

    def advance(self, seconds, share):
        final = 20.0 + HEATING * share**2
        self.temperature = final + (self.temperature - final) * math.exp(-seconds / LAG)
        low, high = self.temperature - HALF_WIDTH, self.temperature + HALF_WIDTH
        self.memory = min(max(self.memory, low), high)

    def output(self):
        return 62.0 / (1.0 + math.exp(-(self.memory - 75.0) / 12.0)) - 0.625


class Board:
    def __init__(self, unit, high, of, log):
        self.actuators, self.inputs, self.lines = [Actuator(), Actuator()], [REST, REST], [0] * 4
        self.unit, self.high, self.of, self.log, self.told = unit, high, of, log, -math.inf
        self.heard, self.tripped = time.monotonic(), False
        self.now = self.heard

    def advance(self):
        now = time.monotonic()
        for actuator, u in zip(self.actuators, self.inputs, strict=True):
            actuator.advance(now - self.now, u / self.high)
        self.now = now
        if now - self.heard > PATIENCE and any(self.inputs):
            self.inputs, self.tripped = [REST, REST], True
            self.note("PATIENCE")

    def tell(self, sending, port):
        """Tell a simulated camera the outputs and which lines are on."""
        if self.now - self.told < TELLING:
            return
        self.told = self.now
        outputs = (f"{actuator.output():.4f}" for actuator in self.actuators)
        with contextlib.suppress(ConnectionError):  # nobody listens yet
            words = " ".join([*outputs, *map(str, self.lines)])
            sending.sendto(words.encode(), ("127.0.0.1", port))

    def note(self, *words):
        print(f"{time.monotonic():.4f}", *words, file=self.log, flush=True)

    def answer(self, line):
        """Return the answer to a line; None if the line is damaged."""
        body, star, sum_ = line.rpartition("*")
        if not star or f"{zlib.crc32(body.encode()):08X}" != sum_:
            return None
        self.heard = time.monotonic()
        sequence, command, *words = body.split()
        self.note(command, *words)
        try:
            ok, values = True, self.carry_out(command, words)
        except (ValueError, IndexError) as error:
            ok, values = False, str(error).split()
        text = " ".join([sequence, "OK" if ok else "ERR", *values]) + " "
        return f"{text}*{zlib.crc32(text.encode()):08X}"

    def carry_out(self, command, words):
        if command in ("HELLO", "SAFE"):
            self.tripped = False
        elif self.tripped:
            raise ValueError("safe")
        if command == "HELLO":
            return ["minorloop", "3", "2", "2", str(len(self.lines)), f"{1000 * PATIENCE:g}"]
        if command == "INPUT" and int(words[0]) in (0, 1):
            return [self.unit, f"{LOW:g}", f"{self.high:g}", f"{REST:g}"]
        if command == "OUTPUT" and int(words[0]) in (0, 1):
            return [self.of]
        if command == "SET" and len(words) == 2:
            wanted = [float(word) for word in words]
            if not all(LOW <= value <= self.high for value in wanted):
                self.note("BEYOND", *words)
                raise ValueError("beyond the limits")
            self.inputs = wanted
            return words
        if command == "GET":
            return [f"{random.gauss(each.output(), NOISE):.4f}" for each in self.actuators]
        if command == "LINE" and words[1] in ("0", "1"):
            self.lines[int(words[0])] = int(words[1])
            return [words[1]]
        if command == "SAFE":
            self.inputs, self.lines = [REST, REST], [0] * len(self.lines)
            return [f"{value:g}" for value in self.inputs]
        raise ValueError("unknown command")


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--port", help="name of the terminal, a link; its own name without it")
    options.add_argument("--log", default=os.devnull, help="file for all commands")
    options.add_argument("--unit", default="A", help="unit of the inputs")
    options.add_argument("--high", type=float, default=0.4, help="highest input")
    options.add_argument("--of", default="deg", help="unit of the outputs")
    options.add_argument("--late", type=float, default=0.0, help="seconds before each answer")
    options.add_argument("--half", type=int, default=0, help="answers after which lines are cut")
    options.add_argument("--tell", type=int, help="port to send outputs and lines to")
    given = options.parse_args()
    sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = given.port or os.ttyname(slave)
    if given.port:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(given.port)
        os.symlink(os.ttyname(slave), given.port)
    with open(given.log, "a") as log:
        board, received, answers = Board(given.unit, given.high, given.of, log), b"", 0
        print(name, flush=True)
        while True:
            ready, _, _ = select.select([master], [], [], 0.01)
            board.advance()
            if given.tell:
                board.tell(sending, given.tell)
            if not ready:
                continue
            *lines, received = (received + os.read(master, 4096)).split(b"\n")
            for line in lines:
                answer = board.answer(line.decode("ascii", "replace").strip())
                if answer is None:
                    continue
                answers += 1
                time.sleep(given.late)
                half = given.half and answers > given.half
                os.write(master, (answer[: len(answer) // 2] if half else answer + "\n").encode())


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
