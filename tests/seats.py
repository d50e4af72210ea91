"""Sessions for tests: a rig, a pilot who sends what a page would send, and a loop that is none."""

import math
import warnings
from functools import cache

from minorloop.teleop import messages
from minorloop.teleop.plant import head_of, open_plant
from minorloop.teleop.session import Session
from minorloop.teleop.sight import PlainSight

with warnings.catch_warnings():
    # Newer ones warn that the client of another package is preferred to httpx.
    warnings.simplefilter("ignore")
    from starlette.testclient import TestClient

__all__ = ["AHEAD", "Pilot", "SilentLoop", "TestClient", "control", "right"]
ADDRESS = "twin:rig"
AHEAD = (0.0, 0.0, 0.0, 1.0)


@cache
def control():
    return head_of(ADDRESS, None)


def right(yaw, pitch=0.0):
    """Pose of a head turned right and then up, in degrees."""
    a, b = math.radians(-yaw) / 2, math.radians(pitch) / 2
    x, y = (0.0, math.sin(a), 0.0, math.cos(a)), (math.sin(b), 0.0, 0.0, math.cos(b))
    return x[3] * y[0], x[1] * y[3], -x[1] * y[0], x[3] * y[3]


class Pilot:
    """A session and somebody who steers it."""

    def __init__(self):
        plant, view = open_plant(ADDRESS)
        self.plant, self.view = plant, view
        self.session = Session(plant, view, control(), PlainSight(view=view))
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

    def mode(self, mode):
        self.order(messages.Mode, mode=mode)

    def steering(self, ticks=50):
        """In HEAD, the wires warm."""
        self.drive()
        self.mode("HEAD")
        self.drive(ticks)
        return self

    def tracking(self):
        """In TRACK, on the brightest spot, which has come to rest in the middle."""
        self.steering(150)
        self.pick()
        self.mode("TRACK")
        self.drive(180)
        return self

    def pick(self):
        spot = max(self.session.spots, key=lambda s: s.contrast)
        self.order(messages.Pick, u=spot.u, v=spot.v)


class SilentLoop:
    """Stands in for the control loop: keeps what it is ordered, and says what it is told to."""

    def __init__(self, settings, said):
        self.settings, self.said, self.orders = settings, said, []

    def start(self):
        self.said(
            messages.encode(
                "hello", view={"width": 64, "height": 48, "focal": 50.0}, cone=28.0, planes=[]
            )
        )

    def order(self, message):
        self.orders.append(message)

    def stop(self):
        pass
