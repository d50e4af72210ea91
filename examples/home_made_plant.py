"""A plant of your own: an amplifier and two displacement sensors behind a line of text.

In this folder: minorloop devices module:home_made_plant.stage:/dev/ttyACM0
"""

import numpy as np
import serial  # pyserial, of minorloop[instruments]

from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench


class Axes:
    """Takes ``U 10 20``, and answers two displacements such as ``31.2 29.8``."""

    def __init__(self, port):
        self.line = serial.Serial(port, 115200, timeout=0.1, exclusive=True)

    def ask(self, text):
        self.line.reset_input_buffer()
        self.line.write(f"{text}\n".encode())
        return np.array(self.line.readline().split(), float)

    def set(self, voltages):
        self.ask("U {:.6f} {:.6f}".format(*voltages))

    def read(self):
        return self.ask("Y")

    def safe(self):
        if not (self.ask("OFF") == 0).all():
            raise OSError("the amplifier does not say that it is off")


def stage(port):
    axes = Axes(port)
    inputs = [Channel(f"{name} voltage", "V", 0.0, 100.0, rate=2500.0) for name in "xy"]
    outputs = [Channel(name, "um", -10.0, 90.0) for name in "xy"]
    return Bench(axes, axes, inputs, outputs, tick=0.04, links=[axes.line], serial="S-02")
