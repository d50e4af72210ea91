"""Inspection of the reachable wall by camera and probe, without an operator.

The head looks round, then visits each candidate: it is centred, and measured where it is seen
again. A hole that the centred view does not show is looked at once more under another angle,
because a far one is narrow there. What no other view shows is not confirmed, and told apart. So
is what could not be centred, and only pictures from one place show, unless echoes show a defect.
With a probe, what is confirmed is touched, scanned in the flooded pipe, and its depth is measured.
At the end the probe is rolled once round the pipe, which shows the level of the water.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Generic, TypeVar

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MinorloopError, OutputError, counted
from minorloop_head.geometry import Pinhole, wall_distance
from minorloop_head.procedures.extract import SAME, nearest
from minorloop_head.procedures.inspected_view import (
    AGAIN,
    AROUND,
    InspectedView,
    Unconfirmed,
    lens_words,
    unconfirmed,
    view_with,
    with_finding,
)
from minorloop_head.procedures.mark import aim_at
from minorloop_head.procedures.pictures import CRACK, InspectedPicture
from minorloop_head.procedures.probe_steps import counts_as_crack, drain, shown_by_echoes
from minorloop_head.procedures.probing import Probing
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import (
    NEAR,
    acquire,
    centre,
    go,
    look,
    meter,
    pick,
    place_words,
    search,
)
from minorloop_head.procedures.trace import (
    likely,
    one_course,
    traced_again,
    traces_of,
    whole_course,
    widest,
)
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.findings import UNDECIDED
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Findings, Hole, strongest
from minorloop_head.vision.frame_checks import GOOD

__all__ = ["inspect_wall", "unvisited", "views_of"]

NO_ECHO = "a line that one view on the way round showed, and no echo of its depth"
"""Why a line that was traced again is no finding."""
ONE_PLACE = "not centred, and shown by pictures from one place only, without an echo of a defect"
"""Why a candidate for a hole that was seen again from where it was seen first is no finding: a
stain looks the same from there."""
NOT_DONE = "not done"
"""First words of the outcome of a part that could not be computed; the inspection goes on."""
NOT_VISITED, SEEN_ONCE = "seen, not visited", "not seen again, not looked at once more"
"""Why candidates of an inspection that ended early, or has too many of them, are no findings."""
_DEFLECTION = math.radians(25.0)
"""Deflection of the views that look round: the head turns by up to 30."""
_FEWEST_VIEWS = 8
_MOST_HOLES, _MOST_CRACKS = 24, 8
"""Most candidates that are visited, the likeliest first: with 20 s each they take ten minutes."""


Candidate = TypeVar("Candidate", Hole, TracedCrack)


@dataclass(eq=False)
class _Seen:
    """A view with all that its search found."""

    name: str
    t: float
    image: Image
    found: Findings
    camera: CalibratedCamera
    angles: tuple[float, float]
    joints: tuple[float, float]
    place: tuple[float, float]
    steps: tuple[LogEntry, ...] = ()

    def view(self, *shown: Hole | TracedCrack) -> InspectedView:
        """Return the view with some of what was found."""
        view = InspectedView(
            picture=InspectedPicture(name=self.name, t=self.t, verdict=self.found.verdict),
            image=self.image,
            angles=self.angles,
            joints=self.joints,
            place=self.place,
            steps=self.steps,
        )
        return view_with(view, shown, self.camera)

    @property
    def missing(self) -> str:
        """Why a candidate is not confirmed."""
        if self.found.verdict == GOOD:
            return "not seen again"
        return f"the frames cannot be used: {self.found.verdict}"


@dataclass(frozen=True, eq=False)
class _Sighting(Generic[Candidate]):
    """A candidate on the way round, and the view that shows it."""

    shown: Candidate
    view: InspectedView


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


def inspect_wall(
    rig: InspectionRig,
    advances: Sequence[float] = (0.0,),
    done: Sequence[InspectedView] = (),
    probing: Probing | None = None,
) -> Iterator[InspectedView]:
    """Look round from each place, visit what was seen, and yield each view as it is searched.

    With a probe, the view of a finding is yielded again once it was scanned.

    Parameters
    ----------
    rig : InspectionRig
    advances : sequence of float
        Places of the catheter in metres. A head without one stays where it is.
    done : sequence of InspectedView
        Of an inspection of the same wall that was cut off: they are not taken again, nor yielded.
    probing : Probing, optional
        The probe of the head; without it only the camera is used.

    Raises
    ------
    InstrumentError
        If a device fails, a sensor is lost, or the camera gives no good picture for some time. What
        was yielded before stays valid.
    """
    radius = rig.calibration.radius
    known = {view.picture.name: view for view in done}
    if probing is not None:
        probing.begin(rig)
    views = yield from _looked_round(rig, advances, known)
    if unclear := rig.compute(lambda: lens_words(views)):
        rig.say("lens", unclear, succeeded=False)
    early = _early([*done, *views])
    holes = _sightings(views, Hole)
    found: list[Hole] = []
    best = _holes(holes, early, radius)
    _say_limit(rig, "holes", len(best), _MOST_HOLES)
    for k, hole in enumerate(best[:_MOST_HOLES], 1):
        if not _known(hole, found, radius):
            same = _same(hole, holes, radius)
            with _going_on(rig, f"hole {k}", probing):
                again = yield from _visited(rig, hole, same, f"hole {k}", known, probing)
                found += [] if again is None or _known(again, found, radius) else [again]
    traces = _sightings(views, TracedCrack)
    cracks: list[TracedCrack] = []
    courses = _courses(traces, early, radius)
    _say_limit(rig, "cracks", len(courses), _MOST_CRACKS)
    for k, trace in enumerate(courses[:_MOST_CRACKS], 1):
        if not any(one_course(trace.places, each.places, radius) for each in cracks):
            name, seen_in = f"crack {k}", _names(_alike(trace, traces, radius))
            with _going_on(rig, name, probing):
                if name not in known:
                    known[name] = _followed(rig, trace, seen_in, name)
                    yield known[name]
                yield from _probed(rig, known[name], probing, seen_in)
                cracks += [one for one in known[name].seen if isinstance(one, TracedCrack)]
    if probing is not None:
        places = [hole.place for hole in found] + [crack.places[0] for crack in cracks]
        ahead = advances[0] + radius / math.tan(_DEFLECTION)
        with _going_on(rig, "water line", probing):
            probing.roll_round(rig, float(places[0][1]) if places else ahead)


@contextmanager
def _going_on(rig: InspectionRig, part: str, probing: Probing | None) -> Iterator[None]:
    """Say why a part could not be computed, and go on; a device or a disk that fails ends all."""
    try:
        yield
    except (InstrumentError, OutputError):
        raise
    except (MinorloopError, ValueError, ArithmeticError) as error:
        rig.say(part, f"{NOT_DONE}: {error}", succeeded=False)
        if probing is not None:
            drain(rig)


def unvisited(views: Sequence[InspectedView], radius: float) -> list[Unconfirmed]:
    """Return what views show, and none of them visits, or visits twice without a finding.

    Parameters
    ----------
    views : sequence of InspectedView
        All of an inspection so far, in the order in which they were taken.
    radius : float
        Of the pipe, in metres.
    """
    names, early = {view.picture.name for view in views}, _early(views)
    around = [view for view in views if view.looks_round]
    visited = [one for view in views if not view.looks_round for one in view.seen]
    holes, traces = _sightings(around, Hole), _sightings(around, TracedCrack)
    found = [one for one in visited if isinstance(one, Hole)]
    left = []
    for k, hole in enumerate(_holes(holes, early, radius), 1):
        if f"hole {k}{AGAIN}" not in names and not _known(hole, found, radius):
            why = SEEN_ONCE if f"hole {k}" in names else NOT_VISITED
            left.append(unconfirmed(hole, _names(_same(hole, holes, radius)), why))
    cracks = [one for one in visited if isinstance(one, TracedCrack)]
    for k, trace in enumerate(_courses(traces, early, radius), 1):
        known = any(one_course(trace.places, each.places, radius) for each in cracks)
        if f"crack {k}" not in names and not known:
            left.append(unconfirmed(trace, _names(_alike(trace, traces, radius)), NOT_VISITED))
    return left


def _sightings(views: Sequence[InspectedView], kind: type[Candidate]) -> list[_Sighting[Candidate]]:
    """Return the candidates of a kind that views show."""
    return [_Sighting(one, view) for view in views for one in view.seen if isinstance(one, kind)]


def _early(views: Sequence[InspectedView]) -> set[str]:
    """Return the names of the views before the first visit: they number what is visited.

    What a view shows that is taken again after a visit comes after it.
    """
    return {view.picture.name for view in takewhile(lambda view: view.looks_round, views)}


def _holes(holes: Sequence[_Sighting[Hole]], early: set[str], radius: float) -> list[Hole]:
    """Return candidates in the order of their visits, those of early views first."""
    first, every = (
        strongest([each.shown for each in some], radius, -math.inf)
        for some in ([each for each in holes if each.view.picture.name in early], holes)
    )
    return [*first, *(hole for hole in every if not _known(hole, first, radius))]


def _courses(
    traces: Sequence[_Sighting[TracedCrack]], early: set[str], radius: float
) -> list[TracedCrack]:
    """Return courses in the order of their visits, those of early views first."""
    seen = [each.shown for each in traces if each.view.picture.name in early]
    first = [trace for trace, _ in likely(seen, (), radius)]
    later = likely([each.shown for each in traces], first, radius)
    return [*first, *(trace for trace, _ in later)]


def _same(hole: Hole, holes: Sequence[_Sighting[Hole]], radius: float) -> list[_Sighting[Hole]]:
    """Return the sightings of a hole."""
    return [each for each in holes if _known(each.shown, [hole], radius)]


def _alike(
    trace: TracedCrack, traces: Sequence[_Sighting[TracedCrack]], radius: float
) -> list[_Sighting[TracedCrack]]:
    """Return the sightings of a crack."""
    return [each for each in traces if one_course(each.shown.places, trace.places, radius)]


def _looked_round(
    rig: InspectionRig, advances: Sequence[float], known: dict[str, InspectedView]
) -> Generator[InspectedView, None, list[InspectedView]]:
    """Look round from each place, but for the known views; return all views."""
    views: list[InspectedView] = []
    for advance in advances:
        there = False
        for angles in views_of(rig.calibration.lens):
            name = f"{AROUND} {len(views) + 1}"
            if name not in known:
                if not there:
                    _go(rig, place=(advance, 0.0))
                there = look(rig, name, angles)
                rig.check_sensors()
                known[name] = _searched(rig, name)
                yield known[name]
            views.append(known[name])
    return views


def _searched(rig: InspectionRig, name: str) -> InspectedView:
    """Return a view with all candidates in it."""
    seen = _seen(rig, name)
    lines = rig.compute(lambda: traces_of(seen.found, rig.calibration.radius))
    many = f"{counted(len(seen.found.holes), 'candidate')}, {counted(len(lines), 'line')}"
    rig.say(name, many if seen.found.verdict == GOOD else seen.found.verdict)
    return seen.view(*seen.found.holes, *lines)


def _say_limit(rig: InspectionRig, what: str, count: int, most: int) -> None:
    if count > most:
        rig.say(what, f"{counted(count, 'candidate')}; the likeliest {most} are visited")


def _go(rig: InspectionRig, **where: object) -> None:
    """Move; an inspection does not go on with a sensor that failed."""
    go(rig, **where)  # type: ignore[arg-type]
    rig.check_sensors()


def _seen(rig: InspectionRig, name: str) -> _Seen:
    """Expose, take an acquisition and search it; take one that cannot be used once more."""
    for again in (True, False):
        meter(rig)
        frames, t, place = acquire(rig), rig.t, rig.place
        found = search(rig, frames)
        if found.verdict == GOOD or not again:
            break
        rig.say(name, f"{found.verdict}; taken once more")
    (advance, roll), view = place.tolist(), rig.calibration
    sight = frames[-1].pan, frames[-1].tilt
    pan, tilt = np.radians(view.joints(sight)).tolist()
    camera, image = view.camera_at(place), frames[-1].image
    return _Seen(name, t, image, found, camera, sight, (pan, tilt), (advance, roll))


def _known(hole: Hole, found: Sequence[Hole], radius: float) -> bool:
    return any(wall_distance(hole.place, other.place, radius) < SAME for other in found)


def _approached(
    rig: InspectionRig, place: FloatArray, words: str, name: str, *, outlined: bool = False
) -> _Seen:
    """Centre a place, go nearer if a catheter can, and search there."""
    begun = len(rig.log)
    pick(rig, place, words)
    centre(rig, place, outlined=outlined)
    rig.check_sensors()
    if rig.travels:
        _go(rig, place=np.add(rig.place, (NEAR, 0.0)))
        _go(rig, angles=aim_at(rig.calibration, place, rig.place))
    return replace(_seen(rig, name), steps=tuple(rig.log[begun:]))


def _visited(
    rig: InspectionRig,
    hole: Hole,
    same: Sequence[_Sighting[Hole]],
    name: str,
    known: Mapping[str, InspectedView],
    probing: Probing | None,
) -> Generator[InspectedView, None, Hole | None]:
    """Visit a candidate for a hole, twice if need be; return it if it is seen again."""
    view = known.get(name)
    if view is None:
        words = f"evidence {hole.evidence:+.1f}"
        seen = _approached(rig, hole.place, words, name, outlined=True)
        view = _seen_again(rig, seen, hole)
        if view.finding is None:
            rig.say(name, f"{seen.missing}; looked at once more")
        yield view
    if view.finding is None:
        name, before = f"{name}{AGAIN}", view.steps
        view = known.get(name)
        if view is None:
            seen = _from_aside(rig, next(each for each in same if each.shown is hole), name)
            seen = replace(seen, steps=before)
            view = _seen_again(rig, seen, hole)
            if view.finding is None:
                view = _not_confirmed(rig, seen, hole, _names(same))
            elif probing is None and _doubted(view):
                view = _withdrawn(rig, view, _names(same), ONE_PLACE)
            yield view
    yield from _probed(rig, view, probing, _names(same))
    return next((one for one in view.seen if isinstance(one, Hole)), None)


def _probed(
    rig: InspectionRig,
    view: InspectedView,
    probing: Probing | None,
    seen_in: tuple[str, ...],
) -> Iterator[InspectedView]:
    """Yield the view of a finding once more, with its depth, if there is a probe.

    A crack that only one of the views ``seen_in`` showed is not confirmed if no echo gives a depth,
    nor is a hole that was not centred if no echo shows it.
    """
    if probing is None or view.finding is None or view.probed is not None:
        return
    after = probing.scanned(rig, view)
    if isinstance(after.probed, CrackDepth):
        if not counts_as_crack(len(seen_in), after.probed):
            after = _withdrawn(rig, after, seen_in, f"{NO_ECHO}: {after.probed.verdict}")
    elif after.probed is not None and _doubted(view) and not shown_by_echoes(after.probed):
        after = _withdrawn(rig, after, seen_in, f"{ONE_PLACE}: {after.probed.verdict}")
    yield after


def _doubted(view: InspectedView) -> bool:
    """Return whether a visit saw a hole from where it was seen first, and could not centre it."""
    centred = all(step.succeeded for step in view.steps if step.what == "centre")
    return view.picture.name.endswith(AGAIN) and not centred


def _withdrawn(
    rig: InspectionRig, view: InspectedView, seen_in: tuple[str, ...], why: str
) -> InspectedView:
    """Return a view whose finding is not confirmed."""
    assert view.finding is not None
    kind = UNDECIDED if isinstance(view.seen[0], Hole) else CRACK
    rig.say(view.picture.name, f"{why}; not confirmed")
    lost = Unconfirmed(
        kind=kind,
        phi=view.finding.phi,
        z=view.finding.z,
        evidence=view.evidence,
        seen_in=seen_in,
        why=why,
    )
    return replace(view, finding=None, unconfirmed=lost)


def _seen_again(rig: InspectionRig, seen: _Seen, hole: Hole) -> InspectedView:
    """Return the view of a visit, with the hole as its finding if it is seen again."""
    again = nearest(seen.found.holes, hole.place, rig.calibration.radius)
    if again is None:
        return seen.view()
    rig.say(seen.name, f"{1e3 * again.diameter:.2f} mm wide at {place_words(again.place)}")
    return with_finding(seen.view(again), rig.calibration.radius)


def _from_aside(rig: InspectionRig, sighting: _Sighting[Hole], name: str) -> _Seen:
    """Search halfway between the view with the most evidence and the one that centres it.

    Neither of them is repeated, so that what is seen here too is no accident of one picture. It is
    from the place of the first.
    """
    _go(rig, place=sighting.view.place)
    centred = aim_at(rig.calibration, sighting.shown.place, rig.place)
    _go(rig, angles=(np.asarray(centred) + sighting.view.angles) / 2.0)
    return _seen(rig, name)


def _not_confirmed(
    rig: InspectionRig, seen: _Seen, shown: Hole | TracedCrack, names: tuple[str, ...]
) -> InspectedView:
    """Return the view of a visit with its candidate, which views show and this one does not."""
    view = seen.view()
    why = f"{seen.missing}; {view.failed}" if view.failed else seen.missing
    rig.say(seen.name, f"{why}; seen in {counted(len(names), 'view')}, not confirmed")
    return replace(view, unconfirmed=unconfirmed(shown, names, why))


def _names(same: Sequence[_Sighting[Candidate]]) -> tuple[str, ...]:
    """Return the names of the views that show a candidate."""
    return tuple(dict.fromkeys(each.view.picture.name for each in same))


def _followed(
    rig: InspectionRig, trace: TracedCrack, names: tuple[str, ...], name: str
) -> InspectedView:
    """Visit a candidate for a crack, and return the view."""
    radius = rig.calibration.radius
    seen = _approached(rig, trace.middle, f"a line of {1e3 * trace.length:.1f} mm", name)
    again = rig.compute(lambda: traced_again(seen.found, trace.places, radius))
    if not again:
        return _not_confirmed(rig, seen, trace, names)
    course = whole_course(max(again, key=lambda other: other.length), trace)
    _, width = widest(course)
    rig.say(name, f"{1e3 * course.length:.1f} mm long, {1e3 * width:.2f} mm at its widest")
    return with_finding(seen.view(course), radius)
