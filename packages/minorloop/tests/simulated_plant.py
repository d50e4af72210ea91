"""A source with a meter on a clock whose time passes only while somebody sleeps."""

import math

from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench


class Clock:
    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


class Plant:
    """A source and a meter that reads twice the input, and what they did at which times."""

    def __init__(self, lag=0.0):
        self.clock, self.lag = Clock(), lag
        self.value, self.sent, self.reads = 0.0, [], []

    def set(self, value):
        self.value = value
        self.sent.append((self.clock.now(), value))

    def safe(self):
        self.value = 0.0
        self.sent.append((self.clock.now(), "safe"))

    def read(self):
        self.clock.sleep(self.lag / 2)
        self.reads.append(self.clock.now())
        self.clock.sleep(self.lag / 2)
        return 2.0 * self.value

    def bench(self, low=-1.0, high=1.0, rate=math.inf, **options):
        """A bench of both, whose input has these limits."""
        voltage, tip = Channel("voltage", "V", low, high, rate), Channel("tip", "mm", -5.0, 5.0)
        return Bench(self, self, voltage, tip, clock=self.clock, **options)
