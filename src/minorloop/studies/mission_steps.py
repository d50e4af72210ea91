"""What a crew does with one thing on the wall: go to it, centre, focus, extract and touch it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop.studies.inspection_servo import SOFT
from minorloop.studies.mission_crew import CONE, RADIUS, TICK, Crew, Photo, Sight, distance
from minorloop.vision.defects import Findings, Hole
from minorloop.vision.focus import autofocus
from minorloop.vision.jacobian import wall_depth
from minorloop.vision.servo import Servo
from minorloop.vision.tracking import TRACKED, Tracker

CENTRED = 23.0
"""Deflection at which a thing is brought to the middle, in degrees."""
CENTRE_TIME, IN_MIDDLE, HELD = 15.0, 2.0, 25
"""Seconds that centring may take; how near the middle a thing is there, in pixels, and for how many
ticks it is to stay."""
NEARER = 0.6
"""Share of the deflection at which a thing is centred, where the servo takes over."""
NEAR, NEAREST = 6.0, 1.0
"""How much nearer than where it was centred a thing is looked at to extract it, and how near to its
stop the catheter is sent, in mm: drawn back further, its tip sticks."""
SAME = 1.5e-3
"""Farthest from where it was picked that a thing is it when it is seen again, in metres."""


def pick(crew: Crew, place: FloatArray, words: str) -> tuple[npt.NDArray[np.uint8], FloatArray]:
    """Go to where a thing is well in the cone, turn towards it, and say where it is seen."""
    crew.travel(max(1e3 * (float(place[1]) - _ahead()), NEAREST), 0.0)
    crew.turn(CONE.clip(NEARER * crew.aim(place)))
    crew.meter()
    where = f"phi {np.degrees(place[0]):.0f} deg, z {1e3 * place[1]:.1f} mm"
    crew.say("pick", f"{where}, {words}")
    pixel = crew.eye.pixel(place, *crew.angles.tolist())
    return crew.head.frame().image, np.asarray(pixel)


def centre(crew: Crew, place: FloatArray, step: str = "centre") -> None:
    """Bring a place on the wall to the middle of the image."""
    eye = crew.eye
    tracker = Tracker(eye)
    servo = Servo(eye, gain=0.8, delay=0.2, cone=CONE, soft=SOFT)
    pixel = np.asarray(eye.pixel(place, *crew.angles.tolist()))
    try:
        _, track = tracker.begin(crew.head.frame().image, pixel, *crew.angles.tolist())
    except SignalError:
        crew.turn(CONE.clip(crew.aim(place)))
        crew.say(step, "not whole in view; turned there by the joints alone")
        return
    state = servo.begin(crew.angles)
    error, held = np.nan, 0
    for _ in range(round(CENTRE_TIME / TICK)):
        now, track = tracker.step(track, crew.head.frame().image, *crew.angles.tolist())
        move, state = servo.step(state, now.pixel if now.verdict == TRACKED else None, crew.angles)
        error = move.error
        crew.tick(move.angles)
        held = held + 1 if now.verdict == TRACKED and error < IN_MIDDLE else 0
        if held == HELD:
            break
    crew.say(step, f"{error / 2:.2f} px from the middle of a 320 by 240 image")


def focus(crew: Crew) -> None:
    """Sweep the focus on the middle of the image."""
    hold, eye = crew.angles, crew.eye
    sight = Sight(crew.head, lambda: crew.tick(hold))
    middle = np.array([eye.lens.width / 2, eye.lens.height / 2])
    guess = wall_depth(eye, np.zeros(2), *crew.angles.tolist())
    found = autofocus(sight, eye, middle, float(np.clip(guess, 6e-3, 50e-3)))
    crew.say("focus", f"{1e3 * found.distance:.1f} mm, {found.verdict}")


def look_nearer(crew: Crew, place: FloatArray, by: float = NEAR) -> tuple[Findings, Photo]:
    """Come nearer by mm to what is in the middle, take five frames and a photo, and go back."""
    advance, roll = crew.place.tolist()
    crew.travel(advance + by, roll)
    crew.turn(CONE.clip(crew.aim(place)))
    crew.meter()
    looks, photo = crew.look(), crew.photo()
    crew.travel(advance, roll)
    return looks, photo


def extract(crew: Crew, picked: Hole) -> tuple[Findings, Hole, bool]:
    """The outline of a thing from nearer; whether it is there."""
    looks, _ = look_nearer(crew, picked.place)
    near = [h for h in looks.holes if distance(h.place, picked.place) < SAME]
    hole = max(near, key=lambda h: h.evidence) if near else picked
    words = "seen again from nearer" if near else "not seen again; the first look counts"
    crew.say("extract", f"{1e3 * hole.diameter:.2f} mm across, {words}")
    return looks, hole, bool(near)


def touch(crew: Crew, hole: Hole) -> tuple[npt.NDArray[np.uint8], float]:
    """Send the axis, along which the tool's point goes, to a thing; how far off it comes, in m."""
    crew.turn(CONE.clip(NEARER * crew.aim(hole.place)))
    crew.meter()
    centre(crew, hole.place, "return")
    phi, z = np.degrees(hole.place[0]), 1e3 * hole.place[1]
    crew.say("touch", f"the tool's point is sent to phi {phi:.1f} deg, z {z:.2f} mm")
    return crew.head.frame().image, crew.off_bore(crew.true_line())


def _ahead() -> float:
    """How far ahead of the head a thing is centred, in metres."""
    return float(RADIUS / np.tan(np.radians(CENTRED)))
