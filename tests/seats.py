"""Sessions for tests: a rig, its eyes, a pilot who sends what a page would, a loop that is none."""

import math
import warnings
from functools import cache

import numpy as np

from minorloop.head.console import messages
from minorloop.head.console.camera_protocol import CameraReport
from minorloop.head.console.perception import Perception
from minorloop.head.console.plant import PlantView, head_of, open_plant, open_tip
from minorloop.head.console.session import Session
from minorloop.head.geometry import Pinhole

with warnings.catch_warnings():
    # Newer ones warn that the client of another package is preferred to httpx.
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient

__all__ = [
    "AHEAD",
    "PIT",
    "Open",
    "Pilot",
    "Shut",
    "SilentLoop",
    "TestClient",
    "control",
    "right",
    "tip",
    "view",
]
ADDRESS = "twin:pipe"
AHEAD = (0.0, 0.0, 0.0, 1.0)
PIT = (0.45, 20e-3, 1e-3, 0.5e-3)
"""Phi, z, diameter and depth of the first pit of the pipe behind the address."""


@cache
def control():
    return head_of(ADDRESS, None)


@cache
def view():
    return tip()[1]


def tip():
    return open_tip(ADDRESS)


def right(yaw, pitch=0.0):
    """Pose of a head turned right and then up, in degrees."""
    a, b = math.radians(-yaw) / 2, math.radians(pitch) / 2
    x, y = (0.0, math.sin(a), 0.0, math.cos(a)), (math.sin(b), 0.0, 0.0, math.cos(b))
    return x[3] * y[0], x[1] * y[3], -x[1] * y[0], x[3] * y[3]


class Open:
    """Eyes that see at once."""

    def __init__(self):
        real, _ = tip()
        self.eyes, self._seen = Perception(real, view()), []

    def look(self, look):
        self._seen.append(self.eyes.tick(look))

    def seen(self):
        seen, self._seen = self._seen, []
        return seen


class Shut:
    """Eyes that see what a test says: ``target`` always, ``events`` once; they hear at once."""

    def __init__(self):
        self.target, self.events, self.spots, self.looks = None, [], [], []

    def look(self, look):
        self.looks.append(look)
        heard = sum(name == "shoot" for name, _ in look.wishes)
        self.events += [{"what": "burst", "verdict": ""}] * heard

    def seen(self):
        if not self.looks:
            return []
        events, self.events = self.events, []
        number = self.looks[-1].number
        return [CameraReport(number=number, target=self.target, spots=self.spots, events=events)]

    @property
    def wishes(self):
        return [name for look in self.looks for name, _ in look.wishes]


class Pilot:
    """A session and somebody who steers it."""

    def __init__(self, sight=None):
        self.plant = open_plant(ADDRESS)
        self.sight = sight or Shut()
        self.session = Session(self.plant, view(), control(), self.sight)
        self.now, self.seq = 100.0, 0

    def order(self, kind, **content):
        self.seq += 1
        self.session.hear(kind(seq=self.seq, t=self.now, grant=1, **content), self.now)

    def drive(self, ticks=1, pose=AHEAD, stick=(0.0, 0.0), clutch=False, age=0.0, look=None):
        """Ticks with the operator's head, stick and clutch; ``look`` is called after each."""
        for _ in range(ticks):
            self.order(messages.Drive, pose=pose, age=age, stick=stick, clutch=clutch)
            self.silence()
            if look is not None:
                look(self.session)

    def silence(self, ticks=1):
        """Ticks without a word."""
        for _ in range(ticks):
            self.session.tick(self.now)
            self.now += self.session.interval

    def until(self, holds, ticks=1500, pose=AHEAD):
        """Drive until something holds."""
        for _ in range(ticks):
            if holds(self.session):
                return
            self.drive(pose=pose)
        raise AssertionError("it never came to that")

    def mode(self, mode):
        self.order(messages.Mode, mode=mode)

    def steering(self, ticks=50):
        """In HEAD, the wires warm."""
        self.drive()
        self.mode("HEAD")
        self.drive(ticks)
        return self

    def following(self, pixel=(400.0, 200.0)):
        """In TRACK, on a point that shut eyes see at a pixel."""
        self.steering()
        self.sight.target = (*pixel, 1.0, True)
        self.drive(2)
        self.mode("TRACK")
        self.drive()
        return self

    def tracking(self):
        """In TRACK, on the likeliest candidate, which has come to rest in the middle, in focus."""
        self.steering(2)
        self.until(lambda s: s.seen.spots, pose=right(27.0, -12.0))
        self.order(messages.Pick, u=self.session.seen.spots[0][0], v=self.session.seen.spots[0][1])
        self.until(lambda s: s.seen.target is not None)
        self.mode("TRACK")
        self.until(lambda s: s.focus not in ("", "searching"))
        return self

    def measured(self):
        """What was tracked, by its outline."""
        self.order(messages.Measure)
        self.until(lambda s: s.findings)
        return self


class SilentLoop:
    """Stands in for the control loop: keeps what it is ordered, and says what it is told to."""

    def __init__(self, settings, said):
        self.settings, self.said, self.orders = settings, said, []

    def start(self):
        small = PlantView(lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=np.zeros((3, 3)))
        self.said(messages.encode("hello", view={}, known=small.told(), cone=28.0, planes=[]))

    def order(self, message):
        self.orders.append(message)

    def stop(self):
        pass
