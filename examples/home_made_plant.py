"""A plant of your own: an amplifier and two angle sensors behind a line of text.

In this folder: minorloop devices module:home_made_plant.head:/dev/ttyACM0
"""

import numpy as np
import serial  # pyserial, of minorloop[instruments]

from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench


class Wires:
    """Takes ``I 0.1 0.2``, and answers two angles such as ``31.2 29.8``."""

    def __init__(self, port):
        self.line = serial.Serial(port, 115200, timeout=0.1, exclusive=True)

    def ask(self, text):
        self.line.reset_input_buffer()
        self.line.write(f"{text}\n".encode())
        return np.array(self.line.readline().split(), float)

    def set(self, currents):
        self.angles = self.ask("I {:.6f} {:.6f}".format(*currents))

    def read(self):
        return self.ask("A")

    def safe(self):
        if not (self.ask("OFF") == 0).all():
            raise OSError("the amplifier does not say that it is off")


def head(port):
    wires = Wires(port)
    inputs = [Channel(f"{axis} current", "A", 0.0, 0.4, rate=10.0) for axis in ("pan", "tilt")]
    outputs = [Channel(axis, "deg", -10.0, 90.0) for axis in ("pan", "tilt")]
    return Bench(wires, wires, inputs, outputs, tick=0.04, links=[wires.line], serial="H-02")
