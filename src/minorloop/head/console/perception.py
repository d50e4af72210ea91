"""The eyes and the ear of the seat: what the camera and the probe tell, tick by tick.

Candidates come from frames under switched lights, a picked point is followed on the unrolled wall,
the focus is swept on it, its outline gives place and size, and echoes are kept until they are
fitted elsewhere. All of it knows the angles as measured, the calibration, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.errors import MinorloopError, SignalError
from minorloop.head.console.camera_protocol import CameraReport, CameraRequest
from minorloop.head.console.finder import Finder
from minorloop.head.console.plant import PlantView, Where, angles_of, reading_of
from minorloop.head.console.scan_echoes import ScanEchoes
from minorloop.head.procedures.centre import Centring
from minorloop.head.procedures.extract import Acquisition, nearest
from minorloop.head.procedures.focus import Focusing
from minorloop.head.procedures.meter import LIMITS, Metering
from minorloop.head.procedures.values import (
    ALL_LIGHTS,
    Procedure,
    Reading,
    Request,
    Tip,
    apply_to_tip,
)
from minorloop.head.vision.calibrated_camera import Image
from minorloop.head.vision.defects import Findings
from minorloop.head.vision.tracking import TRACKED, TrackState

_FRAME = 0.04
"""Seconds from one frame of the camera to the next."""
_SNAP = 18.0

Later = Callable[[Callable[[], Any]], Callable[[], Any | None]]
"""Does something in time, and gives what asks for the result; None while there is none."""


def at_once(work: Callable[[], Any]) -> Callable[[], Any | None]:
    """Do it now; for tests."""
    result = work()
    return lambda: result


@dataclass(eq=False)
class _Work:
    """A procedure that has the camera, and what is done with its last state."""

    procedure: Procedure[Any]
    state: Any
    after: Callable[[Any], None]


class Perception:
    """Camera, probe, and what is made of them.

    Parameters
    ----------
    tip : Tip
    view : PlantView
        Their calibration.
    later : Later
        Where longer computations are done.
    """

    def __init__(self, tip: Tip, view: PlantView, later: Later = at_once) -> None:
        self._tip, self._view, self._later = tip, view, later
        self._finder = Finder(view)
        self._centring = Centring(calibration=view)
        self._metering = Metering(calibration=view, seconds=math.inf)
        self._meter = self._metering.begin()
        self._track: TrackState | None = None
        self._picked: tuple[float, float] | None = None
        self._seen, self._score = False, 0.0
        self._work: _Work | None = None
        self._lit = True
        self._pending: list[tuple[Callable[[], Any | None], Callable[[Any], None]]] = []
        self._ticks = 0
        self._queue: list[Callable[[], None]] = []
        self._sounding: ScanEchoes | None = None
        self._where: Where = (0.0, 0.0, 0.0, 0.0)
        self._events: list[dict[str, Any]] = []
        self.image: Image | None = None
        self.jobs: list[dict[str, Any]] = []
        self.wishes: dict[str, Callable[..., None]] = {
            "pick": self._pick,
            "find": self._find,
            "focus": self._focus,
            "free": self._free,
            "sharpen": self._sharpen,
            "extract": self._extract,
            "sound": self._sound,
            "shoot": self._shoot,
            "heard": self._heard,
            "dry": self._dry,
        }

    def tick(self, look: CameraRequest) -> CameraReport:
        """Take a frame and make of it what is wished; ``image`` is what there is to show."""
        self._where = look.where
        self._tip.stand(look.stance)
        for name, numbers in look.wishes:
            self._do(self.wishes[name], numbers)
        if self._queue and self._work is None:  # what came while the camera was in use
            self._queue.pop(0)()
        idle = self._work is None and self._sounding is None
        if idle and self._finder.at_rest_somewhere_new(look.where):
            self._find()
        lit, free, fresh = self._lit, self._work is None, True
        reading = self._reading(self._tip.frame().image)
        if lit:
            self.image = reading.image
            fresh = self._picked is None
            if not fresh:  # the frame that it was picked in is no news of it
                self._do(self._begin, [reading])
        target = self._follow(reading, lit and fresh and free)
        if self._work is not None:
            self._go_on(self._work, reading)
        else:
            self._meter, request = self._metering.step(self._meter, reading)
            apply_to_tip(self._tip, request)
        self._take_results()
        events, self._events = self._events, []
        self._ticks += 1
        return CameraReport(
            number=look.number,
            target=target,
            spots=self._finder.shown(look.where),
            events=events,
        )

    def _reading(self, image: Image | None = None) -> Reading:
        return reading_of(self._where, t=self._ticks * _FRAME, image=image)

    def forget(self) -> None:
        """Forget what was seen, as at the start."""
        self._finder, self._track, self._seen = Finder(self._view), None, False
        self._pending, self._events = [], []

    def _do(self, work: Callable[..., None], given: list[Any]) -> None:
        try:
            work(*given)
        except MinorloopError as error:
            self._tell("notice", text=str(error))

    def _tell(self, what: str, **content: Any) -> None:
        self._events.append({"what": what, **content})

    # --- the point that is followed

    def _pick(self, u: float, v: float) -> None:
        """Follow what is at a pixel, from the next frame under all lights."""
        self._picked = (u, v)

    def _begin(self, reading: Reading) -> None:
        """Follow what was picked; what is known there is taken for meant."""
        (u, v), self._picked = self._picked or (0.0, 0.0), None
        assert reading.image is not None
        pixel = np.array([u, v])
        for spot in self._finder.shown(self._where):
            if math.hypot(spot[0] - u, spot[1] - v) < max(_SNAP, 0.7 * spot[2]):
                pixel = np.array(spot[:2])
                break
        track, self._track = self._centring.pick(reading.image, pixel, reading)
        self._seen, self._score = True, track.score
        self._tell("picked")

    def _follow(self, reading: Reading, usable: bool) -> tuple[float, float, float, bool] | None:
        if self._track is None:
            return None
        pixel = self._view.eye(self._where).pixel(self._track.place, *angles_of(self._where))
        if usable:  # under other lights, or out of focus, the angles tell
            now, self._track = self._centring.follow(self._track, reading, reading.image)
            self._seen = now.verdict == TRACKED
            if math.isfinite(now.score):
                self._score = now.score
            pixel = now.pixel
        if not np.isfinite(pixel).all():
            return (0.0, 0.0, 0.0, False)
        return float(pixel[0]), float(pixel[1]), self._score, self._seen

    # --- procedures that have the camera

    def _use(self, procedure: Procedure[Any], state: Any, after: Callable[[Any], None]) -> None:
        """Give the camera to a procedure, from the frame of this tick on."""
        self._work = _Work(procedure, state, after)
        self._go_on(self._work, self._reading())

    def _go_on(self, work: _Work, reading: Reading) -> None:
        """One step of what has the camera."""
        work.state, request = work.procedure.step(work.state, reading)
        if request.lights is not None:
            self._lit = all(request.lights)
        apply_to_tip(self._tip, request)
        if work.state.done:
            self._work = None
            work.after(work.state)

    def _break_off(self) -> None:
        """Take the camera back, as it was metered."""
        if self._work is not None:
            self._work, self._lit = None, True
            exposure = LIMITS.exposure, self._meter.gain
            apply_to_tip(self._tip, Request(lights=ALL_LIGHTS, exposure=exposure))

    def _by_wall(self, yes: bool) -> None:
        """Whether the focus follows the wall ahead, or stays where somebody has set it."""
        self._metering = replace(self._metering, focusing=yes)

    def _focus(self, distance: float) -> None:
        self._by_wall(False)
        self._tip.focus_at(distance)

    def _free(self) -> None:
        self._by_wall(True)

    def _sharpen(self) -> None:
        """Sweep the focus on the point that is followed."""
        if self._track is None:
            return
        if self._work is not None:
            self._queue.append(self._sharpen)
            return
        pixel = self._view.eye(self._where).pixel(self._track.place, *angles_of(self._where))
        focusing = Focusing(lens=self._view.lens)
        guess = self._metering.ahead(self._reading())
        self._use(focusing, focusing.begin(pixel, guess), self._sharpened)

    def _sharpened(self, state: Any) -> None:
        self._by_wall(False)
        self._tell("focused", distance=float(state.found.distance), verdict=state.found.verdict)

    # --- defects

    def _find(self) -> None:
        """Look for defects in what is in view."""
        self._acquired(self._found)

    def _found(self, findings: Findings) -> None:
        self._finder.add(findings)
        self._tell("found", count=len(findings.holes), verdict=findings.verdict)

    def _extract(self) -> None:
        """Place and size of what is followed, by its outline."""
        if self._track is None:
            self._tell("extracted", hole=None, verdict="there is nothing that is tracked")
            return
        self._acquired(self._extracted)

    def _extracted(self, findings: Findings) -> None:
        self._finder.add(findings)
        assert self._track is not None
        # Where there is none, the weaker look from farther away still has an outline.
        hole = nearest(findings.holes, self._track.place, self._view.radius)
        hole = hole or self._finder.near(self._track.place)
        if hole is None:
            reason = "nothing round is seen under the target; go nearer, or pick what is framed"
            if findings.verdict != "good":
                reason = f"the frames cannot be used: {findings.verdict}"
            self._tell("extracted", hole=None, verdict=reason)
            return
        told = {
            "phi": float(hole.place[0]),
            "z": float(hole.place[1]),
            "diameter": float(hole.diameter),
            "evidence": float(hole.evidence),
        }
        self._tell("extracted", hole=told, verdict=hole.kind)

    def _acquired(self, then: Callable[[Findings], None]) -> None:
        """Take five frames, then look for defects in them."""
        if self._work is not None:
            self._queue.append(lambda: self._acquired(then))
            return
        where = self._where
        self._finder.looked(where)

        def after(state: Any) -> None:
            looks = state.looks
            self._pending.append((self._later(lambda: self._finder.find(looks, where)), then))

        acquisition = Acquisition()
        self._use(acquisition, acquisition.begin(self._meter.gain), after)

    def _take_results(self) -> None:
        waiting = []
        for ask, then in self._pending:
            result = ask()
            if result is None:
                waiting.append((ask, then))
            else:
                then(result)
        self._pending = waiting

    # --- echoes

    def _sound(self, finding: float, phi: float, z: float, diameter: float) -> None:
        """Begin a scan about a finding."""
        self._break_off()
        self._tip.flood(True)
        self._sounding = ScanEchoes(self._view, int(finding), (phi, z), diameter)

    def _shoot(self, pan: float, tilt: float) -> None:
        """Echoes of one point of the scan, which were wanted at a pan and tilt in degrees."""
        if self._sounding is None:
            return
        wanted = (math.radians(pan), math.radians(tilt))
        verdict = self._sounding.add(self._tip, self._where, wanted)
        self._tell("burst", count=len(self._sounding.bursts), verdict=verdict)

    def _heard(self) -> None:
        """End a scan: its echoes are fitted elsewhere."""
        if self._sounding is None:
            raise SignalError("no scan is on")
        self.jobs.append(self._sounding.job(self._where))
        self._dry()

    def _dry(self) -> None:
        self._tip.flood(False)
        self._sounding = None
