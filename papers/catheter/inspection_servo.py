"""Centre a point of the wall in the image, and hold it there with two wires.

Camera, tracker, hold and the wires' controller form one loop at 25 Hz, with and without angle
sensors. Without sensors no reading of a joint is used: the model of the wires brings the head near,
and then the controller uses the angles computed from the tracked patch of the wall. All pixel
figures are at the scale of a 320 by 240 image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.head import HeadControl, head_control
from minorloop_head.control.readings import SensorWatch
from minorloop_head.geometry import Mount, meet_wall
from minorloop_head.procedures.calibration import STRAIGHT, HeadCalibration
from minorloop_head.procedures.centre import CONE, Centred, Centring
from minorloop_head.procedures.go import go
from minorloop_head.procedures.mark import aim_at
from minorloop_head.procedures.meter import meter
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import acquire
from minorloop_head.procedures.values import NOW, Procedure, Reading, Request, Result
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.twins.surroundings import Sway
from minorloop_head.vision.servo import PointHold
from minorloop_head.vision.tracking import TRACKED
from papers.catheter import scoring
from papers.catheter.head_static import identify_head
from papers.drawing import draw, panel
from papers.harness import Results, Study, rms

TICK = 0.04
APPROACH = 14.0
"""Seconds before the servo, in which the head approaches and the light is metered."""
SERVO, STEADY = 25.0, 8.0
"""Seconds of a run, and its steady part at the end."""
FOCAL = LENS.focal / 2
"""Focal length in the pixels of this study: those of an image of 320 x 240."""
SETTLED_PX = 2.0
CLICK = 5.0
"""Rms distance in pixels of 640 between a click and the intended point."""
SWAY_SECONDS, SWAY_WAIT = 40.0, 12.0
SWING = math.radians(7.0)
"""Amplitude of the motion under which the tracker is tested; its fastest rate is 10 degrees a
second."""
STROKE_SHARE = 0.93
"""Largest share of a wire's identified stroke in a scene, so that every hole can be reached."""
wires_of = lru_cache(maxsize=4)(identify_head)


@dataclass(frozen=True, eq=False)
class ServoRun:
    """One run of the loop.

    ``t`` (T,) in seconds since the servo took over; ``off`` (T,) distance of the true point from
    the middle of the image, in pixels; ``verdicts`` (T,) of the tracker; ``left`` (T,) distance of
    the true point from the tracked one, in pixels: the remaining motion if each image is shifted by
    the tracked one. ``place`` (T, 2) is the true point from the middle, in pixels.
    """

    t: FloatArray
    off: FloatArray
    verdicts: tuple[str, ...]
    left: FloatArray
    place: FloatArray

    def offset(self, after: float) -> float:
        """Return the distance of the mean place from the middle after a time, in pixels."""
        return float(np.hypot(*self.place[self.t > after].mean(axis=0)))

    @property
    def settle(self) -> float:
        """Time from which the point stays within 2 pixels of the middle, in seconds."""
        out = np.flatnonzero(self.off > SETTLED_PX)
        return float(self.t[out[-1]]) if out.size else 0.0

    def rms(self, after: float) -> float:
        """Return the root-mean-square distance after a time, in pixels."""
        return rms(self.off[self.t > after])

    def stabilised_rms(self, after: float) -> float:
        """Return the same in images shifted by the tracked motion."""
        return rms(self.left[self.t > after])

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


def within_stroke(
    control: HeadControl, rng: np.random.Generator, away: tuple[float, float]
) -> tuple[FloatArray, float]:
    """Draw a line of sight (2,) that the identified wires reach, and its direction in radians.

    Its deflection is between ``away``, in degrees.
    """
    top = [axis.observer.wire.operator.range[1] for axis in control.axes]
    while True:
        far, way = np.radians(rng.uniform(*away)), float(rng.uniform(0, 2 * np.pi))
        aim = far * np.array([np.cos(way), np.sin(way)])
        own = np.linalg.solve(np.asarray(control.coupling), np.degrees(aim + STRAIGHT))
        if (own < STROKE_SHARE * np.array(top)).all():
            return np.asarray(aim), way


class Scene:
    """A pipe with one hole, a head before it, and the control of its wires."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        rng = np.random.default_rng([seed, 11])
        wires, coupling = wires_of(seed)
        self.control: HeadControl = head_control("observer", wires, coupling=coupling)
        # It uses its model as long as there are no angles.
        watch = SensorWatch(patience=10_000)
        self.blind = head_control("observer", wires, coupling=coupling, sensor=watch)
        aim, way = within_stroke(self.control, rng, (19.0, 27.0))
        self.mount = Mount(
            offset=tuple(rng.uniform(-0.4e-3, 0.4e-3, 2)), roll=rng.uniform(-np.pi, np.pi)
        )
        pose = self.mount.pose(*aim)
        phi, z, _ = meet_wall(pose.position, pose.rotation[:, 2], 10e-3)
        self.hole = Bore(float(phi), float(z), 1e-3)
        self.pipe = replace(Pipe.draw(seed), bores=(self.hole,))
        self.aim = aim
        side = way + np.pi / 2 * rng.choice([-1, 1]) + rng.uniform(-0.6, 0.6)
        self.start = CONE.clip(aim + 43.0 / FOCAL * np.array([np.cos(side), np.sin(side)]))

    def rig(self, sway: Sway | None = None, *, sensor: bool = True) -> InspectionRig:
        """Return a cold head with its camera; it is assumed to be on the axis of the pipe."""
        plant = Rig(Head(self.seed, 0.05, self.seed, delay=TICK), Catheter(self.seed), sway=sway)
        tip = SimulatedTip(self.pipe, mount=self.mount, specimen=self.seed, seed=self.seed)
        lens, leds = tip.camera.calibration, tip.camera.leds
        calibration = HeadCalibration(lens=lens, leds=leds, roll=self.mount.roll)
        control = self.control if sensor else self.blind
        return InspectionRig(plant, tip, control, calibration, sensors=sensor)


class Watch:
    """Truth of a run, tick by tick. For scoring only."""

    def __init__(self, scene: Scene, rig: InspectionRig, point: Centred | None = None) -> None:
        assert isinstance(rig.plant, Rig)
        self._scene, self._plant, self._lens = scene, rig.plant, rig.calibration.lens
        self._point, self._pixel = point, self.true_pixel()
        self._seen: list[tuple[float, float, float, str]] = []

    def __call__(self) -> None:
        """Record the truth after a tick; ticks before the first tracked frame are omitted."""
        before, self._pixel = self._pixel, self.true_pixel()
        verdict, shown = TRACKED, None
        if self._point is not None:
            verdict, shown = self._point.verdict, self._point.shown
        if verdict:
            x, y, z = self._hole()
            left = np.nan if shown is None else 0.5 * math.dist(before, shown)
            self._seen.append((float(FOCAL * x / z), float(FOCAL * y / z), left, verdict))

    def run(self, after: int = 0) -> ServoRun:
        """Return the run from a tick on."""
        x, y, left, verdicts = zip(*self._seen[after:], strict=True)
        place = np.stack([x, y], axis=1)
        t = TICK * np.arange(1.0, len(place) + 1.0)
        return ServoRun(t, np.hypot(*place.T), verdicts, np.array(left), place)

    def _hole(self) -> FloatArray:
        """Return the hole (3,) in camera coordinates."""
        hole, radius = self._scene.hole, self._scene.pipe.radius
        return scoring.middle_of(self._scene.mount, self._plant, (hole.phi, hole.z), radius)

    def true_pixel(self) -> FloatArray:
        """Return the pixel (2,) of the hole, by the calibrated lens."""
        return np.asarray(self._lens.project(self._hole()))


def run_servo(
    scene: Scene,
    *,
    sensor: bool,
    sway: Sway | None = None,
    seconds: float,
    integral: bool = True,
    swings: bool = False,
    law: type[Centring] = Centring,
) -> ServoRun:
    """Centre the hole in the image, from the start of the head, and hold it there.

    Without a sensor, no reading of a joint is used. If the head ``swings`` at up to 10 degrees per
    second about its start, the hole is only tracked.
    """
    rig = scene.rig(sway, sensor=sensor)
    patience = seconds + TICK  # a tick passes before the first frame is tracked
    gain = Centring.integral_gain if integral else 0.0
    options: dict[str, Any] = {"patience": patience, "integral_gain": gain, "by_image": not sensor}
    centring = law(calibration=rig.calibration, still=math.inf, **options)
    point = clicked(scene, rig)
    watch = Watch(scene, rig, point)

    def at_once(request: Request, now: Reading | None) -> Request:
        """Pick the patch before the head moves."""
        if now is None:
            return Request(frame=True, now=True)
        return request if request.focus is None else Request(focus=request.focus, now=True)

    procedure = changed(centring.centre(point), at_once)
    rig.run(swinging(procedure, scene.start) if swings else procedure, watch)
    return watch.run()


def run_still(scene: Scene, sway: Sway, seconds: float) -> ServoRun:
    """Hold the angles at which the picked point is in the middle, without the camera."""
    rig = scene.rig(sway)
    place = clicked(scene, rig).place
    watch, angles = Watch(scene, rig), aim_at(rig.calibration, place, rig.place)
    rig.run(go(angles=angles, still=math.inf, turning=APPROACH + seconds), watch)
    return watch.run(round(APPROACH / TICK))


def clicked(
    scene: Scene, rig: InspectionRig, true_pixel: Callable[[], FloatArray] | None = None
) -> Centred:
    """Bring the head to its start, and pick the hole like an operator who clicks beside it.

    The procedure moves the point to the outline.
    """
    rig.run(go(angles=scene.start, still=math.inf, turning=APPROACH - 1.0))
    rig.run(meter(rig.calibration, rig.light, 1.0))
    rng = np.random.default_rng([scene.seed, 71])
    true = (true_pixel or Watch(scene, rig).true_pixel)()
    click = true + CLICK / math.sqrt(2) * rng.standard_normal(2)
    frames, reading = acquire(rig), rig.reading(NOW)
    pixel = Centring(calibration=rig.calibration).outlined(frames, click, reading)
    camera = rig.calibration.camera_at(reading.place)
    place = np.asarray(camera.place(pixel, frames[-1].pan, frames[-1].tilt))
    return Centred(place=place, shown=pixel)


def changed(
    procedure: Procedure[Result], change: Callable[[Request, Reading | None], Request]
) -> Procedure[Result]:
    """Carry out a procedure with other requests; each is changed with the reading before it."""
    request, now = next(procedure), None
    try:
        while True:
            now = yield change(request, now)
            request = procedure.send(now)
    except StopIteration as end:
        return cast(Result, end.value)


def swinging(procedure: Procedure[Result], aim: FloatArray) -> Procedure[Result]:
    """Track a point as a procedure does, while the head swings about angles (2,) instead."""
    began: float | None = None

    def swung(request: Request, now: Reading | None) -> Request:
        nonlocal began
        if now is None or request.now:
            return request
        began = now.t if began is None else began
        phase = math.radians(10.0) / SWING * (now.t - began)
        swing = SWING * np.sin(phase) * np.array([1.0, 0.6])
        return replace(request, angles=CONE.clip(aim + swing))

    return changed(procedure, swung)


def servo_figures(scene: Scene) -> tuple[dict[str, Any], dict[str, ServoRun]]:
    """Return the figures of one scene, and its runs."""
    sway = Sway()
    runs = {
        "sensor": run_servo(scene, sensor=True, seconds=SERVO),
        "camera": run_servo(scene, sensor=False, seconds=SERVO),
        "swayed": run_servo(scene, sensor=True, sway=sway, seconds=SWAY_SECONDS),
        "still": run_still(scene, sway, SWAY_SECONDS - SWAY_WAIT),
        "motion": run_servo(scene, sensor=True, seconds=20.0, swings=True),
    }
    held, still = runs["swayed"].rms(SWAY_WAIT), runs["still"].rms(0.0)
    figures = {
        "servo": {
            "settle_s_with_sensor": runs["sensor"].settle,
            "settle_s_camera_only": runs["camera"].settle,
            "steady_rms_px": runs["sensor"].rms(SERVO - STEADY),
        },
        "sway": {
            "ratio": held / still,
            "stabilised_ratio": runs["swayed"].stabilised_rms(SWAY_WAIT) / still,
        },
        "tracking": {"lost_fraction": runs["motion"].lost, "reacquire_s": runs["motion"].reacquire},
    }
    return figures, runs


CASES: Mapping[str, tuple[Sway | None, float]] = {
    "still": (None, SERVO),
    "drift": (Sway(amplitude=math.radians(2.0), pan=0.01, tilt=0.008), SERVO),
    "sway": (Sway(), SWAY_SECONDS),
}
"""Motion of the base, and seconds of a run. The slow turn is up to 0.13 degrees a second."""
WITHOUT, PRINTED = ", no integral", "printed"
PRINTED_SECONDS = 12.0
"""Duration of the run with the printed sign."""


def integral_results(runs: Mapping[str, ServoRun]) -> Results:
    """Return the effect of the integral in pixels of 320 and seconds, by the ``runs`` by name."""
    found = {"printed_px": runs[PRINTED].rms(PRINTED_SECONDS - 4.0)}
    for key, words in (("", ""), ("without_", WITHOUT)):
        still, drift, sway = (runs[f"{case}{words}"] for case in CASES)
        found |= {
            f"{key}settle_s": still.settle,
            f"{key}offset_px": still.offset(SERVO - STEADY),
            f"{key}still_px": still.rms(SERVO - STEADY),
            f"{key}drift_px": drift.rms(8.0),  # the point has long been centred
            f"{key}sway_px": sway.rms(SWAY_WAIT),
        }
    found["sway_ratio"] = found["sway_px"] / found["without_sway_px"]
    return Results({"integral": found}, runs=runs)


def run_integral(seed: int, told: Callable[[str], None] = lambda part: None) -> Results:
    """Hold a point with the integral and without in all cases, and with the printed sign."""
    scene = Scene(seed)
    runs: dict[str, ServoRun] = {}
    for case, (sway, seconds) in CASES.items():
        for words in ("", WITHOUT):
            runs[f"{case}{words}"] = run_servo(
                scene, sensor=False, sway=sway, seconds=seconds, integral=not words
            )
        told(case)
    return integral_results({**runs, PRINTED: run_printed(scene)})


class _PrintedHold(PointHold):
    """A hold with the integral of Eq. (10) as printed: with a plus."""

    def correction(self, integral: FloatArray, error: FloatArray | None) -> FloatArray:
        return -super().correction(integral, error)


class _PrintedCentring(Centring):
    def _hold(self, reading: Reading) -> PointHold:
        hold = super()._hold(reading)
        return _PrintedHold(servo=hold.servo, near=math.pi, slip=math.pi)


def run_printed(scene: Scene) -> ServoRun:
    """Centre the hole by the camera alone with the printed sign of the integral."""
    return run_servo(scene, sensor=False, seconds=PRINTED_SECONDS, law=_PrintedCentring)


def draw_integral(study: Results) -> Any:
    """Draw distances against time by the camera alone: still, drifting and swayed base."""
    cases = {"still": "still base", "drift": "base turns slowly", "sway": "sway of 1 degree"}
    panels = []
    for case, title in cases.items():
        looks = [(f"{case}{WITHOUT}", "without", "C3"), (case, "with the integral", "C0")]
        looks += [(PRINTED, "printed sign", "C7")] if case == "still" else []
        lines = [
            (study.runs[name].t, study.runs[name].off, f"{colour} - 0.9", words)
            for name, words, colour in looks
        ]
        y = "off the middle [px of 320]" if case == "still" else ""
        panels.append(panel("time [s]", y, *lines, title=title, yscale="log"))
    return draw(*panels, columns=3, height=3.6, sharey=True)


STUDY = Study("integral", "The integral of Eq. (10)", run_integral)
