"""One tick of the seat: what was heard, what the head does, what is seen.

A `Session` owns the plant and everything that is remembered from tick to tick. It knows no clock,
no process and no network: `minorloop.teleop.loop` gives it those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.control.head import HeadControl
from minorloop.lab.actuator import Frame
from minorloop.teleop import messages
from minorloop.teleop.modes import Heard, Seat, SeatState, advance, held
from minorloop.teleop.plant import MIDDLE, Plant, View
from minorloop.teleop.sight import Sight, Spot, Target

_SPOTS_EVERY = 5
_BLIND_TICKS = 3
_LONGEST_MEMORY = 40


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A defect that was measured.

    Parameters
    ----------
    number : int
        From 1.
    t : float
        When, in seconds since the session began.
    phi, z : float
        Where on the wall: angle about the axis in degrees, distance along it in mm.
    diameter : float
        In mm.
    depth : float, optional
        In mm; None where no ultrasonic sensor measured it.
    distance : float
        From the lens, in mm.
    bright : bool
        Whether it is brighter than the wall.
    contrast : float
        Grey levels between it and the wall.
    """

    number: int
    t: float
    phi: float
    z: float
    diameter: float
    depth: float | None
    distance: float
    bright: bool
    contrast: float


@dataclass(eq=False)
class Session:
    """The seat, tick by tick.

    Parameters
    ----------
    plant : Plant
    view : View
        Its camera.
    control : HeadControl
        Of its head.
    sight : Sight
    seat : Seat
    """

    plant: Plant
    view: View
    control: HeadControl
    sight: Sight
    seat: Seat = field(default_factory=Seat)

    def __post_init__(self) -> None:
        self.state = SeatState()
        self.findings: list[Finding] = []
        self.target: Target | None = None
        self.spots: list[Spot] = []
        self.seen: Frame | None = None
        self.reading = np.zeros(4)
        self._known = np.zeros(4)
        self.ticks = self._blind = 0
        self._control = self.control.begin(self.reading[:2], np.zeros(2))
        self._drive: messages.Drive | None = None
        self._drive_at = -math.inf
        self._request: Any = None
        self.events: list[bytes] = []

    @property
    def interval(self) -> float:
        """Length of a tick in seconds."""
        return self.plant.tick

    def hear(self, message: messages.Order, at: float) -> None:
        """Take in an order of the pilot that came at a time in seconds."""
        if isinstance(message, messages.Drive):
            self._drive, self._drive_at = message, at
        elif isinstance(message, messages.Mode):
            self._request = message.mode
        elif isinstance(message, messages.Release):
            self.hold("the controls are free; take them to go on")
        elif isinstance(message, messages.Pick):
            self._pick(message.u, message.v)
        elif isinstance(message, messages.Measure):
            self._measure()
        elif isinstance(message, messages.Focus):
            self.plant.focus_at(message.distance)
        elif isinstance(message, messages.Forget):
            self.findings = [f for f in self.findings if f.number != message.finding]
            self.tell_findings()

    def hold(self, reason: str) -> None:
        """Hold, and forget what the operator's page said last."""
        self.state = held(self.state, reason)
        self._drive, self._drive_at, self._request = None, -math.inf, None

    def tick(self, now: float) -> FloatArray:
        """One tick at a time in seconds; gives the four inputs that were applied."""
        self.state = advance(self.seat, self.state, self._heard(now), self.interval)
        self._request = None
        reference = np.add(self.state.command, MIDDLE)
        currents, self._control = self.control.step(
            self._control, reference, self.reading[:2], t=self.ticks * self.interval
        )
        u = np.concatenate([currents, self.state.rates])
        self.reading = np.asarray(self.plant.exchange(u), dtype=np.float64)
        self._watch_sensors()
        self.seen = self.plant.frame()
        self.ticks += 1
        self._look()
        return u

    def report(self, now: float, *, late: float = 0.0) -> bytes:
        """What the pages are told of this tick."""
        drive = self._drive
        return messages.encode(
            "state",
            seq=self.ticks,
            t=now,
            mode=self.state.mode,
            reason=self.state.reason,
            command=_rounded(self.state.command),
            angle=_rounded(self.reading[:2] - MIDDLE),
            place=_rounded(self._known[2:]),
            rates=_rounded(self.state.rates),
            current=_rounded([axis.applied for axis in self._control.axes], 4),
            temperature=_rounded(self._temperatures(), 1),
            memory=[_memory(axis.estimate.wire.tracker) for axis in self._control.axes],
            wire=[round(axis.estimate.wire.angle, 2) for axis in self._control.axes],
            trouble=self._trouble(),
            clutch=drive is not None and drive.clutch,
            heard=None if drive is None else {"seq": drive.seq, "t": drive.t},
            late=round(1e3 * late, 2),
            target=self._told_target(),
            spots=[[round(x, 1) for x in (s.u, s.v, s.diameter, s.contrast)] for s in self.spots],
        )

    def introduction(self) -> bytes:
        """What the pages are told once: camera, cone, and the planes of the wires."""
        wires = [axis.estimate.wire.tracker.model for axis in self._control.axes]
        return messages.encode(
            "hello",
            interval=self.interval,
            view={
                "width": self.view.width,
                "height": self.view.height,
                "focal": self.view.focal,
                "lever": self.view.lever,
                "radius": self.view.radius,
            },
            cone=self.seat.gaze.cone,
            middle=MIDDLE,
            stick=[self.seat.stick.advance, self.seat.stick.roll],
            planes=[
                {"levels": wire.levels.tolist(), "weights": _rounded_rows(wire.weights)}
                for wire in wires
            ],
        )

    def where(self) -> tuple[float, float, float, float]:
        """Pan, tilt, advance and roll as they were last known, in degrees and mm."""
        pan, tilt, advanced, roll = self._known.tolist()
        return pan - MIDDLE, tilt - MIDDLE, advanced, roll

    def _heard(self, now: float) -> Heard:
        servo = self._servo()
        drive = self._drive
        if drive is None:
            return Heard(request=self._request, servo=servo)
        age = max(now - self._drive_at, 0.0)
        return Heard(
            request=self._request,
            pose=drive.pose,
            pose_age=age + drive.age,
            link_age=age,
            stick=drive.stick,
            clutch=drive.clutch,
            servo=servo,
        )

    def _servo(self) -> tuple[float, float] | None:
        if self.target is None or not self.target.seen:
            return None
        pan, tilt, *_ = self.where()
        return self.sight.rates(self.target, pan, tilt)

    def _look(self) -> None:
        """Follow the target, and look for spots now and then."""
        assert self.seen is not None
        if self.target is not None:
            self.target = self.sight.follow(self.target, self.seen.image)
        if self.ticks % _SPOTS_EVERY == 0:
            self.spots = self.sight.spots(self.seen.image)

    def _watch_sensors(self) -> None:
        lost = bool(np.isnan(self.reading).any())
        self._blind = self._blind + 1 if lost else 0
        self._known = np.where(np.isnan(self.reading), self._known, self.reading)
        if self._blind >= _BLIND_TICKS and self.state.mode != "HOLD":
            self.hold("a sensor of the catheter was lost; it holds until the sensor is back")

    def _pick(self, u: float, v: float) -> None:
        if self.seen is not None:
            self.target = self.sight.begin(self.seen.image, u, v)

    def _measure(self) -> None:
        """Keep what is under the target as a finding."""
        near = self._spot_at_target()
        if near is None:
            self.notice("there is no spot under the target to measure; pick one first")
            return
        pan, tilt, advanced, roll = self.where()
        place = self.sight.place(near.u, near.v, pan, tilt)
        number = 1 + max((f.number for f in self.findings), default=0)
        self.findings.append(
            Finding(
                number=number,
                t=round(self.ticks * self.interval, 2),
                phi=round((math.degrees(place.phi) + roll) % 360.0, 2),
                z=round(1e3 * place.z + advanced, 3),
                diameter=round(1e3 * near.diameter * place.scale, 3),
                depth=None,
                distance=round(1e3 * place.far, 2),
                bright=near.contrast > 0,
                contrast=round(abs(near.contrast), 1),
            )
        )
        self.tell_findings()

    def _spot_at_target(self) -> Spot | None:
        if self.target is None or not self.target.seen or self.seen is None:
            return None
        at = self.target
        near = min(
            self.sight.spots(self.seen.image),
            key=lambda s: math.hypot(s.u - at.u, s.v - at.v),
            default=None,
        )
        if near is None or math.hypot(near.u - at.u, near.v - at.v) > 0.03 * self.view.width:
            return None
        return near

    def tell_findings(self) -> None:
        """Tell the pages all findings."""
        self.events.append(messages.encode("findings", findings=[vars(f) for f in self.findings]))

    def notice(self, text: str) -> None:
        """Tell the pages something in a sentence."""
        self.events.append(messages.encode("notice", text=text))

    def _told_target(self) -> list[float] | None:
        if self.target is None:
            return None
        u, v, score = self.target.u, self.target.v, self.target.score
        return [round(u, 2), round(v, 2), round(score, 2), float(self.target.seen)]

    def _temperatures(self) -> list[float]:
        pairs = zip(self.control.axes, self._control.axes, strict=True)
        return [guard.temperature(state) for guard, state in pairs]

    def _trouble(self) -> str:
        for name, axis in zip(("pan", "tilt"), self._control.axes, strict=True):
            if axis.fault:
                return f"the sensor of {name} is {axis.fault}"
            if axis.unreachable is not None:
                return f"{name}: {axis.unreachable}"
        return ""


def _memory(tracker: Any) -> list[float]:
    return [round(x, 5) for x in tracker.memory.extrema][-_LONGEST_MEMORY:]


def _rounded(values: Any, digits: int = 3) -> list[float | None]:
    return [round(float(x), digits) if math.isfinite(x) else None for x in values]


def _rounded_rows(rows: FloatArray) -> list[list[float]]:
    return [[round(float(x), 4) for x in row[: k + 1]] for k, row in enumerate(rows)]
