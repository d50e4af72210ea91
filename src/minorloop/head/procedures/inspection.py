"""Inspection of the reachable wall by the camera alone, without an operator.

The head looks round, then visits each candidate: it is centred, and measured where it is seen
again. A hole that the centred view does not show is looked at once more from another side, because
a far one is narrow there. What no other view shows is not confirmed, and told apart. There is no
probe, so that depths stay unknown.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import counted
from minorloop.head.geometry import Pinhole, wall_distance
from minorloop.head.procedures.extract import SAME, nearest
from minorloop.head.procedures.mark import aim_at
from minorloop.head.procedures.pictures import (
    CRACK,
    InspectedPicture,
    PictureFinding,
    crack_in,
    hole_in,
)
from minorloop.head.procedures.rig import InspectionRig
from minorloop.head.procedures.steps import NEAR, acquire, centre, go, meter, pick, search
from minorloop.head.procedures.trace import (
    likely,
    one_course,
    traced_again,
    traces_of,
    whole_course,
    widest,
)
from minorloop.head.reconstruction.findings import UNDECIDED, Finding, outlined
from minorloop.head.ultrasound.crack_depth import CrackDepth, crack_finding
from minorloop.head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop.head.vision.cracks import TracedCrack
from minorloop.head.vision.defects import Findings, Hole, strongest
from minorloop.head.vision.frame_checks import GOOD
from minorloop.head.vision.reflectance_map import LitFrame

__all__ = ["InspectedView", "Unconfirmed", "inspect_wall", "views_of"]

NO_PROBE = "no probe"
"""Verdict of the echoes of each finding."""
_DEFLECTION = math.radians(25.0)
"""Deflection of the views that look round: the head turns by up to 30."""
_FEWEST_VIEWS = 8
_MOST_HOLES, _MOST_CRACKS = 24, 8
"""Most candidates that are visited, the likeliest first: with 20 s each they take ten minutes."""


Candidate = TypeVar("Candidate", Hole, TracedCrack)


@dataclass(frozen=True, kw_only=True)
class Unconfirmed:
    """A candidate that was visited and not seen again.

    Parameters
    ----------
    kind : str
        ``hole or pit``, or ``crack``.
    phi, z : float
        Place on the wall, in radians and metres.
    evidence : float
        The largest of its views, as of a `Hole`; NaN for a crack.
    seen_in : tuple of str
        Names of the views that show it there.
    why : str
        What its visit showed instead.
    """

    kind: str
    phi: float
    z: float
    evidence: float
    seen_in: tuple[str, ...]
    why: str


@dataclass(frozen=True, eq=False, kw_only=True)
class InspectedView:
    """One acquisition of an inspection.

    Parameters
    ----------
    picture : InspectedPicture
        What it shows: candidates on the way round, and then the one that was visited.
    image : (height, width) array of uint8
        Under all lights.
    angles : (float, float)
        Pan and tilt of the line of sight, in radians.
    joints : (float, float)
        Pan and tilt that the joints read there, in radians, as a file of poses has them.
    place : (float, float)
        Advance in metres and roll in radians of the catheter.
    finding : Finding, optional
        The candidate that was visited, if it was seen again.
    evidence : float
        Of the finding, as of a `Hole`; NaN for a crack.
    course : (N, 2) array
        Phi and z along the rim of a hole, or along a crack.
    unconfirmed : Unconfirmed, optional
        The candidate that was visited, if it was not seen again.
    """

    picture: InspectedPicture
    image: Image
    angles: tuple[float, float]
    joints: tuple[float, float]
    place: tuple[float, float]
    finding: Finding | None = None
    evidence: float = math.nan
    course: FloatArray | None = None
    unconfirmed: Unconfirmed | None = None


@dataclass(eq=False)
class _Seen:
    """A view with its findings."""

    name: str
    t: float
    frames: Sequence[LitFrame]
    found: Findings
    camera: CalibratedCamera
    joints: tuple[float, float]
    place: tuple[float, float]

    @property
    def angles(self) -> tuple[float, float]:
        return self.frames[-1].pan, self.frames[-1].tilt

    def view(self, *shown: PictureFinding) -> InspectedView:
        """Return the view with some of its findings."""
        picture = InspectedPicture(
            name=self.name, t=self.t, verdict=self.found.verdict, findings=shown
        )
        return InspectedView(
            picture=picture,
            image=self.frames[-1].image,
            angles=self.angles,
            joints=self.joints,
            place=self.place,
        )

    def sighting(self, shown: Candidate) -> _Sighting[Candidate]:
        """Return one of its findings with what is needed to look from here again."""
        return _Sighting(shown, self.name, self.angles, self.place)

    @property
    def missing(self) -> str:
        """Why a candidate is not confirmed."""
        if self.found.verdict == GOOD:
            return "not seen again"
        return f"the frames cannot be used: {self.found.verdict}"

    def hole(self, hole: Hole) -> PictureFinding:
        return hole_in(hole, self.camera, self.angles)

    def crack(self, crack: TracedCrack) -> PictureFinding:
        return crack_in(crack, self.camera, self.angles)


@dataclass(frozen=True, eq=False)
class _Sighting(Generic[Candidate]):
    """A candidate on the way round, and the view that shows it."""

    shown: Candidate
    view: str
    angles: tuple[float, float]
    place: tuple[float, float]


def views_of(lens: Pinhole) -> FloatArray:
    """Return pan and tilt (N, 2) in radians of views that show all of the wall within reach.

    Neighbours overlap by half of a picture, or by more.
    """
    half = math.atan(min(lens.width, lens.height) / 2 / lens.focal)
    rings, deflection = [], _DEFLECTION
    while deflection > 0.0:
        count = max(_FEWEST_VIEWS, math.ceil(2 * math.pi * math.sin(deflection) / half))
        way = 2 * np.pi * np.arange(count) / count
        rings.append(deflection * np.stack([np.cos(way), np.sin(way)], axis=1))
        deflection -= 1.5 * half
    return np.concatenate(rings)


def inspect_wall(rig: InspectionRig, advances: Sequence[float] = (0.0,)) -> Iterator[InspectedView]:
    """Look round from each place, visit what was seen, and yield each view as it is searched.

    Parameters
    ----------
    rig : InspectionRig
    advances : sequence of float
        Places of the catheter in metres. A head without one stays where it is.

    Raises
    ------
    InstrumentError
        If a device fails, a sensor is lost, or the camera gives no good picture for some time. What
        was yielded before stays valid.
    """
    radius = rig.calibration.radius
    holes: list[_Sighting[Hole]] = []
    traces: list[_Sighting[TracedCrack]] = []
    number = 0
    for advance in advances:
        _go(rig, place=(advance, 0.0))
        for angles in views_of(rig.calibration.lens):
            number += 1
            _go(rig, angles=angles)
            seen = _seen(rig, f"view {number}")
            lines = _traced(rig, seen.found)
            holes += [seen.sighting(hole) for hole in seen.found.holes]
            traces += [seen.sighting(line) for line in lines]
            many = f"{counted(len(seen.found.holes), 'candidate')}, {counted(len(lines), 'line')}"
            rig.say(seen.name, many if seen.found.verdict == GOOD else seen.found.verdict)
            yield seen.view(*map(seen.hole, seen.found.holes), *map(seen.crack, lines))
    found: list[Hole] = []
    best = strongest([each.shown for each in holes], radius, -math.inf)
    _say_limit(rig, "holes", len(best), _MOST_HOLES)
    for k, hole in enumerate(best[:_MOST_HOLES], 1):
        if not _known(hole, found, radius):
            same = [each for each in holes if _known(each.shown, [hole], radius)]
            again = yield from _visited(rig, hole, same, f"hole {k}")
            found += [] if again is None or _known(again, found, radius) else [again]
    cracks: list[TracedCrack] = []
    courses = [trace for trace, _ in likely([each.shown for each in traces], (), radius)]
    _say_limit(rig, "cracks", len(courses), _MOST_CRACKS)
    for k, trace in enumerate(courses[:_MOST_CRACKS], 1):
        if not any(one_course(trace.places, known.places, radius) for known in cracks):
            names = [e.view for e in traces if one_course(e.shown.places, trace.places, radius)]
            view, crack = _followed(rig, trace, names, f"crack {k}")
            cracks += [] if crack is None else [crack]
            yield view


def _say_limit(rig: InspectionRig, what: str, count: int, most: int) -> None:
    if count > most:
        rig.say(what, f"{counted(count, 'candidate')}; the likeliest {most} are visited")


def _go(rig: InspectionRig, **where: object) -> None:
    """Move; an inspection does not go on with a sensor that failed."""
    go(rig, **where)  # type: ignore[arg-type]
    rig.check_sensors()


def _seen(rig: InspectionRig, name: str) -> _Seen:
    """Expose, take an acquisition and search it."""
    meter(rig)
    frames, t, place = acquire(rig), rig.t, rig.place
    found = search(rig, frames)
    (advance, roll), view = place.tolist(), rig.calibration
    pan, tilt = np.radians(view.joints((frames[-1].pan, frames[-1].tilt))).tolist()
    return _Seen(name, t, frames, found, view.camera_at(place), (pan, tilt), (advance, roll))


def _traced(rig: InspectionRig, found: Findings) -> tuple[TracedCrack, ...]:
    return rig.compute(lambda: traces_of(found, rig.calibration.radius))


def _known(hole: Hole, found: Sequence[Hole], radius: float) -> bool:
    return any(wall_distance(hole.place, other.place, radius) < SAME for other in found)


def _approached(
    rig: InspectionRig, place: FloatArray, words: str, name: str, *, outlined: bool = False
) -> _Seen:
    """Centre a place, go nearer if a catheter can, and search there."""
    pick(rig, place, words)
    centre(rig, place, outlined=outlined)
    rig.check_sensors()
    if rig.travels:
        _go(rig, place=np.add(rig.place, (NEAR, 0.0)))
        _go(rig, angles=aim_at(rig.calibration, place, rig.place))
    return _seen(rig, name)


def _visited(
    rig: InspectionRig, hole: Hole, same: Sequence[_Sighting[Hole]], name: str
) -> Generator[InspectedView, None, Hole | None]:
    """Visit a candidate for a hole, from two sides if need be; return it if it is seen again."""
    radius = rig.calibration.radius
    words = f"evidence {hole.evidence:+.1f}"
    seen = _approached(rig, hole.place, words, name, outlined=True)
    again = nearest(seen.found.holes, hole.place, radius)
    if again is None:
        rig.say(name, f"{seen.missing}; looked at from another side")
        yield seen.view()
        seen = _from_aside(rig, next(each for each in same if each.shown is hole), f"{name} again")
        again = nearest(seen.found.holes, hole.place, radius)
    if again is None:
        names = tuple(dict.fromkeys(each.view for each in same))
        phi, z = hole.place.tolist()
        lost = Unconfirmed(
            kind=UNDECIDED, phi=phi, z=z, evidence=hole.evidence, seen_in=names, why=seen.missing
        )
        rig.say(seen.name, f"{seen.missing}; {_not_confirmed(names)}")
        yield replace(seen.view(), unconfirmed=lost)
        return None
    phi, z = again.place.tolist()
    where = f"phi {math.degrees(phi):.1f} deg, z {1e3 * z:.2f} mm"
    rig.say(seen.name, f"{1e3 * again.diameter:.2f} mm wide at {where}")
    yield replace(
        seen.view(seen.hole(again)),
        finding=outlined(phi, z, again.diameter, NO_PROBE, radius=radius),
        evidence=again.evidence,
        course=again.rim,
    )
    return again


def _from_aside(rig: InspectionRig, sighting: _Sighting[Hole], name: str) -> _Seen:
    """Search halfway between the view with the most evidence and the one that centres it.

    Neither of them is repeated, so that what is seen here too is no accident of one picture.
    """
    _go(rig, place=sighting.place)
    centred = aim_at(rig.calibration, sighting.shown.place, rig.place)
    _go(rig, angles=(np.asarray(centred) + sighting.angles) / 2.0)
    return _seen(rig, name)


def _not_confirmed(names: Sequence[str]) -> str:
    return f"seen in {counted(len(names), 'view')}, not confirmed"


def _followed(
    rig: InspectionRig, trace: TracedCrack, names: Sequence[str], name: str
) -> tuple[InspectedView, TracedCrack | None]:
    """Visit a candidate for a crack; return its course if it is seen again."""
    radius = rig.calibration.radius
    middle = trace.places[len(trace.places) // 2]
    seen = _approached(rig, middle, f"a line of {1e3 * trace.length:.1f} mm", name)
    again = rig.compute(lambda: traced_again(seen.found, trace.places, radius))
    if not again:
        once = tuple(dict.fromkeys(names))
        phi, z = middle.tolist()
        lost = Unconfirmed(
            kind=CRACK, phi=phi, z=z, evidence=math.nan, seen_in=once, why=seen.missing
        )
        rig.say(name, f"{seen.missing}; {_not_confirmed(once)}")
        return replace(seen.view(), unconfirmed=lost), None
    course = whole_course(max(again, key=lambda other: other.length), trace)
    _, width = widest(course)
    rig.say(name, f"{1e3 * course.length:.1f} mm long, {1e3 * width:.2f} mm at its widest")
    view = replace(
        seen.view(seen.crack(course)),
        finding=crack_finding(course.places, width, CrackDepth(NO_PROBE), radius),
        course=course.places,
    )
    return view, course
