"""A tracker of an operator's head, simulated: it looks round, by the UDP protocol of OpenTrack.

It is a program of its own, made of Python's standard library only. A packet is six little-endian
doubles: x, y, z in cm; yaw, pitch, roll in degrees. It runs until it is ended::

    python examples/simulated_tracker.py 4242
"""

import argparse
import contextlib
import math
import socket
import struct
import time

RATE = 60.0
"""Packets a second."""


def resting(angle):
    """Return a swing between -1 and 1 that rests at both ends."""
    return min(max(1.5 * math.sin(angle), -1.0), 1.0)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("port", type=int, help="port of this machine to send to")
    options.add_argument("--swing", type=float, default=14.0, help="degrees of yaw and pitch")
    options.add_argument("--period", type=float, default=14.0, help="seconds of a swing of yaw")
    given = options.parse_args()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        began = due = time.monotonic()
        while True:
            angle = 2.0 * math.pi * (due - began) / given.period
            yaw, pitch = given.swing * resting(angle), given.swing * resting(0.7 * angle)
            packet = struct.pack("<6d", 0.0, 0.0, 0.0, yaw, pitch, 0.0)
            with contextlib.suppress(ConnectionError):  # nobody listens yet
                sending.sendto(packet, ("127.0.0.1", given.port))
            due += 1.0 / RATE
            time.sleep(max(due - time.monotonic(), 0.0))


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
