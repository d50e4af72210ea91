"""One tick of the console: operator's input, modes, plant, and results of the camera.

A `Session` owns the plant and all state that lasts from tick to tick. It uses no clock, process,
network or picture; `minorloop_head.console.loop` supplies those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraLink, CameraReport, CameraRequest
from minorloop_head.console.head_pose import Quaternion, aimed, jumped
from minorloop_head.console.latency import Latency
from minorloop_head.console.mark import OUT_OF_REACH, ended, reaches, servoed, unmeasured
from minorloop_head.console.messages import Pair, ReportedFinding
from minorloop_head.console.modes import TeleopConfig, TeleopState, TickInput, advance, held
from minorloop_head.console.plant import reading_at
from minorloop_head.console.reports import NumberedFindings, Outgoing, introduction, pair
from minorloop_head.console.scanning import ProbeRun, Scanning
from minorloop_head.console.units import Position, to_shown
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import AXES
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import Centring
from minorloop_head.procedures.seen_angles import unseen
from minorloop_head.procedures.values import Plant, Reading, passed
from minorloop_head.vision.video import NO_NEW_PICTURE

_LOST_TICKS = 3
"""Ticks without a reading after which a sensor counts as lost."""
_UNSEEN_TICKS = 50
"""Ticks without angles by the camera after which the head holds: 2 s, longer than a search under
switched lights."""
_STALE_TICKS = 8
"""Ticks after which a report of the camera is too old for steering."""
_LONGEST_MEMORY = 40
"""Most extrema of a wire's memory in messages to the pages."""


class _HeadTracker(Protocol):
    """A tracker of the operator's head."""

    spacing: float
    """Seconds between the newest poses; NaN if not known."""

    def read(self, now: float) -> tuple[Quaternion | None, float, str]:
        """Return the newest pose, its age in seconds, and the message on a pose that is too old."""


@dataclass(eq=False)
class Session:
    """The console, tick by tick."""

    plant: Plant
    view: HeadCalibration
    """Calibration of its camera and probe."""
    control: HeadControl
    """Control of its head."""
    camera: CameraLink
    config: TeleopConfig = field(default_factory=TeleopConfig)
    tracker: _HeadTracker | None = None
    """Source of the pose of the operator's head instead of the page."""
    no_probe: str = ""
    """Reason why no depth can be measured; empty with a probe."""
    sensors: bool = True
    """Whether the joints have sensors; without them the reports of the camera give the angles."""

    def __post_init__(self) -> None:
        self.state = TeleopState()
        self._out = Outgoing()
        self.events, self.notice = self._out.events, self._out.notice
        self._found = NumberedFindings(self.view.radius, self._out)
        self.reading = np.zeros(4)
        self._known = np.zeros(4)  # the reading, and the last one of a sensor that is lost
        self.ticks = self._lost_ticks = 0
        self._plant_time: float | None = None
        self._plant_began = self._late = 0.0  # by the count of ticks; seconds that it lacks
        self._resting = True  # cold, until the first mode
        self._no_pictures = self._pictured = False
        self.danger = ""  # why the plant may not be safe
        self._control = self.control.begin()
        self._stop: Pair | None = None
        self._drive: messages.Drive | None = None
        self._drive_at = -math.inf
        self._request: messages.Mode | None = None
        self._jumped = False  # whether a pose of the page did
        self.latency = Latency(self.interval)
        self.seen = CameraReport(number=0, zero=self.sensors)
        self._joints: Pair | None = None
        self._scanning = Scanning(self.view, self.control, self.interval, self._out)
        self._centred_at: float | None = None
        self._marking, self._touched, self._score = False, False, 1.0
        self.focus: str = ""
        self._centring = Centring(calibration=self.view, interval=self.interval)

    @property
    def interval(self) -> float:
        """Length of a tick in seconds."""
        return self.plant.tick

    @property
    def findings(self) -> list[ReportedFinding]:
        """All findings."""
        return self._found.all

    @property
    def scan(self) -> ProbeRun | None:
        """The running scan or sweep."""
        return self._scanning.scan

    def receive(self, message: messages.ToLoop, at: float) -> None:
        """Handle a message of the server, received at a time in seconds."""
        if isinstance(message, messages.Drive):
            self._jumped = self._jumped or _jumped(self._drive, message)
            self._drive, self._drive_at = message, at
        elif isinstance(message, messages.SetMode):
            self._request = message.mode
        elif isinstance(message, messages.ControlsTaken):
            self.hold("you have the controls; press Head (1) to look round")
        elif isinstance(message, messages.Release):
            self.hold("the controls are free; take them to continue")
        elif isinstance(message, messages.Pick):
            self._out.command("pick", message.u, message.v)
        elif isinstance(message, messages.Measure):
            self._measure()
        elif isinstance(message, messages.Find):
            self._out.command("find")
        elif isinstance(message, messages.Sharpen):
            self._out.command("sharpen")
        elif isinstance(message, messages.Mark):
            self._begin_mark()
        elif isinstance(message, messages.Scan):
            self._begin_scan(message.finding)
        elif isinstance(message, messages.Sweep):
            self._begin_sweep()
        elif isinstance(message, messages.DepthFitted):
            self._found.add_depth(message)
        elif isinstance(message, messages.SweepFitted):
            self._found.swept(message.finds, self._t)
        elif isinstance(message, messages.Focus):
            self.focus = "by hand"
            self._out.command("focus", message.distance)
        elif isinstance(message, messages.Forget):
            self._forget(message.finding)
        elif isinstance(message, messages.KnownFindings):
            self._found.restore(message.findings)

    def hold(self, reason: str) -> None:
        """Hold, and drop the last input of the operator.

        A plant that may not be safe has priority over any other reason.
        """
        reason = f"{self.danger}; press Head (1) when it is back" if self.danger else reason
        before, self.state = self.state.mode, held(self.state, reason)
        self._stop_after(before)
        self._drive, self._drive_at, self._request = None, -math.inf, None

    def rest(self, reason: str) -> None:
        """Hold with cold wires, after the plant was made safe; the next mode ends it."""
        self.hold(reason)
        self.state = TeleopState("HOLD", reason)
        self._resting, self._stop = True, None

    def tick(self, now: float) -> FloatArray:
        """Do one tick at a time in seconds; return the four inputs that were applied."""
        for report in self.camera.reports():
            self._handle_report(report)
        self._watch_pictures()
        self._watch_mark()
        before = self.state.mode
        self._request = self._scanning.back_first(self._request)
        inputs = self._tick_input(now)  # a scan that has ended holds
        self.state = advance(self.config, self.state, inputs, self.interval)
        self._stop_after(before)
        self._react(before)
        self._watch_latency(before, inputs)
        self._request = None
        currents = self._currents()
        u = np.concatenate([currents, self.state.rates])
        self.reading = np.array(self.plant.exchange(u), dtype=np.float64)
        self._see_angles()
        self._watch_sensors()
        self.ticks += 1
        self._read_time()
        commands, self._out.commands = self._out.commands, []
        self.camera.send(
            CameraRequest(
                number=self.ticks,
                t=now,
                position=self.position(),
                stance=self.plant.stance(),
                commands=commands,
                cold=self._resting,
                holding=self.state.mode == "HOLD",
                centring=self.state.mode == "TRACK",
            )
        )
        return u

    def _currents(self) -> FloatArray:
        """Return the currents of the wires in this tick; zero while they rest."""
        self._resting = self._resting and self.state.mode == "HOLD"
        read = np.degrees(self.reading[:2])
        if self._resting:
            self._control = self.control.begin(read, np.zeros(2))
            return np.zeros(2)
        wanted = self.state.command if self._stop is None else self._stop
        currents, self._control = self.control.step(
            self._control, self.view.joints(wanted), read, t=self._t
        )
        return currents

    def _stop_after(self, before: str) -> None:
        """In HOLD, stop at the angles of the head: they may be ten degrees behind its command.

        The command stays for the next mode. The angles are those of the model, on which a single
        reading has little effect.
        """
        if self.state.mode != "HOLD":
            self._stop = None
        elif before != "HOLD":
            read = np.radians(self.control.modelled(self._control))
            pan, tilt = self.view.line_of_sight(read).tolist()
            self._stop = pan, tilt

    def report(self, now: float, *, late: float = 0.0, safe_at: float = 0.0) -> bytes:
        """Return the `LoopState` of this tick; ``safe_at`` is when the plant was last made safe."""
        drive, axes = self._drive, self._control.axes
        command = to_shown((*(self._stop or self.state.command), *self.state.rates))
        joints = (self.reading if self.sensors else self._known)[:2]
        read = to_shown((*self.view.line_of_sight(joints), *self._known[2:]))
        pan, tilt = (_memory(axis.estimate.wire.tracker) for axis in axes)
        return messages.encode(
            messages.LoopState(
                seq=self.ticks,
                t=now,
                mode=self.state.mode,
                reason=self.state.reason,
                command=pair(command[:2]),
                angle=pair(read[:2]),
                place=pair(read[2:]),
                rates=pair(command[2:]),
                current=pair((axis.applied for axis in axes), 4),
                temperature=pair(self._temperatures(), 1),
                memory=(pan, tilt),
                wire=pair((axis.estimate.angle for axis in axes), 2),
                trouble=self._trouble(),
                clutch=drive is not None and drive.clutch,
                received=None if drive is None else messages.DriveReceipt(seq=drive.seq, t=drive.t),
                late=round(1e3 * late, 2),
                safe_at=safe_at,
                target=self._target(),
                centred=self._centred(),
                focus=self.focus,
                scan=self._scanning.progress(),
                spots=[_rounded(spot) for spot in self.seen.spots],
            )
        )

    def introduction(self) -> bytes:
        """Return the `Hello` of this loop."""
        wires = [axis.estimate.wire.tracker.model for axis in self._control.axes]
        return introduction(self.interval, self.view, self.config, wires, self.no_probe)

    def position(self) -> Position:
        """Return the last known position of the head, in rad and m."""
        pan, tilt = self.view.line_of_sight(self._known[:2]).tolist()
        return pan, tilt, float(self._known[2]), float(self._known[3])

    def _tick_input(self, now: float) -> TickInput:
        servo, scan, tracked = self._servo(), self._scan_tick(), self._tracked(now)
        drive, blind = self._drive, self._blind()
        request = None if self.danger else self._request
        if drive is None:
            return TickInput(request=request, blind=blind, servo=servo, scan=scan)
        age = max(now - self._drive_at, 0.0)
        head: dict[str, Any] = {"pose": drive.pose, "pose_age": age + drive.age}
        if self._jumped:
            head = {"pose": None, "lost": "the pose of the operator's head jumped"}
        self._jumped = False
        return TickInput(
            request=request,
            **(head if tracked is None else tracked),
            link_age=age,
            stick=drive.stick,
            clutch=drive.clutch,
            blind=blind,
            servo=servo,
            scan=scan,
        )

    def _tracked(self, now: float) -> dict[str, Any] | None:
        """Return the pose by the tracker, as fields of `TickInput`; None without a tracker."""
        if self.tracker is None:
            return None
        pose, age, problem = self.tracker.read(now)
        return {"pose": pose, "pose_age": age, "lost": problem}

    def _react(self, before: str) -> None:
        """Send a new mode to the camera; end a scan whose mode has ended."""
        mode = self.state.mode
        if mode == "HEAD" and before != "HEAD":
            self.focus = ""
            self._out.command("autofocus")
        if self.scan is not None and mode != "SCAN":
            self._scanning.leave()

    def _watch_latency(self, before: str, inputs: TickInput) -> None:
        """Measure the delay of the head in HEAD, and report it when HEAD ends after a while."""
        drive, state = self._drive, self.state
        if state.mode == before == "HEAD" and drive is not None:
            own = drive.age if self.tracker is None else 0.5 * self.tracker.spacing
            waited = inputs.pose_age - drive.age if self.tracker is None else inputs.pose_age
            self.latency.note(
                tracker=own,
                waited=waited + self.interval,
                aimed=aimed(self.config.gaze, state.gaze, state.gaze.turned),
                command=state.command,
                angle=self.position()[:2],
                picture=(self.ticks - self.seen.number) * self.interval,
            )
        elif before == "HEAD":
            if state.mode == "HOLD" and (words := self.latency.words):
                self.notice(words)
            self.latency.clear()

    # --- reports of the camera

    def _watch_pictures(self) -> None:
        """Check that pictures come; forget the last report when they fail."""
        missing = (self.ticks - self.seen.number) * self.interval >= self.config.pictures
        if missing:
            self.seen = CameraReport(number=self.seen.number, zero=self.seen.zero)
        elif self._no_pictures and self._pictured:
            self.notice("pictures come again; press a mode to continue")
        self._no_pictures = missing
        self._pictured = self._pictured or self.seen.number > 0

    def _blind(self) -> str:
        """Return the reason of missing pictures; empty if there are pictures."""
        if self._no_pictures:
            said = self.camera.problem or (
                f"no picture came from the camera for {self.config.pictures:g} s, which a longer "
                "--timeout of the console allows"
            )
            if NO_NEW_PICTURE in said:
                least = math.ceil(1.0 / self.config.pictures)
                said += (
                    f"; it must give at least {least} pictures a second, or fewer with a longer "
                    "--timeout of the console"
                )
            return f"{said}; press a mode when pictures come again"
        if not self.seen.zero:
            return f"{unseen(self.seen.unseen)}; press a mode when they are known"
        return ""

    def _see_angles(self) -> None:
        """Use the angles of joints without sensors from the newest report, once.

        A restarted camera process does not know the cold head.
        """
        if self.sensors:
            return
        joints, self._joints = self._joints, None
        self.reading[:2] = np.nan if joints is None else np.radians(joints)
        if not self.seen.zero and not self._resting:
            self.rest(
                "the camera was started anew and does not know the angles, so that the wires cool; "
                "press a mode when the head stands still"
            )

    def _handle_report(self, report: CameraReport) -> None:
        self.seen, self._joints = report, report.joints or self._joints
        for event in report.events:
            kind = event["what"]
            if kind == "notice":
                self.notice(event["text"])
            elif kind == "picked":
                self._centred_at, self.focus = None, ""
                self._stop_mark("another point was picked")
            elif kind == "unpicked":
                self._stop_mark("another point was picked")
                self.notice(event["text"])
            elif kind == "focused":
                self.focus = str(event["verdict"])
                self._out.send(
                    messages.FocusResult(distance=event["distance"], verdict=event["verdict"])
                )
            elif kind == "extracted":
                self._add_hole(event)
            elif kind == "burst":
                self._scanning.fired()
            elif kind == "unscanned" and self.state.mode == "SCAN":
                self.hold(f"there are no echoes: {event['text']}; press a mode to continue")
            elif kind == "touched":
                self._touched = True
            elif kind == "marked":
                self._report_mark(event)
            elif kind == "not extended":
                self._end_mark(event["text"])
            elif kind == "found":
                self._out.send(
                    messages.SearchResult(count=event["count"], verdict=event["verdict"])
                )
        self._watch_centre()

    # --- the micro-tool

    def _begin_mark(self) -> None:
        """Turn the tool to the target, which the last picture or the one before it shows."""
        target = self.seen.target
        if self.view.tool is None:
            self.notice("this head has no micro-tool; nothing can be marked with it")
        elif self._marking:
            self.notice("the tool is on its way to the point already; press Hold to stop it")
        elif self.state.mode != "TRACK" or target is None:
            self.notice("no target is tracked; pick a point and press Track, then Mark")
        elif not reaches(self.view, target[:2], self._reading()):
            self.notice(OUT_OF_REACH)
        else:
            self._marking, self._touched, self._score = True, False, target[2]
            self._out.command("mark")
            self.notice("the tool is turned to the point")

    def _watch_mark(self) -> None:
        """Stop a touch whose mode has ended."""
        if self.state.mode != "TRACK":
            self._stop_mark(self.state.reason or "another mode was chosen; press Track, then Mark")

    def _report_mark(self, event: dict[str, Any]) -> None:
        """Report the end of a touch, and the problem if it failed."""
        trouble = "" if self._touched else self._trouble()
        said = ended(event["verdict"], event["off"], self._score)
        self._end_mark(f"{said} ({trouble})" if trouble else said)

    def _stop_mark(self, why: str) -> None:
        self._end_mark(unmeasured(why) if self._touched else f"the mark was stopped: {why}")

    def _end_mark(self, sentence: str) -> None:
        if self._marking:
            self._marking = False
            self._out.command("end_mark")
            self.notice(sentence)

    def _visible(self) -> Pair | None:
        """Return the pixel of the target; None if it is not recognised now."""
        target = self.seen.target
        return target[:2] if target is not None and target[3] and self._fresh() else None

    def _fresh(self) -> bool:
        return self.ticks - self.seen.number < _STALE_TICKS

    def _servo(self) -> Pair | None:
        """Return rates of pan and tilt that centre the target, in rad/s."""
        target, now = self._visible(), self._reading()
        if target is None:
            return None
        # The place of a mark is brought to the point of the tool, not to the middle.
        pixel = servoed(self.view, target, now) if self._marking else np.asarray(target)
        step = self._centring.turn(self.state.command, pixel, now)
        return float(step.rates[0]), float(step.rates[1])

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
            self._out.command("sharpen")

    def _centred(self) -> bool:
        """Return whether the target has been in the middle for long enough."""
        since = self._centred_at
        return since is not None and passed(since, self._t, self._centring.still)

    @property
    def _t(self) -> float:
        """Seconds since the first tick, by the plant, or by the ticks if the plant has no time."""
        return self.ticks * self.interval + self._late

    def _read_time(self) -> None:
        """Read the time of the plant: a late loop has skipped ticks.

        A restarted plant counts from 0.
        """
        now, before = self.plant.time, self._plant_time
        self._plant_time = now
        if now is None:
            return
        if before is None or now < before:
            self._plant_began = self._t - now
        self._late = max(self._late, self._plant_began + now - self.ticks * self.interval)

    def _reading(self) -> Reading:
        return reading_at(self.position(), t=self._t)

    def _watch_sensors(self) -> None:
        lost = bool(np.isnan(self.reading).any())
        most = _LOST_TICKS if self.sensors else _UNSEEN_TICKS
        self._lost_ticks = self._lost_ticks + 1 if lost else 0
        self._known = np.where(np.isnan(self.reading), self._known, self.reading)
        if self._lost_ticks >= most and self.state.mode != "HOLD":
            said = "a sensor of the catheter was lost; it holds until the sensor is back"
            if not self.sensors:
                said = f"{unseen(self.seen.unseen)}; press a mode when it does again"
            self.hold(said)

    # --- findings

    def _measure(self) -> None:
        """Start measuring the target by its outline."""
        target = self.seen.target
        if self.state.mode != "TRACK" or target is None or not target[3]:
            self.notice("no target is tracked; pick a point and press Track, then Measure")
            return
        self._out.command("extract")

    def _add_hole(self, event: dict[str, Any]) -> None:
        hole = event["hole"]
        if hole is None:
            self.notice(f"this cannot be measured: {event['verdict']}")
            return
        self._found.extracted(hole, self._t)

    def _begin_scan(self, number: int | None) -> None:
        if self.no_probe:
            self.notice(self.no_probe)
            return
        wanted = self._found.wanted(number)
        if isinstance(wanted, str):
            self.notice(wanted)
        elif self._scanning.begin_scan(wanted, self.state.command, self.position()):
            self._request = "SCAN"

    def _begin_sweep(self) -> None:
        if self.no_probe:
            self.notice(self.no_probe)
        elif self._scanning.begin_sweep(self.state.command, self.position()):
            self._request = "SCAN"

    def _scan_tick(self) -> tuple[Pair, Pair] | None:
        """Return the angles and rates of scan or sweep."""
        found = self._scanning.tick(self.state.mode, self.state.command, self.position())
        if found.hold:
            self.hold(found.hold)
        self._request = found.mode or self._request
        return found.requested

    def _forget(self, number: int) -> None:
        """Delete a finding, and stop a scan of it."""
        if self.scan is not None and self.scan.number == number and self.state.mode == "SCAN":
            self.hold(f"finding {number} was deleted; press a mode to continue")
        self._found.forget(number)

    def send_findings(self) -> None:
        """Send all findings to the pages."""
        self._found.send()

    def _target(self) -> tuple[float, float, float, float] | None:
        if self.seen.target is None:
            return None
        u, v, score, visible = self.seen.target
        return round(u, 2), round(v, 2), round(score, 2), float(visible and self._fresh())

    def _temperatures(self) -> list[float]:
        pairs = zip(self.control.axes, self._control.axes, strict=True)
        return [guard.temperature(state) for guard, state in pairs]

    def _trouble(self) -> str:
        """Return the present problems, the gravest first."""
        if self.danger:
            return self.danger
        if self._no_pictures and self.camera.problem:
            return self.camera.problem
        for name, axis in zip(AXES, self._control.axes, strict=True):
            if axis.fault:
                return f"the sensor of {name} is {axis.fault}"
            if axis.unreachable is not None:
                return f"{name}: {axis.unreachable}"
        return ""


def _jumped(before: messages.Drive | None, drive: messages.Drive) -> bool:
    """Return whether the pose of a page jumped, by the clock of the page."""
    if before is None or before.pose is None or drive.pose is None or drive.clutch:
        return False
    return jumped(before.pose, drive.pose, drive.t - drive.age - (before.t - before.age))


def _memory(tracker: Any) -> list[float]:
    return [round(x, 5) for x in tracker.memory.extrema][-_LONGEST_MEMORY:]


def _rounded(spot: messages.Spot) -> messages.Spot:
    u, v, diameter, evidence = spot
    return round(u, 1), round(v, 1), round(diameter, 1), round(evidence, 1)
