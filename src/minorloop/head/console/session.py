"""One tick of the seat: what was heard, what the head does, what the eyes told.

A `Session` owns the plant and everything that is remembered from tick to tick. It knows no clock,
no process, no network and no picture: `minorloop.head.console.loop` gives it those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.console import messages
from minorloop.head.console.camera_protocol import CameraLink, CameraReport, CameraRequest, Wish
from minorloop.head.console.head_pose import Pair
from minorloop.head.console.modes import TeleopConfig, TeleopState, TickInput, advance, held
from minorloop.head.console.plant import MIDDLE, PlantView, Where, reading_of
from minorloop.head.console.reports import (
    ReportedFinding,
    camera_finding,
    introduction,
    rounded,
    sounded,
)
from minorloop.head.console.scan import ConsoleScan, begin_scan, scanned
from minorloop.head.control.head import HeadControl
from minorloop.head.procedures.centre import Centring
from minorloop.head.procedures.values import Plant, Reading, passed
from minorloop.head.vision.servo import Cone

_BLIND_TICKS = 3
_STALE_TICKS = 8
_LONGEST_MEMORY = 40


@dataclass(eq=False)
class Session:
    """The seat, tick by tick.

    Parameters
    ----------
    plant : Plant
    view : PlantView
        Its camera and probe.
    control : HeadControl
        Of its head.
    sight : CameraLink
        Its eyes.
    seat : TeleopConfig
    """

    plant: Plant
    view: PlantView
    control: HeadControl
    sight: CameraLink
    seat: TeleopConfig = field(default_factory=TeleopConfig)

    def __post_init__(self) -> None:
        self.state = TeleopState()
        self.findings: list[ReportedFinding] = []
        self._numbered = 0
        self.reading = np.zeros(4)
        self._known = np.zeros(4)
        self.ticks = self._blind = 0
        self._resting = self._dark = False
        self._control = self.control.begin(self.reading[:2], np.zeros(2))
        self._drive: messages.Drive | None = None
        self._drive_at = -math.inf
        self._request: Any = None
        self.seen = CameraReport(number=0)
        self.scan: ConsoleScan | None = None
        self._wishes: list[Wish] = []
        self._centred_at: float | None = None
        self.focus: str = ""
        self._centring = Centring(
            calibration=self.view,
            interval=self.interval,
            cone=Cone(math.radians(self.seat.gaze.cone)),
            rate_limit=math.radians(self.seat.gaze.heating),
        )
        self.events: list[bytes] = []

    @property
    def interval(self) -> float:
        """Length of a tick in seconds."""
        return self.plant.tick

    def hear(self, message: messages.Inner, at: float) -> None:
        """Take in an order of the pilot, or what echoes told, that came at a time in seconds."""
        if isinstance(message, messages.Drive):
            self._drive, self._drive_at = message, at
        elif isinstance(message, messages.Mode):
            self._request = message.mode
        elif isinstance(message, messages.Taken):
            self.hold("you have the controls; press Head (1) to look round")
        elif isinstance(message, messages.Release):
            self.hold("the controls are free; take them to go on")
        elif isinstance(message, messages.Pick):
            self._wish("pick", message.u, message.v)
        elif isinstance(message, messages.Measure):
            self._measure()
        elif isinstance(message, messages.Find):
            self._wish("find")
        elif isinstance(message, messages.Sharpen):
            self._wish("sharpen")
        elif isinstance(message, messages.Scan):
            self._begin_scan(message.finding)
        elif isinstance(message, messages.Sounded):
            self._sounded(message)
        elif isinstance(message, messages.Focus):
            self.focus = "by hand"
            self._wish("focus", message.distance)
        elif isinstance(message, messages.Forget):
            self._forget(message.finding)
        elif isinstance(message, messages.Known):
            self._restore(message.findings)

    def hold(self, reason: str) -> None:
        """Hold, and forget what the operator's page said last."""
        self.state = held(self.state, reason)
        self._drive, self._drive_at, self._request = None, -math.inf, None

    def rest(self, reason: str) -> None:
        """Hold with cold wires, since the plant was made safe; the next mode ends it."""
        self.hold(reason)
        self.state = TeleopState("HOLD", reason)
        self._resting = True

    def tick(self, now: float) -> FloatArray:
        """One tick at a time in seconds; gives the four inputs that were applied."""
        for seen in self.sight.seen():
            self._take(seen)
        self._watch_pictures()
        before = self.state.mode
        heard = self._heard(now)  # a scan that has ended holds
        self.state = advance(self.seat, self.state, heard, self.interval)
        self._changed(before)
        self._request = None
        currents = self._currents()
        u = np.concatenate([currents, self.state.rates])
        self.reading = np.asarray(self.plant.exchange(u), dtype=np.float64)
        self._watch_sensors()
        self.ticks += 1
        wishes, self._wishes = self._wishes, []
        self.sight.look(
            CameraRequest(
                number=self.ticks,
                t=now,
                where=self.where(),
                stance=self.plant.stance(),
                wishes=wishes,
            )
        )
        return u

    def _currents(self) -> FloatArray:
        """What the wires get in this tick: nothing while they rest."""
        self._resting = self._resting and self.state.mode == "HOLD"
        if self._resting:
            self._control = self.control.begin(self.reading[:2], np.zeros(2))
            return np.zeros(2)
        reference = np.add(self.state.command, MIDDLE)
        currents, self._control = self.control.step(
            self._control, reference, self.reading[:2], t=self.ticks * self.interval
        )
        return currents

    def report(self, now: float, *, late: float = 0.0, safe_at: float = 0.0) -> bytes:
        """What the pages are told of this tick, and when the plant was last made safe."""
        drive = self._drive
        return messages.encode(
            "state",
            seq=self.ticks,
            t=now,
            mode=self.state.mode,
            reason=self.state.reason,
            command=rounded(self.state.command),
            angle=rounded(self.reading[:2] - MIDDLE),
            place=rounded(self._known[2:]),
            rates=rounded(self.state.rates),
            current=rounded([axis.applied for axis in self._control.axes], 4),
            temperature=rounded(self._temperatures(), 1),
            memory=[_memory(axis.estimate.wire.tracker) for axis in self._control.axes],
            wire=[round(axis.estimate.wire.angle, 2) for axis in self._control.axes],
            trouble=self._trouble(),
            clutch=drive is not None and drive.clutch,
            heard=None if drive is None else {"seq": drive.seq, "t": drive.t},
            late=round(1e3 * late, 2),
            safe_at=safe_at,
            target=self._told_target(),
            centred=self._centred(),
            focus=self.focus,
            scan=self._told_scan(),
            spots=[rounded(spot, 1) for spot in self.seen.spots],
        )

    def introduction(self) -> bytes:
        """What the pages are told once: camera, cone, and the planes of the wires."""
        wires = [axis.estimate.wire.tracker.model for axis in self._control.axes]
        return introduction(self.interval, self.view, self.seat, wires)

    def where(self) -> Where:
        """Pan, tilt, advance and roll as they were last known, in degrees and mm."""
        pan, tilt, advanced, roll = self._known.tolist()
        return pan - MIDDLE, tilt - MIDDLE, advanced, roll

    def _heard(self, now: float) -> TickInput:
        servo, scan = self._servo(), self._scan_tick()
        drive, there = self._drive, not self._dark
        if drive is None:
            return TickInput(request=self._request, pictures=there, servo=servo, scan=scan)
        age = max(now - self._drive_at, 0.0)
        return TickInput(
            request=self._request,
            pose=drive.pose,
            pose_age=age + drive.age,
            link_age=age,
            stick=drive.stick,
            clutch=drive.clutch,
            pictures=there,
            servo=servo,
            scan=scan,
        )

    def _changed(self, before: str) -> None:
        """What a new mode means for the eyes and for a scan."""
        mode = self.state.mode
        if mode == "HEAD" and before != "HEAD":
            self.focus = ""
            self._wish("free")
        if self.scan is not None and mode != "SCAN":
            if self.scan.stage != "done":
                self.notice("the scan was broken off; press Depth to begin it again")
            self._wish("dry")
            self.scan = None

    def _wish(self, name: str, *numbers: float) -> None:
        self._wishes.append((name, [float(number) for number in numbers]))

    # --- what the eyes told

    def _watch_pictures(self) -> None:
        """Whether pictures come; what was seen before they failed to come is forgotten."""
        dark = (self.ticks - self.seen.number) * self.interval >= self.seat.pictures
        if dark:
            self.seen = CameraReport(number=self.seen.number)
        elif self._dark:
            self.notice("pictures come again; press a mode to go on")
        self._dark = dark

    def _take(self, seen: CameraReport) -> None:
        self.seen = seen
        for event in seen.events:
            kind = event["what"]
            if kind == "notice":
                self.notice(event["text"])
            elif kind == "picked":
                self._centred_at, self.focus = None, ""
            elif kind == "focused":
                self.focus = str(event["verdict"])
                self.events.append(messages.encode("focused", **event))
            elif kind == "extracted":
                self._extracted(event)
            elif kind == "burst" and self.scan is not None:
                self.scan = replace(self.scan, heard=True)
            elif kind == "found":
                self.events.append(messages.encode("found", **event))
        self._watch_centre()

    def _fresh(self) -> bool:
        return self.ticks - self.seen.number < _STALE_TICKS

    def _servo(self) -> Pair | None:
        """Rates of pan and tilt in degrees per second that centre the target."""
        target = self.seen.target
        if target is None or not target[3] or not self._fresh():
            return None
        step = self._centring.turn(np.radians(self.state.command), target[:2], self._reading())
        rates = np.degrees(step.rates)
        return float(rates[0]), float(rates[1])

    def _watch_centre(self) -> None:
        """Focus once the target has come to rest in the middle."""
        target, lens = self.seen.target, self.view.lens
        if self.state.mode != "TRACK" or target is None or not target[3]:
            self._centred_at = None
            return
        if math.dist(target[:2], lens.centre) >= self._centring.in_middle:
            self._centred_at = None
        elif self._centred_at is None:
            self._centred_at = self._t
        if self._centred() and not self.focus:
            self.focus = "searching"
            self._wish("sharpen")

    def _centred(self) -> bool:
        """Whether the target has been in the middle for long enough."""
        since = self._centred_at
        return since is not None and passed(since, self._t, self._centring.still)

    @property
    def _t(self) -> float:
        return self.ticks * self.interval

    def _reading(self) -> Reading:
        return reading_of(self.where(), t=self._t)

    def _watch_sensors(self) -> None:
        lost = bool(np.isnan(self.reading).any())
        self._blind = self._blind + 1 if lost else 0
        self._known = np.where(np.isnan(self.reading), self._known, self.reading)
        if self._blind >= _BLIND_TICKS and self.state.mode != "HOLD":
            self.hold("a sensor of the catheter was lost; it holds until the sensor is back")

    # --- findings

    def _measure(self) -> None:
        """Have the outline of the target looked for."""
        target = self.seen.target
        if self.state.mode != "TRACK" or target is None or not target[3]:
            self.notice("there is nothing that is tracked to measure; pick a point, press Track")
            return
        self._wish("extract")

    def _extracted(self, event: dict[str, Any]) -> None:
        hole = event["hole"]
        if hole is None:
            self.notice(f"this cannot be measured: {event['verdict']}")
            return
        self._numbered += 1  # never used again: a late fit must not meet another finding
        t = round(self.ticks * self.interval, 2)
        self.findings.append(camera_finding(self._numbered, t, hole, self.view.radius))
        self.tell_findings()

    def _begin_scan(self, number: int | None) -> None:
        wanted = [f for f in self.findings if number is None or f.number == number]
        if not wanted:
            sentence = "there is nothing to scan; measure a finding first"
            if number is not None and self.findings:
                known = ", ".join(str(f.number) for f in self.findings)
                sentence = f"there is no finding {number}; there is {known}"
            self.notice(sentence)
            return
        found = wanted[-1]
        self.scan = begin_scan(
            found.number,
            (math.radians(found.phi), 1e-3 * found.z),
            1e-3 * found.diameter,
            self.view,
            (*self.state.command, *self.where()[2:]),
        )
        self._request = "SCAN"

    def _scan_tick(self) -> tuple[Pair, Pair] | None:
        """What the scan asks for; it moves on only while its mode is on."""
        if self.scan is None or self.scan.stage == "done":
            return None
        if self.state.mode == "SCAN":
            command = self.state.command
            self.scan, asked = scanned(self.scan, self.view, self.where(), command, self.interval)
            self._wishes += asked.wishes
            if self.scan.stage == "done":
                sentence = "the scan is done; press a mode to go on"
                if not len(self.scan.state.targets):
                    sentence = "the probe could not be brought over the finding; press Depth again"
                self.hold(sentence)
                self.events.append(messages.encode("scanned", finding=self.scan.number))
                return None
            return asked.angles, asked.rates
        return self.state.command, (0.0, 0.0)

    def _sounded(self, message: messages.Sounded) -> None:
        """Put what the echoes told with its finding."""
        for k, finding in enumerate(self.findings):
            if finding.number == message.finding:
                self.findings[k] = sounded(finding, message.told, self.view.radius)
        self.tell_findings()

    def _restore(self, findings: list[dict[str, Any]]) -> None:
        """Take over the findings of a loop that has ended."""
        if self._numbered == 0:
            self.findings = [msgspec.convert(each, ReportedFinding) for each in findings]
            self._numbered = max((each.number for each in self.findings), default=0)

    def _forget(self, number: int) -> None:
        """Drop a finding, and a scan of it."""
        self.findings = [f for f in self.findings if f.number != number]
        if self.scan is not None and self.scan.number == number and self.state.mode == "SCAN":
            self.hold(f"finding {number} was dropped; press a mode to go on")
        self.tell_findings()

    def tell_findings(self) -> None:
        """Tell the pages all findings."""
        self.events.append(messages.encode("findings", findings=[vars(f) for f in self.findings]))

    def notice(self, text: str) -> None:
        """Tell the pages something in a sentence."""
        self.events.append(messages.encode("notice", text=text))

    def _told_target(self) -> list[float] | None:
        if self.seen.target is None:
            return None
        u, v, score, seen = self.seen.target
        return [round(u, 2), round(v, 2), round(score, 2), float(seen and self._fresh())]

    def _told_scan(self) -> dict[str, Any] | None:
        if self.scan is None:
            return None
        return {
            "finding": self.scan.number,
            "stage": self.scan.stage,
            "progress": round(self.scan.progress, 3),
        }

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
