"""The twins that a mission is carried out on, and the hands that it has: a crew with a clock.

Pipe, head, catheter, camera and probe are drawn by one seed. What a mission may know of them is
what is calibrated or read; what is true of them is for scoring alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.control.head import HeadControl, head_control
from minorloop.geometry import Mount, Probe, meet_wall, wall_distance, wall_point
from minorloop.inspection.field import Ear
from minorloop.lab.actuator import Shot
from minorloop.studies.inspection_servo import wires_of
from minorloop.twins.camera import Camera
from minorloop.twins.catheter import Catheter
from minorloop.twins.head import Head
from minorloop.twins.pipe import Bore, Crack, Pipe, draw_crack
from minorloop.twins.seeing import STRAIGHT, SeeingHead, Sway
from minorloop.twins.ultrasound import Ultrasound
from minorloop.vision.defects import Findings, acquire, find_holes
from minorloop.vision.eye import Eye
from minorloop.vision.jacobian import wall_depth
from minorloop.vision.servo import Cone

TICK, RADIUS = 0.04, 10e-3
TRAVEL_TIME, RASTER_TIME = 12.0, 1.6
"""Seconds that a move of the head may take, and a step of a raster."""
MOST_TRAVEL = 400
"""Ticks after which the catheter is left where it is."""
REACHED, STILL = float(np.radians(0.15)), 12
"""How near the joints must be to a line of sight, in radians, and for how many ticks."""
SHOTS, GREY, METERED = 16, 95.0, 4
"""Shots at a place; grey that is exposed for, and ticks from one frame that is metered to the next:
what exposure has not reached after six is below the noise."""
SWAY, GYRO_NOISE = Sway(), 0.05
"""How the flow of the water that is let in turns the base of the head, and the noise in degrees
with which a gyroscope in the base reads that."""
OFF_THICKNESS, OFF_TEMPERATURE = 0.01, 0.3
"""Standard deviations of what is told of the wall, as a share, and of the water, in degrees."""
CRACKED, CLEAR = (18e-3, 31e-3), 3e-3
"""Where along the pipe a crack may lie, and how far from the pit, in metres."""
CONE = Cone(half=np.radians(30.0))


@dataclass(frozen=True)
class Step:
    """A line of the mission's log: when it was done, in seconds, what, and what came of it."""

    t: float
    what: str
    outcome: str


@dataclass(frozen=True, eq=False)
class Photo:
    """An image, the camera as calibrated, and where the head looked, in radians."""

    image: npt.NDArray[np.uint8]
    eye: Eye
    angles: tuple[float, float]

    def pixels(self, places: npt.ArrayLike) -> FloatArray:
        """(..., 2) columns and rows of places (..., 2) on the wall."""
        return np.asarray(self.eye.pixel(np.asarray(places), *self.angles))


class Crew:
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
        self.crack = _crack_beside(self.bore, np.random.default_rng([seed, 35]))
        dry = replace(Pipe.draw(seed), bores=(self.bore,), cracks=(self.crack,))
        wet = [self.bore.phi, *(phi for phi, _ in self.crack.points)]
        self.wet = replace(dry, water=_level(wet, np.random.default_rng([seed, 32])))
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

    def aim(self, place: FloatArray) -> FloatArray:
        """(2,) pan and tilt that look at a place (2,) of the wall."""
        phi, z = place.tolist()
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
        for _ in range(MOST_TRAVEL):
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
        sight = Sight(self.head, lambda: self.tick(hold))
        looks = acquire(sight, lambda: tuple(self.angles.tolist()), exposure=0.01, gain=self.gain)
        self.head.camera.expose(0.01, self.gain)
        return find_holes(looks, self.eye)

    def photo(self) -> Photo:
        """What is seen now."""
        pan, tilt = self.angles.tolist()
        return Photo(self.head.frame().image, self.eye, (pan, tilt))

    def say(self, what: str, outcome: str) -> None:
        """Write a line of the log."""
        self.log.append(Step(self.t, what, outcome))

    def true_line(self) -> FloatArray:
        """(2,) phi and z where the optical axis really meets the wall. For scoring only."""
        advance, roll = self.catheter._output_now().tolist()
        pose = self._true_mount(advance, roll).pose(*self.head._line_of_sight().tolist())
        return np.asarray(meet_wall(pose.position, pose.rotation[:, 2], RADIUS)[:2])

    def off_bore(self, place: npt.ArrayLike) -> float:
        """Metres through the pipe from a place (2,) to the true bore. For scoring only."""
        return apart(place, (self.bore.phi, self.bore.z))

    def _true_mount(self, advance: float, roll: float) -> Mount:
        return Mount(offset=self.off, roll=float(np.radians(roll)), advance=1e-3 * advance)

    def probe(self) -> Ultrasound:
        """The probe in the flooded pipe where the catheter is; `ear` is what is known of it."""
        advance, roll = self.catheter._output_now().tolist()
        return Ultrasound(
            self.wet,
            self._true_mount(advance, roll),
            specimen=self.seed,
            seed=self.seed,
            temperature=self.warm,
        )

    def carry(self, probe: Ultrasound) -> None:
        """Bring a probe along to where the catheter is."""
        advance, roll = self.catheter._output_now().tolist()
        probe.move(self._true_mount(advance, roll))

    def shots(self, probe: Ultrasound, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""
        sight, shots = self.head._line_of_sight(), []
        for _ in range(count):
            probe.look(float(sight[0]), float(sight[1]))
            shots.append(probe.shot())
        return shots

    @property
    def ear(self) -> Ear:
        """The probe as calibrated, the wall as its maker tells, the water as measured."""
        return Ear(
            Probe(), self.mount, thickness=self.told_thickness, temperature=self.told_temperature
        )


def _crack_beside(bore: Bore, rng: np.random.Generator) -> Crack:
    """A crack that is within reach of the looks and clear of the bore."""
    low, high = CRACKED
    while True:
        crack = draw_crack(rng, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(low, high)))
        z = [along for _, along in crack.points]
        off = min(distance(corner, (bore.phi, bore.z)) for corner in crack.points)
        if low < min(z) and max(z) < high and off > CLEAR:
            return crack


def _level(angles: Sequence[float], rng: np.random.Generator) -> float:
    """Height of the water, y pointing down: all these, and the probe before them, are under it."""
    up = float(np.sin(angles).min())
    highest = min(min(RADIUS, Probe().face) * up - 1e-3, RADIUS * up - 2.5e-3)
    return float(rng.uniform(-0.98 * RADIUS, highest)) if highest > -0.98 * RADIUS else -0.9999e-2


def distance(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    """Metres along the wall between two places, each phi and z first."""
    return float(wall_distance(one, other, RADIUS))


def apart(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    """Metres straight from one place of the wall to another, each phi and z first."""
    ends = [wall_point(place[0], place[1], RADIUS) for place in np.asarray([one, other])]
    return float(np.linalg.norm(ends[0] - ends[1]))


class Sight:
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
