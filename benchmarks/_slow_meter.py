"""An instrument on loopback that takes its time: ``python -m benchmarks._slow_meter SECONDS``.

It prints its port, answers ``VOLT u``, ``VOLT?``, ``READ?`` and ``OUTP OFF``, and gives after
``LOG?`` what it really did and when, as one line of JSON. It measures over the whole of the time
that it takes, as a voltmeter integrates, so that a reading belongs to the middle of it.
"""

from __future__ import annotations

import json
import random
import socket
import sys
import time

NOISE = 0.01
IDLE = 120.0
"""Seconds without a line after which it ends."""


def main() -> None:
    answer = float(sys.argv[1])
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        server.settimeout(IDLE)
        connection, _ = server.accept()
        connection.settimeout(IDLE)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with connection:
            serve(connection, answer)


def serve(connection: socket.socket, answer: float) -> None:
    """Answer line after line until the log is asked for."""
    noise, level = random.Random(0), 0.0
    log: dict[str, list[list[float]]] = {"set": [], "read": []}
    lines = connection.makefile("r", encoding="ascii")
    for line in lines:
        word, _, value = line.strip().partition(" ")
        if word == "VOLT":
            level = float(value)
            log["set"].append([time.monotonic(), level])
        elif word == "VOLT?":
            connection.sendall(f"{level!r}\n".encode())
        elif word == "READ?":
            began = time.monotonic()
            time.sleep(answer)
            ended = time.monotonic()
            log["read"].append([(began + ended) / 2, ended, level])
            connection.sendall(f"{2.0 + noise.gauss(0.0, NOISE)!r}\n".encode())
        elif word == "LOG?":
            connection.sendall(f"{json.dumps(log)}\n".encode())
            return


if __name__ == "__main__":
    main()
