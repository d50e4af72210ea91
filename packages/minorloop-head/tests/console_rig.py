"""Console sessions for tests: plant, cameras, a pilot, and a stand-in for the control loop."""

import itertools
import math
from functools import cache

import msgspec
import numpy as np

from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraReport, CameraRequest
from minorloop_head.console.identified_head import head_of
from minorloop_head.console.perception import Perception
from minorloop_head.console.plant import open_plant, open_tip
from minorloop_head.console.session import Session
from minorloop_head.console.units import to_shown
from minorloop_head.control.head import head_control
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from wires import made_up

__all__ = [
    "AHEAD",
    "MADE_UP",
    "PIT",
    "SMALL",
    "STILL",
    "DirectCamera",
    "Pilot",
    "ScriptedCamera",
    "SilentLoop",
    "control",
    "position",
    "request",
    "right",
    "text",
    "tip",
    "towards",
    "view",
]
ADDRESS = "twin:pipe"
AHEAD = (0.0, 0.0, 0.0, 1.0)
STILL = {"pose": AHEAD, "age": 0.0, "stick": (0.0, 0.0), "clutch": False}
"""What a page sends of an operator who does nothing."""
PIT = (0.45, 20e-3, 1e-3, 0.5e-3)
"""Phi, z, diameter and depth of the first pit of the pipe behind the address."""
SMALL = HeadCalibration(lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=np.zeros((3, 3)))
"""A camera of few pixels."""
MADE_UP = head_control("observer", (made_up(), made_up()))
"""Control of wires that are known at once."""


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


_TICKS = itertools.count()


def request(position, *commands, number=0):
    """A tick of a loop whose sensors have no error."""
    pan, tilt, advance, roll = position
    return CameraRequest(
        number=number,
        t=0.04 * next(_TICKS),
        position=position,
        stance=(pan, tilt, 0.0, 0.0, advance, roll),
        commands=list(commands),
    )


def towards(place, share=1.0, position=(0.0, 0.0, 0.0, 0.0)):
    """Position of the head that looks a share of the way towards phi and z."""
    point = (10e-3 * math.cos(place[0]), 10e-3 * math.sin(place[0]), place[1])
    pan, tilt = np.multiply(view().mount_at(position[2:]).aim(point), share)
    return (float(pan), float(tilt), *position[2:])


def text(kind, **content):
    """A message to the pages with any fields."""
    return msgspec.json.encode({"type": kind, **content})


def position(session):
    """Pan, tilt, advance and roll of the head in degrees and mm."""
    return to_shown(session.position())


class DirectCamera:
    """A camera in the same process."""

    def __init__(self):
        real, _ = tip()
        self.perception, self._reports, self.problem = Perception(real, view()), [], ""

    def send(self, request):
        self._reports.append(self.perception.tick(request))

    def reports(self):
        reports, self._reports = self._reports, []
        return reports


class ScriptedCamera:
    """A camera that always reports ``target``, each of ``events`` once, and fires at once."""

    def __init__(self):
        self.target, self.events, self.spots, self.requests = None, [], [], []
        self.problem = ""

    def send(self, request):
        self.requests.append(request)
        fired = sum(name == "fire" for name, _ in request.commands)
        self.events += [{"what": "burst", "verdict": ""}] * fired

    def reports(self):
        if not self.requests:
            return []
        events, self.events = self.events, []
        number = self.requests[-1].number
        return [CameraReport(number=number, target=self.target, spots=self.spots, events=events)]

    @property
    def commands(self):
        return [name for request in self.requests for name, _ in request.commands]


class Pilot:
    """A session and its pilot, who sees little of a plant that is given."""

    def __init__(self, camera=None, plant=None):
        self.camera, parts = camera or ScriptedCamera(), (SMALL, MADE_UP)
        if plant is None:
            plant, parts = open_plant(ADDRESS), (view(), control())
        self.plant, self.session = plant, Session(plant, *parts, self.camera)
        self.now, self.seq = 100.0, 0

    def order(self, kind, **content):
        self.seq += 1
        self.session.receive(kind(seq=self.seq, t=self.now, grant=1, **content), self.now)

    def drive(self, ticks=1, pose=AHEAD, stick=(0.0, 0.0), clutch=False, age=0.0, look=None):
        """Ticks with the operator's head, stick and clutch; ``look`` is called after each."""
        for _ in range(ticks):
            self.order(messages.Drive, pose=pose, age=age, stick=stick, clutch=clutch)
            self.silence()
            if look is not None:
                look(self.session)

    def silence(self, ticks=1):
        """Ticks without a message."""
        for _ in range(ticks):
            self.session.tick(self.now)
            self.now += self.session.interval

    def until(self, holds, ticks=1500, pose=AHEAD):
        """Drive until a condition is met."""
        for _ in range(ticks):
            if holds(self.session):
                return
            self.drive(pose=pose)
        raise AssertionError("the condition was never met")

    def mode(self, mode):
        self.order(messages.SetMode, mode=mode)

    def steering(self, ticks=50):
        """In HEAD, the wires warm."""
        self.drive()
        self.mode("HEAD")
        self.drive(ticks)
        return self

    def following(self, pixel=(400.0, 200.0)):
        """In TRACK, on a point that a scripted camera reports at a pixel."""
        self.steering()
        self.camera.target = (*pixel, 1.0, True)
        self.drive(2)
        self.mode("TRACK")
        self.drive()
        return self

    def tracking(self):
        """In TRACK, on the likeliest candidate, which rests in the middle, in focus."""
        self.steering(2)
        self.until(lambda s: s.seen.spots, pose=right(27.0, -12.0))
        self.order(messages.Pick, u=self.session.seen.spots[0][0], v=self.session.seen.spots[0][1])
        self.until(lambda s: s.seen.target is not None)
        self.mode("TRACK")
        self.until(lambda s: s.focus not in ("", "searching"))
        return self

    def measured(self):
        """With a finding: the tracked target, measured by its outline."""
        self.order(messages.Measure)
        self.until(lambda s: s.findings)
        return self


class SilentLoop:
    """A stand-in for the control loop: keeps orders, and sends what a test gives it."""

    def __init__(self, settings, received):
        self.settings, self.received, self.orders = settings, received, []

    def start(self):
        self.received(text("hello", view={}, known=SMALL.to_dict(), cone=28.0, planes=[]))

    def order(self, message):
        self.orders.append(message)

    def kinds(self):
        """Names of the messages that were ordered."""
        return [type(order).__name__ for order in self.orders]

    def stop(self):
        pass
