"""Processing of camera and probe, tick by tick.

Candidates come from frames under switched lights. A picked point is tracked on the unrolled wall,
the focus is swept on it, and its outline gives place and size. Echoes are kept until they are
fitted in another process. Everything here uses the measured angles and the calibration only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError, SignalError
from minorloop_head.console.camera_protocol import FEW_PICTURES, CameraReport, CameraRequest
from minorloop_head.console.finder import Finder
from minorloop_head.console.mark import marking
from minorloop_head.console.plant import reading_at
from minorloop_head.console.scan_echoes import ScanEchoes, SweepEchoes
from minorloop_head.console.units import Position
from minorloop_head.geometry import wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import Centring
from minorloop_head.procedures.focus import FocusPeak, focus
from minorloop_head.procedures.mark import Touch, seen_mark
from minorloop_head.procedures.meter import LIMITS, Light, acquisition, meter, wall_ahead
from minorloop_head.procedures.seen_angles import SeenAngles
from minorloop_head.procedures.trace import nearest
from minorloop_head.procedures.values import (
    ALL_LIGHTS,
    Procedure,
    Reading,
    Request,
    Running,
    Tip,
    ToolTip,
    apply_to_tip,
    passed,
)
from minorloop_head.sources import Frame
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.defects import Findings
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.tracking import TRACKED, TrackState

_POLL = 0.04
"""Seconds between two checks for the result of a computation."""
_MOST_QUEUED = 4
"""Most commands that wait for the camera."""
_ASTRAY, _SETTLING = 2.0, 2.0
"""Largest factor by which the first shown picture is brighter or darker than metered, and seconds
after which a picture is shown anyway: that of a camera that sets its exposure itself."""
_SNAP = 18.0
"""Pixels from a candidate within which a pick takes the candidate."""

Later: TypeAlias = Callable[[Callable[[], Any]], Callable[[], Any | None]]
"""Starts a computation; returns a function that returns the result, or None before its end."""


def at_once(work: Callable[[], Any]) -> Callable[[], Any | None]:
    """Compute immediately; for tests."""
    result = work()
    return lambda: result


def _pick_refusal(picked: tuple[float, float], pixel: FloatArray, error: MinorloopError) -> str:
    """Return the message on a picked pixel that cannot be tracked, at the tried pixel."""
    moved = ", by the middle of the outline there," if math.dist(picked, pixel) > 1.0 else ""
    u, v = picked
    return f"pixel ({u:.0f}, {v:.0f}) was not picked{moved} and there is no target now: {error}"


class Perception:
    """Camera, probe, and the processing of their data.

    ``view``: their calibration; ``later``: runs longer computations; ``seen``: reads the angles of
    joints without sensors from the pictures.
    """

    def __init__(
        self,
        tip: Tip,
        view: HeadCalibration,
        later: Later = at_once,
        seen: SeenAngles | None = None,
    ) -> None:
        self._tip, self.view, self._later = tip, view, later
        self._newest: Callable[[], Frame | None] | None = getattr(tip, "newest", None)
        self._seen_angles = seen
        self._finder = Finder(view)
        self._centring = Centring(calibration=view)
        self._light = Light()
        self._metering = Running(meter(view, self._light, math.inf), self._carry_out)
        self._track: TrackState | None = None
        self._picked: tuple[float, float] | None = None
        self._wanted: tuple[float, float] | None = None
        self._visible, self._score = False, 0.0
        self._work: tuple[Running[Any], Callable[[Any], None]] | None = None
        self._all_lights = True
        self._pending: list[tuple[Callable[[], Any | None], Callable[[Any], None]]] = []
        self._marking = marking(view)
        self._mark: tuple[Running[Touch], Touch] | None = None
        self._queue: list[Callable[[], None]] = []
        self._echoes: ScanEchoes | None = None
        self._sweep: SweepEchoes | None = None
        self._position: Position = (0.0, 0.0, 0.0, 0.0)
        self._now = 0.0
        self._events: list[dict[str, Any]] = []
        self.image: Image | None = None
        self.shown, self.taken = False, 0.0
        self._settled, self._began = False, math.nan
        self.jobs: list[dict[str, Any]] = []
        self.commands: dict[str, Callable[..., None]] = {
            "pick": self._pick,
            "find": self._find,
            "focus": self._focus,
            "autofocus": self._autofocus,
            "sharpen": self._sharpen,
            "extract": self._extract,
            "mark": self._begin_mark,
            "end_mark": self._end_mark,
            "begin_scan": self._begin_scan,
            "fire": self._fire,
            "finish_scan": self._finish_scan,
            "end_scan": self._end_scan,
            "begin_sweep": self._begin_sweep,
            "fire_on": self._fire_on,
            "end_sweep": self._end_sweep,
        }

    def tick(self, request: CameraRequest) -> CameraReport:
        """Carry out the commands, process a frame and report.

        ``image`` is the picture to show, ``taken`` its time, and ``shown`` whether it is of this
        tick. While a camera only has pictures under the former lights, the report uses the angles.
        """
        self._position, joints = request.position, None
        self._tip.move_to(request.stance)
        if self._echoes is not None:
            self._echoes.read(request.t, request.position)
        if self._sweep is not None:
            self._sweep.read(request.t, request.position)
        self._now = request.t
        self._finder.note(request.position)
        for name, numbers in request.commands:
            self._try(self.commands[name], numbers)
        if self._queue and not self._busy:  # commands that came while the camera was in use
            self._queue.pop(0)()
        if (
            not self._busy
            and not self._is_firing
            and (self._seen_angles is None or self._seen_angles.known)
            and self._finder.at_rest
            and not self._finder.has_searched(request.position)
        ):
            self._find()
        self.shown = False
        frame = self._frame(request)
        # A simulated camera draws its picture now.
        self.taken = request.t if self._newest is None or frame is None else frame.t
        if self._seen_angles is not None and frame is not None and self._all_lights:
            joints = self._joints(self._seen_angles, frame, request.cold)
        if self._echoes is not None and self._all_lights:
            self._use_picture(self._echoes, None if frame is None else frame.image)
        centred = self._track is not None and request.centring
        self._light.place = self._track.place if centred and self._track is not None else None
        target = self._follow(self._reading(), False) if frame is None else self._seen(frame.image)
        self._take_results()
        events, self._events = self._events, []
        return CameraReport(
            number=request.number,
            target=target,
            spots=self._finder.shown(self._position),
            events=events,
            joints=joints,
            unseen="" if self._seen_angles is None else self._seen_angles.why,
            zero=self._seen_angles is None or self._seen_angles.known,
        )

    def _joints(self, seen: SeenAngles, frame: Frame, cold: bool) -> tuple[float, float] | None:
        """Return the angles by a picture, and set its position to them."""
        read = seen.read(frame, cold=cold)
        if not np.isfinite(read).all():
            return None
        pan, tilt = self.view.line_of_sight(np.radians(read)).tolist()
        self._position = pan, tilt, *self._position[2:]
        return float(read[0]), float(read[1])

    def _seen(self, image: Image) -> tuple[float, float, float, bool] | None:
        """Process an image; return the tracked point in it."""
        lit, free, fresh = self._all_lights, self._work is None, True
        reading = self._reading(image)
        if lit:
            self._began = self._now if math.isnan(self._began) else self._began
            late = passed(self._began, self._now, _SETTLING)
            off = abs(math.log(max(float(image.mean()), 1.0) / LIMITS.grey))
            self._settled = self._settled or late or off < math.log(_ASTRAY)
            self.image, self.shown = image, self._settled
            fresh = self._picked is None
            if not fresh:  # the track starts at this frame
                self._try(self._begin_track, [reading])
        target = self._follow(reading, lit and fresh and free)
        if self._work is not None:
            self._continue(reading)
        else:
            self._metering.advance(reading)
        return target

    def _frame(self, request: CameraRequest) -> Frame | None:
        """Return the frame of a tick; None while it may show the former lights.

        A scan between bursts needs no frames, nor does a head that holds before a searched view, or
        rests there and tracks nothing: a simulated camera then draws only some of them to show. A
        real camera is read in each tick, so that a failure is noticed.
        """
        if self._newest is not None:
            return self._newest()
        used = self._work is not None or self._picked is not None
        used = used or (self._echoes is not None and self._echoes.waiting)
        still = request.holding or (self._track is None and self._finder.at_rest)
        known = still and self._finder.has_searched(self._position)
        few = not used and (known or self._is_firing)
        return None if few and request.number % FEW_PICTURES else self._tip.frame()

    def _reading(self, image: Image | None = None) -> Reading:
        return reading_at(self._position, t=self._now, image=image)

    def reset(self) -> None:
        """Forget candidates, track and events."""
        self._finder, self._track, self._visible = Finder(self.view), None, False
        self._settled, self._began = False, math.nan
        self._pending, self._events = [], []

    def _try(self, work: Callable[..., None], given: list[Any]) -> None:
        try:
            work(*given)
        except MinorloopError as error:
            self._report("notice", text=str(error))

    def _report(self, what: str, **content: Any) -> None:
        self._events.append({"what": what, **content})

    # --- the tracked point

    def _pick(self, u: float, v: float) -> None:
        """Track the point at a pixel, from the next frame under all lights."""
        self._picked = self._wanted = (u, v)

    def _begin_track(self, reading: Reading) -> None:
        """Track the candidate near the picked point, or the outline about it once it is known.

        The former point is given up: the tool may not touch it.
        """
        assert self._picked is not None
        assert reading.image is not None
        picked, self._picked = self._picked, None
        self._track, self._visible, self._mark = None, False, None
        self._report("picked")
        for spot in self._finder.shown(self._position):
            if math.dist(spot[:2], picked) < max(_SNAP, 0.7 * spot[2]):
                self._track_from(reading, picked, np.array(spot[:2]))
                return
        frame = LitFrame(reading.image, *reading.angles.tolist())
        frames = self._finder.frames_with(frame, self._position)
        # This takes the time of many frames.
        outline = self._later(lambda: self._outlined(frames, picked, reading))
        self._pending.append((outline, partial(self._track_from, reading, picked)))

    def _outlined(
        self, frames: tuple[LitFrame, ...], picked: tuple[float, float], reading: Reading
    ) -> FloatArray:
        try:
            return self._centring.outlined(frames, picked, reading)
        except MinorloopError:
            return np.array(picked)

    def _track_from(self, reading: Reading, picked: tuple[float, float], pixel: FloatArray) -> None:
        """Track the point at a pixel in the picture of a reading, unless another one was picked."""
        if picked is not self._wanted:
            return
        assert reading.image is not None
        try:
            track, self._track = self._centring.pick(reading.image, pixel, reading)
        except MinorloopError as error:
            self._report("unpicked", text=_pick_refusal(picked, pixel, error))
            return
        self._visible, self._score = True, track.score

    def _follow(self, reading: Reading, usable: bool) -> tuple[float, float, float, bool] | None:
        """Return pixel, score and visibility of the tracked point."""
        if self._track is None:
            return None
        pixel = self._pixel_of(self._track)
        if self._mark is not None:
            image = reading.image if usable else None
            self._continue_mark(*self._mark, replace(reading, image=image))
            pixel = self._pixel_of(self._track)
        elif usable:  # under other lights, or out of focus, only the angles are used
            now, self._track = self._centring.follow(self._track, reading, reading.image)
            self._visible = now.verdict == TRACKED
            if math.isfinite(now.score):
                self._score = now.score
            pixel = now.pixel
        if not np.isfinite(pixel).all():
            return (0.0, 0.0, 0.0, False)
        return float(pixel[0]), float(pixel[1]), self._score, self._visible

    def _pixel_of(self, track: TrackState) -> Any:
        """Return the pixel of the tracked place by the measured angles."""
        camera = self.view.camera_at(self._position[2:])
        return camera.pixel(track.place, *self._position[:2])

    # --- procedures that use the camera

    def _use(self, procedure: Procedure[Any], after: Callable[[Any], None]) -> None:
        """Give the camera to a procedure, from the frame of this tick on; then use its result."""
        lit = Request(lights=ALL_LIGHTS, exposure=self._light.exposure)
        self._work = Running(procedure, self._carry_out, lit), after
        self._continue(self._reading())

    def _continue(self, reading: Reading) -> None:
        """Do one step of the procedure that uses the camera."""
        assert self._work is not None
        running, after = self._work
        running.advance(reading)
        if running.done:
            self._work = None
            after(running.result)

    def _carry_out(self, request: Request) -> None:
        if request.lights is not None:
            self._all_lights = all(request.lights)
        apply_to_tip(self._tip, request)

    def _abort(self) -> None:
        """End the procedure that uses the camera, and restore lights and exposure."""
        if self._work is not None:
            self._work[0].close()
            self._work = None

    def _focus(self, distance: float) -> None:
        self._light.focusing = False
        self._tip.focus_at(distance)

    def _autofocus(self) -> None:
        self._light.focusing = True

    def _sharpen(self) -> None:
        """Sweep the focus on the tracked point."""
        if self._track is None:
            return
        if self._work is not None:
            self._queue.append(self._sharpen)
            return
        guess = wall_ahead(self.view, self._reading())
        self._use(focus(self.view.lens, self._pixel_of(self._track), guess), self._use_focus)

    def _use_focus(self, found: FocusPeak) -> None:
        self._light.focusing = False
        self._report("focused", distance=float(found.distance), verdict=found.verdict)

    # --- the micro-tool

    def _begin_mark(self) -> None:
        """Touch the tracked point, and look for the mark."""
        if self._track is not None:
            home = self._track.home
            touch = Touch(place=home, tracked=home, track=self._track)

            def carry_out(request: Request) -> None:
                apply_to_tip(self._tip, Request(extension=request.extension))

            withdrawn = Request(extension=0.0)
            self._mark = Running(self._marking.resume(touch), carry_out, withdrawn), touch

    def _end_mark(self) -> None:
        """Withdraw the tool at any stage."""
        self._mark = None
        apply_to_tip(self._tip, Request(extension=0.0))

    def _continue_mark(self, running: Running[Touch], touch: Touch, reading: Reading) -> None:
        """Do one step of a touch, which tracks the point too."""
        extension, touching = self._tip.tool_state() if isinstance(self._tip, ToolTip) else (0, 0)
        reading = replace(reading, extension=extension, touching=bool(touching))
        before = touch.met
        try:
            running.advance(reading)
        except MinorloopError as error:
            self._mark = None
            self._report("not extended", text=str(error))
            return
        assert touch.track is not None
        self._track, self._visible = touch.track, touch.track.missed == 0
        if touch.met is not before:
            self._report("touched")
        if running.done:
            self._mark = None
            self._report("marked", verdict=touch.verdict, off=self._mark_off(touch, reading))

    def _mark_off(self, touch: Touch, reading: Reading) -> float | None:
        """Return the distance of the mark from the picked point; None if it is not seen."""
        if touch.mark is None or reading.image is None:
            return None
        assert touch.before is not None
        assert touch.met is not None
        assert touch.track is not None
        # An edge of a pit that is off by a pixel is no mark: it is brighter as much as darker.
        after = reading.image, reading.angles + touch.track.turn
        if seen_mark(self.view, reading.place, touch.met, after, touch.before) is not None:
            return None
        return float(wall_distance(touch.mark, touch.place, self.view.radius))

    # --- defects

    def _find(self) -> None:
        """Search the view for defects."""
        self._acquire(self._use_findings)

    def _use_findings(self, findings: Findings) -> None:
        self._finder.add(findings)
        self._report("found", count=len(findings.holes), verdict=findings.verdict)

    def _extract(self) -> None:
        """Measure place and size of the tracked point by its outline."""
        if self._track is None:
            self._report("extracted", hole=None, verdict="no target is tracked")
            return
        self._acquire(self._use_outline)

    def _use_outline(self, findings: Findings) -> None:
        self._finder.add(findings)
        assert self._track is not None
        # Without an outline in these frames, use one of a view from farther away.
        hole = nearest(findings.holes, self._track.place, self.view.radius)
        hole = hole or self._finder.near(self._track.place)
        if hole is None:
            reason = "nothing round is seen at the target; go nearer, or pick a framed candidate"
            if findings.verdict != "good":
                reason = f"the frames cannot be used: {findings.verdict}"
            self._report("extracted", hole=None, verdict=reason)
            return
        measured = {
            "phi": float(hole.place[0]),
            "z": float(hole.place[1]),
            "diameter": float(hole.diameter),
            "evidence": float(hole.evidence),
        }
        self._report("extracted", hole=measured, verdict=hole.kind)

    def _acquire(self, then: Callable[[Findings], None]) -> None:
        """Take five frames under switched lights, then search them for defects.

        Only one acquisition is searched at a time, and few wait: a busy machine is slower than the
        camera, and each acquisition takes megabytes.
        """
        if self._busy:
            if len(self._queue) < _MOST_QUEUED:
                self._queue.append(lambda: self._acquire(then))
            else:
                self._report("notice", text="pictures are still searched; try it again later")
            return
        position = self._position
        self._finder.searched(position)

        def after(frames: tuple[LitFrame, ...]) -> None:
            self._finder.keep(frames)
            self._pending.append((self._later(lambda: self._finder.find(frames, position)), then))

        self._use(acquisition(self._light.gain), after)

    @property
    def _busy(self) -> bool:
        """Whether the camera is in use, or an acquisition is searched."""
        return self._work is not None or bool(self._pending) or self._mark is not None

    @property
    def _is_firing(self) -> bool:
        """Whether a scan or a sweep is on."""
        return self._echoes is not None or self._sweep is not None

    def finish(self) -> None:
        """Wait for longer computations, and take their results."""
        while self._pending:
            self._take_results()
            time.sleep(_POLL)

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

    def _begin_scan(self, finding: float, phi: float, z: float, diameter: float) -> None:
        """Begin a scan about a finding; the pipe is flooded once a picture of it was taken."""
        self._abort()
        self._echoes = ScanEchoes(self.view, int(finding), (phi, z), diameter)
        self._echoes.read(self._now, self._position)

    def _use_picture(self, echoes: ScanEchoes, image: Image | None) -> None:
        """Use a picture for the scan, and report a burst whose pose is known."""
        begun = echoes.begun
        if image is not None:
            echoes.see(image, self.taken)
            if not begun:
                self._flood(echoes)
        verdict = echoes.arrived(self._now)
        if verdict is not None:
            self._report("burst", count=len(echoes.bursts), verdict=verdict)

    def _flood(self, echoes: ScanEchoes) -> None:
        """Flood the pipe after the first picture of a scan; end the scan if that is not usable."""
        problem = "" if echoes.begun else echoes.why
        try:
            if not problem:
                self._tip.flood(True)
        except MinorloopError as error:
            problem = str(error)
        if problem:
            self._echoes = None
            self._report("unscanned", text=problem)

    def _fire(self, pan: float, tilt: float) -> None:
        """Fire at a point of the scan with the requested pan and tilt."""
        if self._echoes is None:
            self._report("unscanned", text="the camera was started anew")
            return
        self._echoes.fire(self._tip, self._now, self._position, (pan, tilt))

    def _finish_scan(self) -> None:
        """Send the echoes to the fit, and end the scan."""
        if self._echoes is None:
            raise SignalError("no scan is on")
        self.jobs.append(self._echoes.job())
        self._end_scan()

    def _end_scan(self) -> None:
        """Drain the pipe, and drop the echoes."""
        self._tip.flood(False)
        self._echoes = None

    # --- the echoes of a sweep

    def _begin_sweep(self, *area: float) -> None:
        """Flood the pipe for a sweep between two phi in radians and two z in metres."""
        self._abort()
        try:
            self._tip.flood(True)
        except MinorloopError as error:
            self._report("unscanned", text=str(error))
            return
        phi, phi_end, z, z_end = area
        self._sweep = SweepEchoes(self.view, (phi, phi_end), (z, z_end))
        self._sweep.read(self._now, self._position)

    def _fire_on(self) -> None:
        """Fire on the way along a line of the sweep."""
        if self._sweep is None:
            self._report("unscanned", text="the camera was started anew")
        else:
            self._sweep.fire(self._tip)

    def _end_sweep(self, whole: float) -> None:
        """Drain the pipe, and send the bursts to be mapped."""
        sweep, self._sweep = self._sweep, None
        if sweep is not None and sweep.bursts:
            self.jobs.append(sweep.job(whole=bool(whole)))
        elif sweep is not None:
            self._report("notice", text="the sweep has no bursts yet, so nothing is mapped")
        self._tip.flood(False)
