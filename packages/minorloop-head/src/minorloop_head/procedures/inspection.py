"""Inspection of the reachable wall by camera and probe, without an operator.

The head looks round, then centres each candidate, and measures it if the new view shows it again.
A hole that the centred view does not show is viewed once more from another angle, because a far
hole is narrow there. A candidate in only one view is listed apart as not confirmed. So is a
candidate that was not centred and is only in pictures from one place, unless echoes show a defect.
With a probe, each confirmed defect is touched, then scanned in the flooded pipe for its depth.
At the end the probe is rolled once round the pipe, which shows the level of the water.

These are the six steps of Boudjabi, Ferreira and Krupa, 2003, section 5.2: look round, centre,
focus, extract, scan by ultrasound, and merge both into a model; here without their supervisor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain, takewhile
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MinorloopError, OutputError, counted
from minorloop_head.geometry import Pinhole, wall_distance
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
from minorloop_head.procedures.probing import Kept, Probing
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
    SAME,
    likely,
    nearest,
    one_course,
    traced_again,
    traces_of,
    whole_course,
    widest,
)
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.findings import UNDECIDED
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Findings, Hole, strongest
from minorloop_head.vision.frame_checks import GOOD

NO_ECHO = "a line that one view on the way round showed, and no echo of its depth"
"""Reason why a line that was traced again does not count as a crack."""
ONE_PLACE = "not centred, and shown by pictures from one place only, without an echo of a defect"
"""Reason why a second view from the same place does not confirm a hole: a stain looks the same from
there."""
NOT_DONE = "not done"
"""Beginning of the outcome of a step that could not be computed; the inspection continues."""
NOT_VISITED, SEEN_ONCE = "seen, not visited", "not seen again, not looked at once more"
"""Reasons why candidates are not confirmed if the inspection ended early or has too many."""
_DEFLECTION = math.radians(25.0)
"""Deflection of the views that look round: the head turns by up to 30."""
_FEWEST_VIEWS = 8
_MOST_HOLES, _MOST_CRACKS = 24, 8
"""Largest number of visited candidates, likeliest first: at 20 s each they take ten minutes."""


_Defect: TypeAlias = Hole | TracedCrack


@dataclass(frozen=True, eq=False)
class _Seen:
    """An acquisition: its view without findings yet, its search result, and the camera there."""

    blank: InspectedView
    found: Findings
    camera: CalibratedCamera

    def view(self, *shown: _Defect) -> InspectedView:
        """Return the view with some of the found defects."""
        return view_with(self.blank, shown, self.camera)

    def after(self, steps: Sequence[LogEntry]) -> _Seen:
        """Return the acquisition with the steps that led to it."""
        return replace(self, blank=replace(self.blank, steps=tuple(steps)))

    @property
    def missing(self) -> str:
        """Reason why a candidate is not confirmed."""
        if self.found.verdict == GOOD:
            return "not seen again"
        return f"the frames cannot be used: {self.found.verdict}"


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A hole or a crack that views on the way round show."""

    name: str
    """Name of its visit."""
    shown: _Defect
    """Its surest sighting."""
    sightings: Sequence[tuple[_Defect, InspectedView]]
    """All of them, and the views that show them."""

    @property
    def seen_in(self) -> tuple[str, ...]:
        """Names of these views."""
        return tuple(dict.fromkeys(view.picture.name for _, view in self.sightings))


def views_of(lens: Pinhole) -> FloatArray:
    """Return pan and tilt (N, 2) in radians of views that show all of the wall within reach.

    Neighbours overlap by half of a picture, or by more.
    """
    half = math.atan(min(lens.width / lens.focals[0], lens.height / lens.focals[1]) / 2)
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
    kept: Kept | None = None,
    *,
    unscanned: str | None = None,
) -> Kept:
    """Look round from each place, visit each candidate, and return all kept results.

    Each view is kept as soon as it is searched; with a probe, the view of a finding once more after
    its scan.

    Raises an `InstrumentError` if a device fails, a sensor is lost, or the camera gives no good
    picture for some time. Results that were kept before stay valid.

    ``advances``: places of the catheter in metres. A head without one stays where it is. ``kept``:
    of an interrupted inspection of the same wall: its results are not measured again.
    ``unscanned``: why the probe of the head scans nothing, as of `Probing`; without it only the
    camera is used.
    """
    kept = kept or Kept()
    probing = None if unscanned is None else Probing(rig, kept, unscanned)
    visits = _Visits(rig, kept, probing)
    if probing is not None:
        probing.begin()
    views = _look_round(rig, advances, kept)
    if unclear := rig.compute(lambda: lens_words(views)):
        rig.say("lens", unclear, succeeded=False)
    holes, cracks = _candidates([*kept.views.values()], rig.calibration.radius)
    found = visits.each(holes, _MOST_HOLES) + visits.each(cracks, _MOST_CRACKS)
    if probing is not None:
        ahead = advances[0] + rig.calibration.radius / math.tan(_DEFLECTION)
        places = [one.place if isinstance(one, Hole) else one.places[0] for one in found]
        with visits.going_on("water line"):
            probing.roll_round(float(places[0][1]) if places else ahead)
    return kept


@dataclass(frozen=True, eq=False)
class _Visits:
    """Visits candidates with a rig and its probe, if it has one, and keeps the views."""

    rig: InspectionRig
    kept: Kept
    probing: Probing | None

    @contextmanager
    def going_on(self, part: str) -> Iterator[None]:
        """Log why a part could not be computed, and continue; failed devices or disks raise."""
        try:
            yield
        except (InstrumentError, OutputError):
            raise
        except (MinorloopError, ValueError, ArithmeticError) as error:
            self.rig.say(part, f"{NOT_DONE}: {error}", succeeded=False)
            if self.probing is not None:
                drain(self.rig)

    def each(self, candidates: Sequence[_Candidate], most: int) -> list[_Defect]:
        """Visit the first ``most`` candidates, and return those that are seen again."""
        if len(candidates) > most:
            word = candidates[0].name.partition(" ")[0]
            many = counted(len(candidates), "candidate")
            self.rig.say(f"{word}s", f"{many}; the likeliest {most} are visited")
        found: list[_Defect] = []
        for one in candidates[:most]:
            if not _known(one.shown, found, self.rig.calibration.radius):
                with self.going_on(one.name):
                    view = self._visit(one)
                    self._probe(view, one.seen_in)
                    found += view.seen
        return found

    def _visit(self, one: _Candidate) -> InspectedView:
        """Visit a candidate, a hole twice if need be, and return the view that shows it or not."""
        shown, name, seen_in = one.shown, one.name, one.seen_in
        if isinstance(shown, TracedCrack):
            return self.kept.view(name, lambda: _visit_crack(self.rig, shown, seen_in, name))
        view = self.kept.view(name, lambda: self._centred(shown, name))
        if view.finding is not None:
            return view
        again, before = f"{name}{AGAIN}", view.steps
        return self.kept.view(again, lambda: self._view_from_aside(shown, one, again, before))

    def _centred(self, hole: Hole, name: str) -> InspectedView:
        """Return the view that centres a candidate for a hole."""
        words = f"evidence {hole.evidence:+.1f}"
        seen = _approach(self.rig, hole.place, words, name, outlined=True)
        view = _seen_again(self.rig, seen, hole)
        if view.finding is None:
            self.rig.say(name, f"{seen.missing}; looked at once more")
        return view

    def _view_from_aside(
        self, hole: Hole, one: _Candidate, name: str, before: tuple[LogEntry, ...]
    ) -> InspectedView:
        """Return a view of a hole from halfway between its surest view and its centred view.

        It repeats neither view, so that no accident of one picture confirms a hole. The catheter is
        where the surest view was taken; the steps ``before`` precede those of this view.
        """
        rig, first = self.rig, next(view for shown, view in one.sightings if shown is hole)
        _go(rig, place=first.place)
        centred = aim_at(rig.calibration, hole.place, rig.place)
        _go(rig, angles=(np.asarray(centred) + first.angles) / 2.0)
        seen = _seen(rig, name).after(before)
        view = _seen_again(rig, seen, hole)
        if view.finding is None:
            return _not_confirmed(rig, seen, hole, one.seen_in)
        if self.probing is None and _doubted(view):
            return _reject(rig, view, one.seen_in, ONE_PLACE)
        return view

    def _probe(self, view: InspectedView, seen_in: tuple[str, ...]) -> None:
        """Keep the view of a finding once more, with its depth, if there is a probe.

        A crack that only one of the views ``seen_in`` showed is not confirmed if no echo gives a
        depth, nor is a hole that was not centred if no echo shows it.
        """
        if self.probing is None or view.finding is None or view.probed is not None:
            return
        after = self.probing.scanned(view)
        if isinstance(after.probed, CrackDepth):
            if not counts_as_crack(len(seen_in), after.probed):
                why = f"{NO_ECHO}: {after.probed.verdict}"
                after = _reject(self.rig, after, seen_in, why)
        elif after.probed is not None and _doubted(view) and not shown_by_echoes(after.probed):
            after = _reject(self.rig, after, seen_in, f"{ONE_PLACE}: {after.probed.verdict}")
        self.kept.add_view(after)


def unvisited(views: Sequence[InspectedView], radius: float) -> list[Unconfirmed]:
    """Return the candidates in views that have no visit, or no finding and no second visit.

    ``views``: all of an inspection so far, in the order in which they were taken; ``radius``: of
    the pipe, in metres.
    """
    names = {view.picture.name for view in views}
    visited = [one for view in views if not view.looks_round for one in view.seen]
    left = []
    for one in chain(*_candidates(views, radius)):
        last = f"{one.name}{AGAIN}" if isinstance(one.shown, Hole) else one.name
        if last not in names and not _known(one.shown, visited, radius):
            why = SEEN_ONCE if one.name in names else NOT_VISITED
            left.append(unconfirmed(one.shown, one.seen_in, why))
    return left


def _candidates(
    views: Sequence[InspectedView], radius: float
) -> tuple[list[_Candidate], list[_Candidate]]:
    """Return the candidates for holes and for cracks, each in the order of their visits.

    Those of views before the first visit come first: a view that is taken again after a visit does
    not change their numbers.
    """
    around = [(one, view) for view in views if view.looks_round for one in view.seen]
    early = [one for view in takewhile(lambda view: view.looks_round, views) for one in view.seen]

    def numbered(word: str, kind: type[_Defect]) -> list[_Candidate]:
        every = [(one, view) for one, view in around if isinstance(one, kind)]
        first = _distinct([one for one in early if isinstance(one, kind)], radius)
        later = _distinct([one for one, _ in every], radius)
        order = [*first, *(one for one in later if not _known(one, first, radius))]
        same = [[each for each in every if _known(each[0], [one], radius)] for one in order]
        found = enumerate(zip(order, same, strict=True), 1)
        return [_Candidate(f"{word} {k}", one, sightings) for k, (one, sightings) in found]

    return numbered("hole", Hole), numbered("crack", TracedCrack)


def _distinct(shown: Sequence[_Defect], radius: float) -> list[_Defect]:
    """Return one of each hole or crack that several views may show, the likeliest first."""
    holes = [one for one in shown if isinstance(one, Hole)]
    cracks = [one for one in shown if isinstance(one, TracedCrack)]
    return [*strongest(holes, radius, -math.inf), *(one for one, _ in likely(cracks, (), radius))]


def _known(one: _Defect, others: Sequence[_Defect], radius: float) -> bool:
    """Return whether a hole or a crack is one of others."""
    if isinstance(one, Hole):
        places = [other.place for other in others if isinstance(other, Hole)]
        return any(wall_distance(one.place, place, radius) < SAME for place in places)
    courses = [other.places for other in others if isinstance(other, TracedCrack)]
    return any(one_course(one.places, course, radius) for course in courses)


def _look_round(rig: InspectionRig, advances: Sequence[float], kept: Kept) -> list[InspectedView]:
    """Look round from each place, except for kept views; return all views."""
    views: list[InspectedView] = []
    for advance in advances:
        there = False
        for angles in views_of(rig.calibration.lens):
            name = f"{AROUND} {len(views) + 1}"
            if name not in kept.views:
                if not there:
                    _go(rig, place=(advance, 0.0))
                there = look(rig, name, angles)
                rig.check_sensors()
                kept.add_view(_search_view(rig, name))
            views.append(kept.views[name])
    return views


def _search_view(rig: InspectionRig, name: str) -> InspectedView:
    """Return a view with all candidates in it."""
    seen = _seen(rig, name)
    lines = rig.compute(lambda: traces_of(seen.found, rig.calibration.radius))
    many = f"{counted(len(seen.found.holes), 'candidate')}, {counted(len(lines), 'line')}"
    rig.say(name, many if seen.found.verdict == GOOD else seen.found.verdict)
    return seen.view(*seen.found.holes, *lines)


def _go(rig: InspectionRig, **where: object) -> None:
    """Move; raise an `InstrumentError` if a sensor failed."""
    go(rig, **where)  # type: ignore[arg-type]
    rig.check_sensors()


def _seen(rig: InspectionRig, name: str) -> _Seen:
    """Expose, take an acquisition and search it; retake an unusable one once."""
    for again in (True, False):
        meter(rig)
        frames, t, place = acquire(rig), rig.t, rig.place
        found = search(rig, frames)
        if found.verdict == GOOD or not again:
            break
        rig.say(name, f"{found.verdict}; taken once more")
    view, last = rig.calibration, frames[-1]
    (advance, roll), sight = place.tolist(), (last.pan, last.tilt)
    pan, tilt = np.radians(view.joints(sight)).tolist()
    blank = InspectedView(
        picture=InspectedPicture(name=name, t=t, verdict=found.verdict),
        image=last.image,
        angles=sight,
        joints=(pan, tilt),
        place=(advance, roll),
    )
    return _Seen(blank, found, view.camera_at(place))


def _approach(
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
    return _seen(rig, name).after(rig.log[begun:])


def _doubted(view: InspectedView) -> bool:
    """Return whether a visit saw a hole from the place of its first view, without centring it."""
    centred = all(step.succeeded for step in view.steps if step.what == "centre")
    return view.picture.name.endswith(AGAIN) and not centred


def _reject(
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
    rig.say(
        seen.blank.picture.name, f"{1e3 * again.diameter:.2f} mm wide at {place_words(again.place)}"
    )
    return with_finding(seen.view(again), rig.calibration.radius)


def _not_confirmed(
    rig: InspectionRig, seen: _Seen, shown: _Defect, names: tuple[str, ...]
) -> InspectedView:
    """Return the view of a visit that does not show its candidate, which other views show."""
    view = seen.view()
    why = f"{seen.missing}; {view.failed}" if view.failed else seen.missing
    rig.say(seen.blank.picture.name, f"{why}; seen in {counted(len(names), 'view')}, not confirmed")
    return replace(view, unconfirmed=unconfirmed(shown, names, why))


def _visit_crack(
    rig: InspectionRig, trace: TracedCrack, names: tuple[str, ...], name: str
) -> InspectedView:
    """Visit a candidate for a crack, and return the view."""
    radius = rig.calibration.radius
    seen = _approach(rig, trace.middle, f"a line of {1e3 * trace.length:.1f} mm", name)
    again = rig.compute(lambda: traced_again(seen.found, trace.places, radius))
    if not again:
        return _not_confirmed(rig, seen, trace, names)
    course = whole_course(max(again, key=lambda other: other.length), trace)
    _, width = widest(course)
    rig.say(name, f"{1e3 * course.length:.1f} mm long, {1e3 * width:.2f} mm at its widest")
    return with_finding(seen.view(course), radius)
