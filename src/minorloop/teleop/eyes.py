"""The eyes and the ear of the seat: what the camera and the probe tell, tick by tick.

Candidates come from frames under switched lights, a picked point is followed on the unrolled wall,
the focus is swept on it, its outline gives place and size, and echoes are kept until they are
fitted elsewhere. All of it knows the angles as measured, the calibration, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from minorloop.errors import MinorloopError, ParameterError, SignalError
from minorloop.teleop.finder import Finder, Findings, laid, nearest
from minorloop.teleop.loan import Loan
from minorloop.teleop.plant import Tip, View, Where, angles_of
from minorloop.teleop.sight import Look, Seen
from minorloop.teleop.sounding import Sounding
from minorloop.vision.defects import acquire
from minorloop.vision.eye import Image
from minorloop.vision.focus import autofocus
from minorloop.vision.jacobian import wall_depth
from minorloop.vision.tracking import TRACKED, Tracker, TrackState

EXPOSURE = 0.01
_GREY, _HASTE, _LEAST_GAIN, _MOST_GAIN = 95.0, 0.25, 0.1, 20.0
_NEAREST, _FARTHEST = 5e-3, 55e-3
_REFOCUS_TICKS = 5
_SNAP = 18.0
_SAME = 1.5e-3

Later = Callable[[Callable[[], Any]], Callable[[], Any | None]]
"""Does something in time, and gives what asks for the result; None while there is none."""


def at_once(work: Callable[[], Any]) -> Callable[[], Any | None]:
    """Do it now; for tests."""
    result = work()
    return lambda: result


class Eyes:
    """Camera, probe, and what is made of them.

    Parameters
    ----------
    tip : Tip
    view : View
        Their calibration.
    later : Later
        Where longer computations are done.
    """

    def __init__(self, tip: Tip, view: View, later: Later = at_once) -> None:
        self._tip, self._view, self._later = tip, view, later
        self._finder = Finder(view)
        self._tracker = Tracker(view.eye((0.0, 0.0, 0.0, 0.0)))
        self._track: TrackState | None = None
        self._picked: tuple[float, float] | None = None
        self._seen, self._score = False, 0.0
        self._loan: Loan | None = None
        self._after: Callable[[Any, list[tuple[float, float]]], None] | None = None
        self._pending: list[tuple[Callable[[], Any | None], Callable[[Any], None]]] = []
        self._gain, self._by_wall, self._ticks = 1.0, True, 0
        self._queue: list[Callable[[], None]] = []
        self._sounding: Sounding | None = None
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

    def tick(self, look: Look) -> Seen:
        """Take a frame and make of it what is wished; ``image`` is what there is to show."""
        self._where = look.where
        self._tip.stand(look.stance)
        for name, numbers in look.wishes:
            self._do(self.wishes[name], numbers)
        if self._queue and self._loan is None:  # what came while the camera was lent
            self._queue.pop(0)()
        idle = self._loan is None and self._sounding is None
        if idle and self._finder.at_rest_somewhere_new(look.where):
            self._find()
        if self._loan is None:
            self._meter_focus()
        lit, fresh = self._loan is None or self._loan.all_lit, True
        frame = self._tip.frame()
        if self._loan is not None:
            self._lend(frame)
        if lit:
            self.image = frame.image
            fresh = self._picked is None
            if not fresh:  # the frame that it was picked in is no news of it
                self._do(self._begin, [frame.image])
        target = self._follow(frame.image, lit and fresh and self._loan is None)
        if self._loan is None and lit:
            self._meter(frame.image)
        self._take_results()
        events, self._events = self._events, []
        self._ticks += 1
        return Seen(
            number=look.number,
            target=target,
            spots=self._finder.shown(look.where),
            events=events,
        )

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

    def _begin(self, image: Image) -> None:
        """Follow what was picked; what is known there is taken for meant."""
        (u, v), self._picked = self._picked or (0.0, 0.0), None
        eye, angles = self._view.eye(self._where), angles_of(self._where)
        pixel = np.array([u, v])
        for spot in self._finder.shown(self._where):
            if math.hypot(spot[0] - u, spot[1] - v) < max(_SNAP, 0.7 * spot[2]):
                pixel = np.array(spot[:2])
                break
        tracker = replace(self._tracker, eye=eye)
        track, self._track = tracker.begin(image, pixel, *angles)
        self._seen, self._score = True, track.score
        self._tell("picked")

    def _follow(self, image: Image, usable: bool) -> tuple[float, float, float, bool] | None:
        if self._track is None:
            return None
        eye, angles = self._view.eye(self._where), angles_of(self._where)
        pixel = eye.pixel(self._track.place, *angles)
        if usable:  # under other lights, or out of focus, the angles tell
            tracker = replace(self._tracker, eye=eye)
            now, self._track = tracker.step(self._track, image, *angles)
            self._seen = now.verdict == TRACKED
            if math.isfinite(now.score):
                self._score = now.score
            pixel = now.pixel
        if not np.isfinite(pixel).all():
            return (0.0, 0.0, 0.0, False)
        return float(pixel[0]), float(pixel[1]), self._score, self._seen

    # --- light and focus

    def _meter(self, image: Image) -> None:
        """Let the gain follow the brightness."""
        mean = max(float(image[::4, ::4].mean()), 1.0)
        gain = self._gain * (_GREY / mean) ** _HASTE
        self._gain = min(max(gain, _LEAST_GAIN), _MOST_GAIN)
        self._tip.expose(EXPOSURE, self._gain)

    def _meter_focus(self) -> None:
        """Focus on the wall ahead until somebody sets the focus."""
        if self._by_wall and self._ticks % _REFOCUS_TICKS == 0:
            self._tip.focus_at(self._ahead())

    def _ahead(self) -> float:
        eye = self._view.eye(self._where)
        try:
            far = wall_depth(eye, np.zeros(2), *angles_of(self._where))
        except ParameterError:
            far = _FARTHEST
        return float(np.clip(far, _NEAREST, _FARTHEST))

    def _focus(self, distance: float) -> None:
        self._by_wall = False
        self._tip.focus_at(distance)

    def _free(self) -> None:
        self._by_wall = True

    def _sharpen(self) -> None:
        """Sweep the focus on the point that is followed."""
        if self._track is None:
            return
        if self._loan is not None:
            self._queue.append(self._sharpen)
            return
        eye, guess = self._view.eye(self._where), self._ahead()
        pixel = eye.pixel(self._track.place, *angles_of(self._where))

        def work(camera: Loan) -> Any:
            return autofocus(camera, eye, pixel, guess, tries=7, wait=2, travel=8)

        def after(found: Any, _: Any) -> None:
            self._by_wall = False
            self._tell("focused", distance=float(found.distance), verdict=found.verdict)

        self._borrow(work, after)

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
        hole = nearest(findings.holes, self._track.place.tolist(), _SAME, self._view.radius)
        if hole is None:
            # The weaker look from farther away still has an outline.
            hole = self._finder.near(self._track.place.tolist(), _SAME)
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
        """Borrow the camera for five frames, then look for defects in them."""
        if self._loan is not None:
            self._queue.append(lambda: self._acquired(then))
            return
        where, gain = self._where, self._gain
        self._finder.looked(where)

        def after(looks: Any, poses: list[tuple[float, float]]) -> None:
            flat = laid(looks, poses)
            self._pending.append((self._later(lambda: self._finder.find(flat, where)), then))

        self._borrow(lambda loan: acquire(loan, loan.angles, exposure=EXPOSURE, gain=gain), after)

    def _borrow(
        self,
        work: Callable[[Loan], Any],
        after: Callable[[Any, list[tuple[float, float]]], None],
    ) -> None:
        self._loan, self._after = Loan(self._tip, work), after

    def _lend(self, frame: Any) -> None:
        loan, after = self._loan, self._after
        assert loan is not None
        assert after is not None
        loan.give(frame, self._where)
        if loan.done:
            loan.end()
            self._loan = None
            if loan.result is not None:
                after(loan.result, loan.poses)

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
        if self._loan is not None:
            self._loan.end()
            self._loan = None
        self._tip.flood(True)
        self._sounding = Sounding(self._view, int(finding), (phi, z), diameter)

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
