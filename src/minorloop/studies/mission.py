"""The inspection of section 5.2 of the catheter head paper, as one automatic mission on the twin.

Look around, pick, centre, focus, extract, touch, measure, reconstruct. Head, catheter, camera and
probe are twins; everything between them is what a real inspection would run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from minorloop.arrays import FloatArray
from minorloop.control.head import HeadControl, head_control
from minorloop.geometry import Mount, Probe, meet_wall, wall_point, wrapped
from minorloop.inspection.echoes import Burst, average, choose_modality
from minorloop.inspection.field import Ear
from minorloop.inspection.findings import Finding, finding_of
from minorloop.inspection.fusion import fuse, mean_depths, outline_of
from minorloop.inspection.pits import PitDepth, measure_pit, raster
from minorloop.inspection.profile import Profile, centred, joined, wall_profile
from minorloop.inspection.unrolled import (
    Patch,
    WallMap,
    WaterLine,
    blend,
    camera_map,
    find_water,
    paste,
    sonar_map,
)
from minorloop.studies.inspection_servo import SOFT, wires_of
from minorloop.twins.camera import Camera
from minorloop.twins.catheter import Catheter
from minorloop.twins.head import Head
from minorloop.twins.pipe import Bore, Pipe
from minorloop.twins.seeing import STRAIGHT, SeeingHead, Sway
from minorloop.twins.ultrasound import Ultrasound
from minorloop.vision.defects import Findings, Hole, acquire, find_holes, strongest
from minorloop.vision.eye import Eye
from minorloop.vision.focus import autofocus
from minorloop.vision.jacobian import wall_depth
from minorloop.vision.servo import Cone, Servo
from minorloop.vision.tracking import TRACKED, Tracker
from minorloop.vision.wallmap import WallMap as Shades

TICK, RADIUS = 0.04, 10e-3
RING, LOOKS = 25.0, 8
"""Deflection of the looks around in degrees, and how many there are from one place."""
CENTRED = 23.0
"""Deflection at which a thing is brought to the middle, in degrees."""
TRAVEL_TIME, CENTRE_TIME, RASTER_TIME = 6.0, 9.0, 1.6
"""Seconds for a move of the head, for centring, and for a step of the raster."""
ADVANCES = (0.0, 3.0, 6.0, 9.0, 12.0, 15.0, 18.0, 21.0, 24.0)
"""Positions of the catheter from which is looked around, in mm, until echoes confirm something;
so near one another that a hole of 0.85 mm is 9 pixels of a 320 by 240 image across in two looks."""
MOST_PICKS = 8
"""Things that are gone to in all, one after the other."""
SWAY, GYRO_NOISE = Sway(), 0.05
"""How the flow of the water that is let in turns the base of the head, and the noise in degrees
with which a gyroscope in the base reads that."""
SAME = 1.0e-3
"""Things on the wall nearer than that are one."""
OFF_THICKNESS, OFF_TEMPERATURE = 0.01, 0.3
"""Standard deviations of what is told of the wall, as a share, and of the water, in degrees."""
NEARER = 0.6
"""Share of the deflection at which the finding is centred, where the servo takes over."""
REACHED, STILL = float(np.radians(0.15)), 12
"""How near the joints must be to a line of sight, in radians, and for how many ticks."""
SHOTS, GREY, METERED = 16, 95.0, 4
"""Shots at a place; grey that is exposed for, and ticks from one frame that is metered to the next:
what exposure has not reached after six is below the noise."""
CONE = Cone(half=np.radians(30.0))
PATCH = 2.4e-3
NEAR = 8.0
"""How much nearer than where it was centred a finding is looked at to extract it, in mm."""
TURNS, RING_SHOTS = 48, 4
"""Places of the sweep round the pipe for the water line and the profile, and shots at each."""
RING_ROWS = 96


@dataclass(frozen=True)
class Step:
    """A line of the mission's log: when it was done, in seconds, what, and what came of it."""

    t: float
    what: str
    outcome: str


@dataclass(frozen=True, eq=False)
class Mission:
    """What a mission gave.

    ``log`` of the steps; ``first`` and ``centred`` images of the finding and its pixel in the
    first; ``found`` by the camera and ``pit`` by the echoes; ``wall`` about it, and ``ring`` once
    round the pipe; the ``water`` line and its true height ``water_truth``, for scoring as
    ``truth`` is; ``touch`` how far the tool's point came to lie from the true centre, in m.
    """

    seed: int
    log: tuple[Step, ...]
    looks: Findings | None
    first: npt.NDArray[np.uint8] | None
    pixel: FloatArray | None
    centred: npt.NDArray[np.uint8] | None
    found: Hole | None
    pit: PitDepth | None
    finding: Finding | None
    wall: WallMap | None
    ring: WallMap | None
    water: WaterLine | None
    touch: float
    truth: Bore
    water_truth: float

    def figures(self) -> dict[str, Any]:
        """How far from the truth it came; NaN where nothing was found."""
        place = width = depth = np.nan
        if self.pit is not None:
            place = 1e3 * _apart((self.pit.phi, self.pit.z), self.truth)
            width = 100 * abs(self.pit.diameter / self.truth.diameter - 1)
            depth = 1e3 * abs(self.pit.depth - self.truth.depth)
        return {
            "found": self.found is not None,
            "measured": self.pit is not None and self.pit.measured,
            "seconds": self.log[-1].t,
            "touch_mm": 1e3 * self.touch,
            "position_mm": place,
            "diameter_error_pct": width,
            "depth_error_mm": depth,
            "water_error_mm": np.nan
            if self.water is None
            else 1e3 * abs(self.water.height - self.water_truth),
        }


class _Crew:
    """Head, catheter, camera and control in one place, with a clock and a log."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 31])
        self.bore = Bore(
            float(rng.uniform(-np.pi, np.pi)),
            float(rng.uniform(19e-3, 30e-3)),
            float(rng.uniform(0.9e-3, 1.1e-3)),
            depth=float(rng.uniform(0.3e-3, 0.8e-3)),
            brightness=0.0,
            lining=0.08,
        )
        dry = replace(Pipe.draw(seed), bores=(self.bore,))
        self.wet = replace(dry, water=_level(self.bore.phi, np.random.default_rng([seed, 32])))
        self.off = tuple(rng.uniform(-0.2e-3, 0.2e-3, 2).tolist())
        self.known_off = tuple((np.array(self.off) + rng.normal(0, 0.05e-3, 2)).tolist())
        about = np.random.default_rng([seed, 33])
        self.gyro = np.random.default_rng([seed, 34])
        self.warm = float(about.uniform(12, 30))
        self.told_thickness = self.wet.thickness * float(1 + OFF_THICKNESS * about.normal())
        self.told_temperature = self.warm + OFF_TEMPERATURE * float(about.normal())
        self.seed = seed
        camera = Camera(dry, Mount(offset=self.off), specimen=seed, seed=seed)
        self.head = SeeingHead(Head(seed, 0.05, seed, delay=TICK), camera)
        self.catheter = Catheter(seed, 0.02, seed)
        wires, coupling = wires_of(seed)
        self.control: HeadControl = head_control("observer", wires, coupling=coupling)
        self.state, self.y = self.control.begin(), np.zeros(2)
        self.place = np.zeros(2)
        self.log: list[Step] = []
        self.gain = 1.0

    @property
    def t(self) -> float:
        """Seconds since the mission began."""
        return self.head.head.clock

    @property
    def angles(self) -> FloatArray:
        """(2,) pan and tilt of the line of sight as the joints say, in radians."""
        return np.asarray(np.radians(self.y - STRAIGHT))

    @property
    def sight(self) -> FloatArray:
        """(2,) line of sight in radians as joints and gyroscope say: the joints feel no sway."""
        sway = self.head.sway
        if sway is None:
            return self.angles
        read = sway.at(self.t) + GYRO_NOISE * self.gyro.standard_normal(2)
        return np.asarray(self.angles + np.radians(read))

    @property
    def mount(self) -> Mount:
        """As the catheter's sensors say."""
        advance, roll = self.place
        return Mount(
            offset=self.known_off, roll=float(np.radians(roll)), advance=1e-3 * float(advance)
        )

    @property
    def eye(self) -> Eye:
        """The camera as calibrated, where the catheter is."""
        return Eye(self.head.camera.calibration, self.mount, self.head.camera.leds)

    def aim(self, hole: Hole) -> FloatArray:
        """(2,) pan and tilt that look at a thing on the wall."""
        phi, z = hole.place.tolist()
        return np.asarray(self.mount.aim(wall_point(phi, z, RADIUS)))

    def tick(self, wanted: FloatArray, rates: FloatArray | None = None) -> None:
        """One tick towards a line of sight (2,) in radians."""
        u, self.state = self.control.step(self.state, np.degrees(wanted) + STRAIGHT, self.y)
        self.y = self.head.exchange(u)
        self.place = np.asarray(self.catheter.exchange(np.zeros(2) if rates is None else rates))
        advance, roll = self.catheter._output_now().tolist()
        self.head.camera.move(self._true_mount(advance, roll))

    def turn(self, wanted: FloatArray, seconds: float = TRAVEL_TIME) -> None:
        """Go to a line of sight, until the joints say that it is reached, or the time is over."""
        still = 0
        for _ in range(round(seconds / TICK)):
            self.tick(wanted)
            there = bool((np.abs(self.angles - wanted) < REACHED).all())
            still = still + 1 if there else 0
            if still == STILL:
                break

    def travel(self, advance: float, roll: float) -> None:
        """Bring the catheter to mm and degrees, the head as it is."""
        wanted, limits = np.array([advance, roll]), np.array([8.0, 40.0])
        hold = self.angles
        for _ in range(1000):
            off = wanted - self.place
            if (np.abs(off) < (0.05, 0.3)).all():
                break
            self.tick(hold, np.clip(2.0 * off, -limits, limits))
        for _ in range(10):
            self.tick(hold)

    def meter(self) -> None:
        """Focus on what is ahead, and expose for a middle grey."""
        ahead = wall_depth(self.eye, np.zeros(2), *self.angles.tolist())
        self.head.camera.focus_at(float(np.clip(ahead, 5e-3, 55e-3)))
        hold = self.angles
        for k in range(25):
            if k % METERED == 0:
                mean = float(np.mean(self.head.frame().image))
                self.gain = float(np.clip(self.gain * (GREY / max(mean, 1.0)) ** 0.7, 0.1, 20.0))
                self.head.camera.expose(0.01, self.gain)
            self.tick(hold)

    def look(self) -> Findings:
        """Five frames and what is in them, the head held."""
        hold = self.angles
        sight = _Sight(self.head, lambda: self.tick(hold))
        looks = acquire(sight, lambda: tuple(self.angles.tolist()), exposure=0.01, gain=self.gain)
        self.head.camera.expose(0.01, self.gain)
        return find_holes(looks, self.eye)

    def say(self, what: str, outcome: str) -> None:
        """Write a line of the log."""
        self.log.append(Step(self.t, what, outcome))

    def true_line(self) -> FloatArray:
        """(2,) phi and z where the optical axis really meets the wall. For scoring only."""
        advance, roll = self.catheter._output_now().tolist()
        pose = self._true_mount(advance, roll).pose(*self.head._line_of_sight().tolist())
        return np.asarray(meet_wall(pose.position, pose.rotation[:, 2], RADIUS)[:2])

    def _true_mount(self, advance: float, roll: float) -> Mount:
        return Mount(offset=self.off, roll=float(np.radians(roll)), advance=1e-3 * advance)

    def probe(self) -> tuple[Ultrasound, Ear]:
        """The probe in the flooded pipe where the catheter is, and what is known of it."""
        advance, roll = self.catheter._output_now().tolist()
        probe = Ultrasound(
            self.wet,
            self._true_mount(advance, roll),
            specimen=self.seed,
            seed=self.seed,
            temperature=self.warm,
        )
        return probe, self.ear

    @property
    def ear(self) -> Ear:
        """The probe as calibrated, the wall as its maker tells, the water as measured."""
        return Ear(
            Probe(), self.mount, thickness=self.told_thickness, temperature=self.told_temperature
        )


def _level(phi: float, rng: np.random.Generator) -> float:
    """Height of the water, y pointing down: the finding and the probe before it are under it."""
    highest = min(RADIUS, Probe().face) * np.sin(phi) - 1e-3
    highest = min(float(highest), RADIUS * float(np.sin(phi)) - 2.5e-3)
    return float(rng.uniform(-0.98 * RADIUS, highest)) if highest > -0.98 * RADIUS else -0.9999e-2


class _Sight:
    """A camera that lets the head go on for a tick with every frame."""

    def __init__(self, head: SeeingHead, tick: Callable[[], None]) -> None:
        self._head, self._tick = head, tick
        self.switch, self.expose = head.camera.switch, head.camera.expose
        self.focus_at = head.camera.focus_at

    def frame(self) -> Any:
        """The next image."""
        image = self._head.frame()
        self._tick()
        return image


def run_mission(seed: int) -> Mission:
    """Inspect one pipe with one pit in it, without a hand."""
    crew = _Crew(seed)
    mission = Mission(
        seed, (), None, None, None, None, None, None, None, None, None, None, np.nan, crew.bore,
        float(crew.wet.water or 0.0),
    )  # fmt: skip
    best = _examined(crew, mission)
    if best.pit is None:
        crew.say("end", "nothing that echoes confirm was found; no depth is given")
    return replace(best, log=tuple(crew.log))


def _examined(crew: _Crew, mission: Mission) -> Mission:
    """Look from place after place, and go to what is seen, until echoes confirm a pit.

    What is not seen again from nearer is gone to after all that is; where nothing is confirmed,
    what came nearest to it is kept.
    """
    views: list[Shades] = []
    tried: list[Hole] = []
    doubted: list[Hole] = []
    best = mission
    for advance in (*ADVANCES, None):
        holes = doubted if advance is None else _look_around(crew, advance, views)
        for hole in holes:
            known = any(_distance(hole.place, other.place) < SAME for other in tried)
            if len(tried) >= MOST_PICKS or (known and advance is not None):
                continue
            tried += [] if known else [hole]
            one, again, view = _approached(crew, mission, hole)
            if not again and advance is not None:
                doubted.append(hole)
                continue
            one = _sounded(crew, one, view, views)
            best = one if best.pit is None or _better(one, best) else best
            if best.pit is not None and best.pit.measured:
                return best
    return best


def _better(one: Mission, other: Mission) -> bool:
    """Whether the echoes told more of it: measured, or a depth at all."""
    ranks = [
        (pit.measured, bool(np.isfinite(pit.depth))) if pit is not None else (False, False)
        for pit in (one.pit, other.pit)
    ]
    return ranks[0] > ranks[1]


def _approached(crew: _Crew, mission: Mission, hole: Hole) -> tuple[Mission, bool, Shades | None]:
    """Pick, centre, focus, extract; whether it is seen again, and the view of it."""
    first, pixel = _pick(crew, hole)
    _centre(crew, pixel)
    _focus(crew)
    looks, seen, again = _extract(crew, hole)
    return replace(mission, looks=looks, first=first, pixel=pixel, found=seen), again, looks.wall


def _sounded(crew: _Crew, one: Mission, view: Shades | None, views: list[Shades]) -> Mission:
    """Touch and measure; where echoes tell a depth, sweep round and reconstruct."""
    hole = one.found
    if hole is None:
        return one
    centred_image, touch = _touch(crew, hole)
    probe, bursts, ear = _scan(crew, hole)
    pit = measure_pit(bursts, ear, tuple(hole.place.tolist()), hole.diameter)
    crew.say("measure", f"{pit.bursts} of {len(bursts)} places; {pit.verdict}")
    one = replace(one, centred=centred_image, touch=touch, pit=pit, finding=finding_of(pit))
    if not np.isfinite(pit.depth):
        crew.head.sway = None
        return one
    seen = [*views, *([view] if view is not None else [])]
    wall, ring, water = _rebuilt(crew, probe, bursts, ear, pit, hole, seen)
    size = f"{1e3 * pit.diameter:.2f} mm by {1e3 * pit.depth:.3f} mm"
    crew.head.sway = None
    crew.say("reconstruct", f"{finding_of(pit).kind} of {size}")
    return replace(one, wall=wall, ring=ring, water=water)


def _look_around(crew: _Crew, advance: float, views: list[Shades]) -> list[Hole]:
    """What is seen from one place, the likeliest first; the views are added to those there are."""
    crew.travel(advance, 0.0)
    seen: list[Hole] = []
    for k in range(LOOKS):
        way = 2 * np.pi * k / LOOKS
        crew.turn(np.radians(RING) * np.array([np.cos(way), np.sin(way)]))
        crew.meter()
        found = crew.look()
        seen += found.holes
        views += [found.wall] if found.wall is not None else []
    each = strongest(seen, RADIUS, -np.inf)
    words = f"{len(each)} thing{'s' if len(each) > 1 else ''}" if each else "nothing"
    crew.say("look around", f"from {advance:g} mm, {LOOKS} looks: {words}")
    return list(each)


def _pick(crew: _Crew, hole: Hole) -> tuple[npt.NDArray[np.uint8], FloatArray]:
    """Go to where a thing is well in the cone, turn towards it, and say where it is seen."""
    ahead = RADIUS / np.tan(np.radians(CENTRED))
    crew.travel(1e3 * max(float(hole.place[1]) - ahead, 0.0), 0.0)
    crew.turn(CONE.clip(NEARER * crew.aim(hole)))
    crew.meter()
    place = f"phi {np.degrees(hole.place[0]):.0f} deg, z {1e3 * hole.place[1]:.1f} mm"
    crew.say("pick", f"{place}, evidence {hole.evidence:+.1f}")
    pixel = crew.eye.pixel(hole.place, *crew.angles.tolist())
    return crew.head.frame().image, np.asarray(pixel)


def _centre(crew: _Crew, pixel: FloatArray, step: str = "centre") -> None:
    """Bring a point to the middle of the image."""
    eye = crew.eye
    tracker = Tracker(eye)
    servo = Servo(eye, gain=0.8, delay=0.2, cone=CONE, soft=SOFT)
    _, track = tracker.begin(crew.head.frame().image, pixel, *crew.angles.tolist())
    state = servo.begin(crew.angles)
    error = np.nan
    for _ in range(round(CENTRE_TIME / TICK)):
        now, track = tracker.step(track, crew.head.frame().image, *crew.angles.tolist())
        move, state = servo.step(state, now.pixel if now.verdict == TRACKED else None, crew.angles)
        error = move.error
        crew.tick(move.angles)
    crew.say(step, f"{error / 2:.2f} px from the middle of a 320 by 240 image")


def _focus(crew: _Crew) -> None:
    """Sweep the focus on the middle of the image."""
    hold, eye = crew.angles, crew.eye
    sight = _Sight(crew.head, lambda: crew.tick(hold))
    middle = np.array([eye.lens.width / 2, eye.lens.height / 2])
    guess = wall_depth(eye, np.zeros(2), *crew.angles.tolist())
    found = autofocus(sight, eye, middle, float(np.clip(guess, 6e-3, 50e-3)))
    crew.say("focus", f"{1e3 * found.distance:.1f} mm, {found.verdict}")


def _extract(crew: _Crew, picked: Hole) -> tuple[Findings, Hole, bool]:
    """Come nearer, take five frames, find the outline in them, and go back; whether it is there."""
    advance, roll = crew.place.tolist()
    crew.travel(advance + NEAR, roll)
    crew.turn(CONE.clip(NEARER * crew.aim(picked)))
    crew.meter()
    looks = crew.look()
    near = [h for h in looks.holes if _distance(h.place, picked.place) < 1.5e-3]
    hole = max(near, key=lambda h: h.evidence) if near else picked
    words = "seen again from nearer" if near else "not seen again; the first look counts"
    crew.say("extract", f"{1e3 * hole.diameter:.2f} mm across, {words}")
    crew.travel(advance, roll)
    return looks, hole, bool(near)


def _touch(crew: _Crew, hole: Hole) -> tuple[npt.NDArray[np.uint8], float]:
    """Send the axis, along which the tool's point goes, to the finding as it was extracted."""
    crew.turn(CONE.clip(NEARER * crew.aim(hole)))
    crew.meter()
    _centre(crew, np.asarray(crew.eye.pixel(hole.place, *crew.angles.tolist())), "return")
    touch = _apart(tuple(crew.true_line().tolist()), crew.bore)
    phi, z = np.degrees(hole.place[0]), 1e3 * hole.place[1]
    crew.say("touch", f"the tool's point is sent to phi {phi:.1f} deg, z {z:.2f} mm")
    return crew.head.frame().image, touch


def _scan(crew: _Crew, hole: Hole) -> tuple[Ultrasound, list[Burst], Ear]:
    """Bring the probe square to the finding, let water in, and scan a raster in its flow."""
    phi, z = hole.place.tolist()
    crew.travel(1e3 * z, float(np.degrees(wrapped(phi))))
    probe, ear = crew.probe()
    targets = raster(ear, (phi, z))
    crew.turn(targets[0])
    crew.head.sway = SWAY
    bursts = []
    for k, target in enumerate(targets):
        crew.turn(target, RASTER_TIME)
        shots = _shots(crew, probe, SHOTS)
        if k == 0:
            way = choose_modality(shots, RADIUS - ear.probe.face, ear.speed)
            crew.say("modality", "the wall is heard" if way == "sonar" else "no echo: camera only")
        angles = crew.sight
        spot, wanted = ear.spots(np.array([angles, target]))[:, :2]
        off = _distance(spot, wanted)
        bursts.append(
            average(shots, np.tile(angles, (SHOTS, 1)), np.full(SHOTS, off), most_off=0.8e-3)
        )
    return probe, bursts, ear


def _rebuilt(
    crew: _Crew,
    probe: Ultrasound,
    bursts: list[Burst],
    ear: Ear,
    pit: PitDepth,
    hole: Hole,
    views: list[Shades],
) -> tuple[WallMap, WallMap, WaterLine]:
    """Fuse echoes and the nearest view, and sweep once round the pipe."""
    phi, z = hole.place.tolist()
    patch = Patch.around(phi, z, size=PATCH)
    heard = mean_depths(bursts, ear, patch, pit)
    image = _laid(views[-1], patch) if views else None
    outline = None if image is None else outline_of(image, patch, (phi, z), hole.diameter)
    wall = fuse(pit, heard, patch, image=image, outline=outline)
    profile, water = _sweep(crew, probe, (phi, z))
    return wall, _ring(z, profile, views, wall), water


def _shots(crew: _Crew, probe: Ultrasound, count: int) -> list[Any]:
    sight, shots = crew.head._line_of_sight(), []
    for _ in range(count):
        probe.look(float(sight[0]), float(sight[1]))
        shots.append(probe.shot())
    return shots


def _sweep(crew: _Crew, probe: Ultrasound, place: tuple[float, float]) -> tuple[Profile, WaterLine]:
    """Roll the catheter once round: where the wall answers, and how far it is."""
    crew.turn(raster(crew.ear, place, points=1)[0])
    profiles = []
    for k in range(TURNS):
        crew.travel(float(crew.place[0]), -180.0 + 360.0 * k / TURNS)
        advance, roll = crew.catheter._output_now().tolist()
        probe.move(crew._true_mount(advance, roll))
        ear = crew.ear
        shots = _shots(crew, probe, RING_SHOTS)
        angles = np.tile(crew.sight, (RING_SHOTS, 1))
        profiles.append(wall_profile([average(shots, angles, np.zeros(RING_SHOTS))], ear))
    profile = joined(profiles)
    water = find_water(profile.spots[:, 0], profile.heard, RADIUS, face=Probe().face)
    words = f"{1e3 * water.height:+.1f} mm from the axis, within {1e3 * water.sd:.1f} mm"
    crew.say("water line", f"{words}; {profile.heard.sum()} of {TURNS} places heard")
    return centred(profile), water


def _ring(z: float, profile: Profile, views: list[Shades], wall: WallMap) -> WallMap:
    """Once round the pipe: what the camera saw, the profile, and the finding in one map."""
    columns = int(2 * np.pi * RADIUS / wall.patch.step)
    patch = Patch(-np.pi, z - 0.5 * RING_ROWS * wall.patch.step, RING_ROWS, columns)
    seen = np.zeros((RING_ROWS, columns), dtype=bool)
    for view in views:
        seen |= np.isfinite(_laid(view, patch))
    spoken = sonar_map(patch, profile.spots, profile.depths, profile.sds, footprint=0.35e-3)
    return paste(blend(camera_map(patch, seen, np.zeros(seen.shape)), spoken), wall)


def _laid(view: Shades, patch: Patch) -> FloatArray:
    """What a view of the camera shows on a patch (rows, columns); NaN where it saw nothing."""
    window, places = view.window, patch.places
    half = 0.5 * (window.columns - 1)
    middle = window.phi + half * window.step / patch.radius
    x = wrapped(places[..., 0] - middle) * patch.radius / window.step + half
    y = (places[..., 1] - window.z) / window.step
    laid: FloatArray = map_coordinates(
        np.asarray(view.whole, dtype=np.float64), [y, x], order=1, mode="constant", cval=np.nan
    )
    return laid


def _distance(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    a, b = np.asarray(one), np.asarray(other)
    return float(np.hypot(RADIUS * float(wrapped(a[0] - b[0])), a[1] - b[1]))


def _apart(place: tuple[float, ...], bore: Bore) -> float:
    point = wall_point(place[0], place[1], RADIUS)
    return float(np.linalg.norm(point - wall_point(bore.phi, bore.z, RADIUS)))
