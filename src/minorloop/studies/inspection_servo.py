"""A point of the wall is brought to the middle of the image and held there by two wires.

Camera, tracker, servo and the wires' controller form one loop at 25 Hz, with the angle sensors
and without: then no reading of a joint goes anywhere. The head is brought near by the model of its
wires, and from there on the wires' controller gets what the picked piece of wall tells of the
head's angles. All pixel figures are at the scale of a 320 by 240 image.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.control.head import HeadControl, HeadState, head_control
from minorloop.control.sensing import SensorWatch
from minorloop.geometry import Mount, meet_wall, wall_point
from minorloop.studies.head_static import identify_head
from minorloop.twins.camera import Camera
from minorloop.twins.head import Head
from minorloop.twins.pipe import Bore, Pipe
from minorloop.twins.seeing import STRAIGHT, SeeingHead, Sway
from minorloop.vision.eye import Eye
from minorloop.vision.hold import Hold
from minorloop.vision.servo import Cone, Servo
from minorloop.vision.sighting import sighted_angles
from minorloop.vision.tracking import TRACKED, Tracker

TICK = 0.04
APPROACH = 14.0
"""Seconds in which the head is brought to where the servo takes over."""
SERVO, STEADY = 25.0, 8.0
"""Seconds of a run, and its steady part at the end."""
START_PX, SETTLED_PX = 43.0, 2.0
SWAY_SECONDS, SWAY_WAIT, HOLD_AFTER = 40.0, 12.0, 5.0
GAIN = 0.5
"""Of the servo, in 1/s."""
SOFT = 6.0
"""Error below which the servo's gain falls, in pixels of the camera: 3 of the smaller image."""
MOTION, MOTION_SECONDS = 10.0, 20.0
"""Fastest commanded motion that the tracker is tried under, in degrees a second; how long."""
GREY = 95.0
STROKE_SHARE = 0.93
"""Of a wire's identified stroke, what a scene asks for at most: no hole is where no wire gets."""
CONE = Cone(half=np.radians(30.0))
BLIND = SensorWatch(patience=10_000)
"""Of a control that goes by its model for as long as no angles come."""

wires_of = lru_cache(maxsize=4)(identify_head)


@dataclass(frozen=True, eq=False)
class ServoRun:
    """One run of the loop.

    ``t`` (T,) in seconds since the servo took over; ``off`` (T,) how far the true point is from
    the middle of the image, in pixels; ``verdicts`` (T,) of the tracker; ``angles`` (T, 2) true
    lines of sight in degrees; ``left`` (T,) how far it is from where the tracker has it, in
    pixels: what is left to see of a motion when each picture is shifted by that.
    """

    name: str
    t: FloatArray
    off: FloatArray
    verdicts: tuple[str, ...]
    angles: FloatArray
    left: FloatArray | None = None

    @property
    def settle(self) -> float:
        """After how long the point stays within 2 pixels of the middle, in seconds."""
        out = np.flatnonzero(self.off > SETTLED_PX)
        return float(self.t[out[-1]]) if out.size else 0.0

    def rms(self, after: float) -> float:
        """Root-mean-square distance from a time on, in pixels."""
        return float(np.sqrt(np.mean(self.off[self.t > after] ** 2)))

    def stabilised_rms(self, after: float) -> float:
        """The same in pictures shifted by what was tracked; NaN where nothing was."""
        if self.left is None:
            return np.nan
        return float(np.sqrt(np.mean(self.left[self.t > after] ** 2)))

    @property
    def lost(self) -> float:
        """Share of frames in which the point was not tracked."""
        return float(np.mean([verdict != TRACKED for verdict in self.verdicts]))

    @property
    def reacquire(self) -> float:
        """Longest time without the point, in seconds."""
        longest = now = 0
        for verdict in self.verdicts:
            now = 0 if verdict == TRACKED else now + 1
            longest = max(longest, now)
        return longest * TICK


class Scene:
    """A pipe with one hole, a head before it, and the control of its wires."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        rng = np.random.default_rng([seed, 11])
        wires, coupling = wires_of(seed)
        self.control: HeadControl = head_control("observer", wires, coupling=coupling)
        self.blind = head_control("observer", wires, coupling=coupling, sensor=BLIND)
        aim, way = self._within_stroke(rng)
        self.mount = Mount(
            offset=tuple(rng.uniform(-0.4e-3, 0.4e-3, 2)), roll=rng.uniform(-np.pi, np.pi)
        )
        pose = self.mount.pose(*aim)
        phi, z, _ = meet_wall(pose.position, pose.rotation[:, 2], 10e-3)
        self.hole = Bore(float(phi), float(z), 1e-3)
        self.pipe = replace(Pipe.draw(seed), bores=(self.hole,))
        self.aim = aim
        off = START_PX / 260.0
        side = way + np.pi / 2 * rng.choice([-1, 1]) + rng.uniform(-0.6, 0.6)
        start = aim + off * np.array([np.cos(side), np.sin(side)])
        self.start = CONE.clip(start)

    def _within_stroke(self, rng: np.random.Generator) -> tuple[FloatArray, float]:
        """A line of sight (2,) that the wires as identified come to, and its direction."""
        top = [axis.observer.wire.operator.range[1] for axis in self.control.axes]
        while True:
            away, way = np.radians(rng.uniform(19, 27)), float(rng.uniform(0, 2 * np.pi))
            aim = away * np.array([np.cos(way), np.sin(way)])
            own = np.linalg.solve(np.asarray(self.control.coupling), np.degrees(aim) + STRAIGHT)
            if (own < STROKE_SHARE * np.array(top)).all():
                return aim, way

    def head(self, sway: Sway | None = None) -> SeeingHead:
        """A cold head with its camera."""
        camera = Camera(self.pipe, self.mount, specimen=self.seed, seed=self.seed)
        distance = np.linalg.norm(
            wall_point(self.hole.phi, self.hole.z, 10e-3) - self.mount.pose(*self.aim).position
        )
        camera.focus_at(float(np.clip(distance, 4e-3, 60e-3)))
        return SeeingHead(Head(self.seed, 0.05, self.seed, delay=TICK), camera, sway=sway)

    def eye(self, head: SeeingHead) -> Eye:
        """The camera as calibrated; the head is taken to sit in the middle of the pipe."""
        return Eye(
            head.camera.calibration, replace(self.mount, offset=(0.0, 0.0)), head.camera.leds
        )

    def pixel(self, head: SeeingHead) -> FloatArray:
        """(2,) where the true hole is in the image, by the lens as calibrated."""
        pose = self.mount.pose(*head._line_of_sight())
        return head.camera.calibration.project(pose.to_camera(_hole(self)))

    def off(self, head: SeeingHead) -> float:
        """How far the true hole is from the middle of the image, in pixels."""
        point = wall_point(self.hole.phi, self.hole.z, 10e-3)
        x, y, z = self.mount.pose(*head._line_of_sight()).to_camera(point)
        return float(260.0 * np.hypot(x / z, y / z))


def run_servo(scene: Scene, *, sensor: bool, sway: Sway | None = None, seconds: float) -> ServoRun:
    """Bring the hole to the middle of the image, from where the head was left.

    Against sway it is held by what the joints should read, once it is near. Without a sensor, no
    reading of a joint is used, neither on the way there nor later.
    """
    head = scene.head(sway)
    eye, control = scene.eye(head), scene.control if sensor else scene.blind
    state, y = _approach(scene, head, sensor=sensor)
    _meter(head)
    known = np.radians((y if sensor else foretold(control, state)) - STRAIGHT)
    servo = Servo(eye, gain=GAIN, delay=0.2, cone=CONE, rate_limit=np.radians(20.0), soft=SOFT)
    hold, tracker = Hold(servo=servo), Tracker(eye)
    held, believed = hold.begin(known), servo.begin(known)
    shown = scene.pixel(head)
    picked, tracked = tracker.begin(head.frame().image, shown, *known.tolist())
    steps = round(seconds / TICK)
    off, left, verdicts, sight = np.empty(steps), np.empty(steps), [], np.empty((steps, 2))
    for k in range(steps):
        track, tracked = tracker.step(tracked, head.frame().image, *known.tolist())
        seen = track.pixel if track.verdict == TRACKED else None
        shown = shown if seen is None else seen
        left[k] = 0.5 * float(np.hypot(*(scene.pixel(head) - shown)))
        if not sensor:
            known, y = _by_image(eye, picked.place, seen, foretold(control, state))
        if sway is not None and k * TICK > HOLD_AFTER:
            step, held = hold.step(held, seen, known)
        else:
            step, believed = servo.step(believed, seen, known)
            held = hold.begin(step.angles)
        u, state = control.step(state, np.degrees(step.angles) + STRAIGHT, y)
        y = head.exchange(u)
        known = np.radians(y - STRAIGHT) if sensor else known
        off[k], sight[k] = scene.off(head), np.degrees(head._line_of_sight())
        verdicts.append(track.verdict)
    t = TICK * np.arange(1.0, steps + 1.0)
    name = "sensor" if sensor else "camera only"
    return ServoRun(name, t, off, tuple(verdicts), sight, left)


def foretold(control: HeadControl, state: HeadState) -> FloatArray:
    """(2,) degrees of the joints as the model of the wires has them."""
    own = np.array([axis.estimate.wire.angle for axis in state.axes])
    return np.asarray(np.asarray(control.coupling) @ own)


def _by_image(
    eye: Eye, place: FloatArray, pixel: FloatArray | None, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angles of the head, and what stands for the reading of its joints; NaN without a point."""
    near = np.radians(guess - STRAIGHT)
    seen = None if pixel is None else sighted_angles(eye, place, pixel, near)
    return (near, np.full(2, np.nan)) if seen is None else (seen, np.degrees(seen) + STRAIGHT)


def run_still(scene: Scene, sway: Sway, seconds: float) -> ServoRun:
    """Hold the angles at which the hole is in the middle, without looking."""
    head = scene.head(sway)
    state, y = scene.control.begin(), np.zeros(2)
    steps, wait = round(seconds / TICK), round(APPROACH / TICK)
    off, sight = np.empty(steps), np.empty((steps, 2))
    for k in range(-wait, steps):
        u, state = scene.control.step(state, np.degrees(scene.aim) + STRAIGHT, y)
        y = head.exchange(u)
        if k >= 0:
            off[k], sight[k] = scene.off(head), np.degrees(head._line_of_sight())
    t = TICK * np.arange(1.0, steps + 1.0)
    return ServoRun("still", t, off, (TRACKED,) * steps, sight)


def run_motion(scene: Scene) -> ServoRun:
    """Track the hole while the head is swung about it as fast as 10 degrees a second."""
    head = scene.head()
    eye = scene.eye(head)
    state, y = _approach(scene, head)
    _meter(head)
    frame, tracker = head.frame(), Tracker(eye)
    known = np.radians(y - STRAIGHT)
    _, tracked = tracker.begin(frame.image, scene.pixel(head), float(known[0]), float(known[1]))
    steps = round(MOTION_SECONDS / TICK)
    off, verdicts, sight = np.empty(steps), [], np.empty((steps, 2))
    for k in range(steps):
        frame = head.frame()
        known = np.radians(y - STRAIGHT)
        track, tracked = tracker.step(tracked, frame.image, float(known[0]), float(known[1]))
        swing = 7.0 * np.sin(MOTION / 7.0 * k * TICK) * np.array([1.0, 0.6])
        wanted = np.degrees(CONE.clip(scene.aim + np.radians(swing))) + STRAIGHT
        u, state = scene.control.step(state, wanted, y)
        y = head.exchange(u)
        off[k], sight[k] = scene.off(head), np.degrees(head._line_of_sight())
        verdicts.append(track.verdict)
    t = TICK * np.arange(1.0, steps + 1.0)
    return ServoRun("motion", t, off, tuple(verdicts), sight)


def servo_figures(scene: Scene) -> tuple[dict[str, Any], dict[str, ServoRun]]:
    """All runs of one scene, and their numbers."""
    sway = Sway()
    runs = {
        "sensor": run_servo(scene, sensor=True, seconds=SERVO),
        "camera": run_servo(scene, sensor=False, seconds=SERVO),
        "swayed": run_servo(scene, sensor=True, sway=sway, seconds=SWAY_SECONDS),
        "still": run_still(scene, sway, SWAY_SECONDS - SWAY_WAIT),
        "motion": run_motion(scene),
    }
    held, still = runs["swayed"].rms(SWAY_WAIT), runs["still"].rms(0.0)
    figures = {
        "servo": {
            "settle_s_with_sensor": runs["sensor"].settle,
            "settle_s_camera_only": runs["camera"].settle,
            "steady_rms_px_camera_only": runs["camera"].rms(SERVO - STEADY),
            "steady_rms_px": runs["sensor"].rms(SERVO - STEADY),
        },
        "sway": {
            "ratio": held / still,
            "stabilised_ratio": runs["swayed"].stabilised_rms(SWAY_WAIT) / still,
            "held_px": held,
            "still_px": still,
        },
        "tracking": {
            "lost_fraction": runs["motion"].lost,
            "reacquire_s": runs["motion"].reacquire,
        },
    }
    return figures, runs


def _approach(scene: Scene, head: SeeingHead, *, sensor: bool = True) -> tuple[Any, FloatArray]:
    """Bring the head to where the servo takes over; without a sensor, by the model alone."""
    control = scene.control if sensor else scene.blind
    state, y = control.begin(), np.zeros(2)
    for _ in range(round(APPROACH / TICK)):
        read = y if sensor else np.full(2, np.nan)
        u, state = control.step(state, np.degrees(scene.start) + STRAIGHT, read)
        y = head.exchange(u)
    return state, y


def _meter(head: SeeingHead) -> None:
    """Set the gain for a middle grey, and let the focus arrive."""
    gain = 1.0
    for _ in range(25):
        mean = float(np.mean(head.frame().image))
        gain = float(np.clip(gain * (GREY / max(mean, 1.0)) ** 0.7, 0.1, 20.0))
        head.camera.expose(0.01, gain)


def _hole(scene: Scene) -> FloatArray:
    return wall_point(scene.hole.phi, scene.hole.z, 10e-3)
