"""Follow a patch of the wall from frame to frame.

The patch and those around it are stored at their places on the cylinder of the wall, where turns
and smaller distances do not change them. The angles of the head give the expected place in a frame;
a further turn, at which all patches agree with the frame, corrects errors of the angles. A patch
that moves against its surroundings is lost, not tracked. When the head sees the wall from
elsewhere, a further view is stored; the first one stays, so that the place does not drift. After a
loss the search widens until the patch is found again::

    tracker = PatchTracker(camera)
    track, state = tracker.begin(frame.image, pixel, pan, tilt)
    while ...:
        track, state = tracker.step(state, frame.image, pan, tilt)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.geometry import wall_point
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.imaging import Image32
from minorloop_head.vision.patch_pictures import PatchPictures
from minorloop_head.vision.reflectance_map import NO_ANGLE, finite_angles
from minorloop_head.vision.wall_patches import Patches

TRACKED, LOST, _OUT_OF_VIEW = "tracked", "lost", "out of view"
AMBIGUOUS, APART, _JUMPED = "several alike", "apart from its surroundings", "jumped"
"""Verdicts of a step; others are those of ``frame_checks``."""

SURELY = 0.6
"""Least correlation at which the patch itself gives its place; its surroundings give it below."""
_FRESH = 0.2
"""Least turn in radians from all views for a new one. By trial: with 0.07 a patch drifts by twice
as much, since a view repeats the error of its match."""
_SIZE, _AROUND = 1.6e-3, 2
"""Side of a patch in metres, and number of patches to each side of the tracked one."""
_SHOWN = 0.45
"""Least distance of a picked point from the edge of a frame, in sides of a patch."""
_REACH, _WIDEST = 0.8e-3, 8e-3
"""First and last range of the search for a lost patch, in metres."""
_LEAST, _AGAIN = 0.55, 0.4
"""Least correlation of a patch that agrees, and of one in two halves of a picture."""
_SHARE = 0.4
"""Least share of the patches in view that agree."""
_ALONE = 0.75
"""Largest correlation elsewhere, as a share of the best, for a lost patch to be found."""
_APART, _VAGUE = 0.1e-3, 0.05e-3
"""Largest distance of the patch from its place by the surroundings, and largest standard deviation
of its place, in metres."""
_JUMP = 0.7e-3
"""Largest distance in metres from the expected place that is accepted at once; a larger one is
accepted if the next frame confirms it."""
_MOST_VIEWS = 24
"""Largest number of stored views."""
_FEWEST = 4
"""Least contrast of surrounding patches that locate a patch without detail of its own."""
_DETAIL = 0.025
"""Least contrast of a patch that is not dirt on the lens. On four walls with hardly any texture
(seeds 1000 to 1003), spots on the lens gave up to 0.022; on drawn walls the least was 0.03."""
_BORDER, _EDGE = 4.0, 45.0
"""Distances from the edge of a frame in pixels within which a patch is out of view, and a lost one
is not searched."""
_FADE = 0.5  # damping of the drift
_WHOLE = 0.7
"""Least share of agreeing patches for a new view to be stored."""
_HIDDEN = 0.5
"""Share of its usual correlation below which a patch is hidden while its surroundings agree."""
_USUAL = 0.1
"""Weight of a new frame in the usual correlation: light changes it over some frames."""
_GRID = 0.4e-3
"""Distance on the wall, in metres, between tried angles in the search for a lost patch."""
_NEAR = 2.1
"""Number of these steps that belong to one peak."""


@dataclass(frozen=True, eq=False)
class Track:
    """Place of the patch."""

    pixel: FloatArray
    """Shape (2,). Column and row in the frame; if the patch is not tracked, those expected by the
    angles."""
    place: FloatArray
    """Shape (2,). Phi and z on the wall, for the measured angles."""
    score: float
    """Correlation with the patch, up to 1; NaN without a search."""
    verdict: str
    """``tracked``, ``lost``, ``out of view``, ``several alike``, ``apart from its surroundings``,
    ``jumped``, ``angle unknown``, or the fault of the frame."""


@dataclass(frozen=True, eq=False)
class TrackState:
    """State of a tracker."""

    views: tuple[Patches, ...]
    """Views of the patch and those around it, first the picked view."""
    own: Patches
    """The picked view of the patch itself in detail; no patches if it has too little texture."""
    home: FloatArray
    """Shape (2,). Phi and z of the patch when it was picked."""
    place: FloatArray
    """Shape (2,). Its last phi and z, for the measured angles."""
    turn: FloatArray
    """Shape (2,). Correction of the measured angles, in radians: it puts the patch at its home."""
    drift: FloatArray
    """Shape (2,). Change of the turn from frame to frame."""
    missed: int
    """Number of frames since it was tracked."""
    before: Image
    """Shape (height, width). The last frame."""
    earlier: tuple[int, ...] = ()
    """Check sums of the last frames, to detect repeated ones."""
    usual: float = 0.0
    """Average correlation with the patch itself while it was tracked; 0 before the second frame."""


@dataclass(frozen=True, eq=False)
class _Found:
    """A match: angles of the head at which the frame shows the patch, and its quality.

    ``whole`` says whether most of the patches around are in view and agree.
    """

    angles: FloatArray
    score: float
    verdict: str
    whole: bool


@dataclass(frozen=True, eq=False)
class PatchTracker:
    """Tracker that aligns a patch of the wall and its neighbours, see `PatchPictures`."""

    camera: CalibratedCamera
    """The camera."""

    @cached_property
    def pictures(self) -> PatchPictures:
        """Comparison of patches with pictures of this camera."""
        return PatchPictures(self.camera, _SIZE, _LEAST, width=320.0)

    @cached_property
    def details(self) -> PatchPictures:
        """Comparison of the tracked patch in detail with pictures."""
        return PatchPictures(self.camera, _SIZE, _LEAST, side=32, width=640.0, detail=_DETAIL)

    def begin(
        self, image: Image, pixel: npt.ArrayLike, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Pick the patch about a (2,) pixel of a frame.

        Raises a `SignalError` if the frame is not from this camera, is black, does not show the
        whole patch, or shows too little detail for its noise, in the patch and about it.
        """
        self.camera.check(image)
        if frame_checks.check_frame(image, self.camera.lens) == frame_checks.BLACK:
            raise SignalError("the frame is black; switch the lights on before a patch is picked")
        place, angles = self.camera.place(pixel, pan, tilt), np.array([pan, tilt])
        u, v = np.asarray(pixel, dtype=np.float64)
        sides = place + _SHOWN * (self._places(place, 1)[1::2] - place)
        if not self._inside(self.camera.pixel(sides, pan, tilt), 0.0):
            raise SignalError(
                f"the frame does not show {1e3 * _SIZE:.3g} mm of wall about pixel "
                f"({u:.0f}, {v:.0f}); pick a point further from its edge"
            )
        view = self._view(self.pictures, image, place, angles)
        own = _patches_shown(self.details, image, place[None], angles, _AGAIN)
        clear = self._view(replace(self.pictures, detail=_DETAIL), image, place, angles)
        if not len(view.sd) or (not len(own.sd) and len(clear.sd) < _FEWEST):
            raise SignalError(
                f"the wall about pixel ({u:.0f}, {v:.0f}) has too little texture for its noise, "
                f"two halves of the frame correlate by less than {_AGAIN}; pick a point with "
                "texture, or set focus, lights and gain"
            )
        still, (_, sums) = np.zeros(2), frame_checks.repeated(image, ())
        state = TrackState((view,), own, place, place, still, still, 0, image, sums)
        return Track(np.array([u, v]), place, 1.0, TRACKED), state

    def step(
        self, state: TrackState, image: Any, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Find the patch in the next frame; a bad frame gives a verdict, not an error.

        ``image`` (height, width): the frame. ``pan`` and ``tilt``: of the head when the frame was
        taken, measured or commanded, in radians; without finite numbers the verdict is ``angle
        unknown``.
        """
        verdict = frame_checks.check_frame(image, self.camera.lens, state.before)
        known = finite_angles(pan, tilt)
        given = np.array([pan, tilt] if known else [math.nan, math.nan])
        if verdict != frame_checks.WRONG_SIZE:
            again, earlier = frame_checks.repeated(image, state.earlier)
            verdict = frame_checks.FROZEN if again else verdict
            state = replace(state, earlier=earlier)
        if not known and verdict in (frame_checks.GOOD, frame_checks.SATURATED):
            verdict = NO_ANGLE
        if verdict not in (frame_checks.GOOD, frame_checks.SATURATED):
            kept = state if verdict == frame_checks.WRONG_SIZE else replace(state, before=image)
            return self._track_of_lost(kept, given, verdict)
        track, state = self._search(replace(state, before=image), image, given)
        if verdict == frame_checks.SATURATED and track.verdict != TRACKED:
            track = replace(track, verdict=verdict)
        return track, state

    def _search(
        self, state: TrackState, image: Image, given: FloatArray
    ) -> tuple[Track, TrackState]:
        """Find the patch in a good frame."""
        expected = given + state.turn + state.drift
        if not self.camera.inside(*expected.tolist()):
            expected = given
        if not self.camera.inside(*expected.tolist()):
            return self._track_of_lost(state, np.full(2, np.nan), LOST)
        if not self._inside(self.camera.pixel(state.home, *expected.tolist()), _BORDER):
            return self._track_of_lost(state, given, _OUT_OF_VIEW)
        found, pyramid = _Found(expected, math.nan, LOST, False), self.pictures.pyramid(image)
        if not state.missed:
            found = self._match(state, image, pyramid, expected)
        if found.verdict in (LOST, AMBIGUOUS):
            found = self._search_again(state, image, pyramid, expected)
        far = float(np.hypot(*(found.angles - expected))) * self._distance(state)
        if found.verdict == TRACKED and not state.missed and far > _JUMP:
            found = replace(found, verdict=_JUMPED)
        if found.verdict != TRACKED:
            return self._track_of_lost(state, given, found.verdict, found.score)
        return self._track_of(state, image, given, found)

    def _distance(self, state: TrackState) -> float:
        """Return the distance of the patch from the pivot of the head, in metres."""
        wall = wall_point(float(state.home[0]), float(state.home[1]), self.camera.radius)
        return float(np.linalg.norm(self.camera.mount.way_to(wall)))

    def _track_of(
        self, state: TrackState, image: Image, given: FloatArray, found: _Found
    ) -> tuple[Track, TrackState]:
        """Return the track of a match, and the state, with a new view if no view is similar."""
        turn, drift, views = found.angles - given, np.zeros(2), state.views
        if not state.missed:  # after a loss the drift is unknown
            drift = state.drift + _FADE * (turn - state.turn - state.drift)
        off = self._nearest(state, found.angles).origins[0] - found.angles
        new = found.whole and not state.missed and len(views) < _MOST_VIEWS
        if new and np.hypot(*off) > _FRESH:
            view = self._view(self.pictures, image, state.home, found.angles)
            views = (*views, view) if len(view.sd) else views
        pixel = self.camera.pixel(state.home, *found.angles.tolist())
        place = self.camera.place(pixel, *given.tolist())
        share = _USUAL if state.usual else 1.0
        after = replace(
            state,
            views=views,
            place=place,
            turn=turn,
            drift=drift,
            missed=0,
            usual=state.usual + share * (max(found.score, 0.0) - state.usual),
        )
        return Track(pixel, place, found.score, TRACKED), after

    def _places(self, place: FloatArray, around: int) -> FloatArray:
        """Return the middles (P, 2) of a patch, and of ``around`` patches to each side of it."""
        steps = _SIZE * np.arange(-around, around + 1)
        off = np.stack(np.meshgrid(steps / self.camera.radius, steps), axis=-1).reshape(-1, 2)
        return np.asarray(place + off)

    def _view(
        self, pictures: PatchPictures, image: Image, place: FloatArray, angles: FloatArray
    ) -> Patches:
        return _patches_shown(pictures, image, self._places(place, _AROUND), angles, _AGAIN)

    def _nearest(self, state: TrackState, angles: FloatArray) -> Patches:
        """Return the view from angles nearest to others."""
        return min(state.views, key=lambda view: float(np.hypot(*(view.origins[0] - angles))))

    def _match(
        self, state: TrackState, image: Image, pyramid: list[Image32], start: FloatArray
    ) -> _Found:
        """Return the match nearest to angles."""
        view = self._nearest(state, start)
        fit = self.pictures.agreed(pyramid, view, start, np.zeros(2), (2, 1, 0))
        agree, seen = int((fit.scores >= _LEAST).sum()), int(np.isfinite(fit.scores).sum())
        angles, distance = fit.angles, self._distance(state)
        if not (self.camera.inside(*angles.tolist()) and agree >= max(_SHARE * seen, 1)):
            return _Found(angles, math.nan, self._loss(state, start), False)
        if fit.sd is None or distance * fit.sd.max() > _VAGUE:
            return _Found(angles, math.nan, AMBIGUOUS, False)
        score = float(np.median(fit.scores[fit.scores >= _LEAST]))
        own, _, off = self.details.aligned(self.details.pyramid(image, 1)[0], state.own, angles)
        if np.isfinite(own).any():
            score = float(own[0])
            if score < _HIDDEN * state.usual:
                return _Found(angles, score, self._loss(state, start), False)
            if score >= SURELY and distance * np.hypot(*off[0]) > _APART and agree > 1:
                return _Found(angles, score, APART, False)
            angles = angles + off[0] if score >= SURELY else angles
        pixel = self.camera.pixel(state.home, *angles.tolist())
        verdict = TRACKED if self._inside(pixel, _BORDER) else _OUT_OF_VIEW
        return _Found(angles, score, verdict, agree > _WHOLE * len(view.sd))

    def _search_again(
        self, state: TrackState, image: Image, pyramid: list[Image32], expected: FloatArray
    ) -> _Found:
        """Search for a lost patch; the search widens with every frame.

        It has to differ from everything else in view. If it is expected at the edge of the frame,
        it may be out of view, and a similar place is not accepted.
        """
        if not self._inside(self.camera.pixel(state.home, *expected.tolist()), _EDGE):
            return _Found(expected, math.nan, _OUT_OF_VIEW, False)
        reach = min(_REACH * 1.5 ** min(state.missed, 20), _WIDEST)
        half = int(reach / _GRID)
        steps = np.arange(-half, half + 1) * _GRID / self._distance(state)
        tried = expected + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        found = self.pictures.searched(pyramid, self._nearest(state, expected), tried)
        best = int(np.argmax(found))
        far = np.abs(tried - tried[best]).max(axis=1) > _NEAR * float(steps[1] - steps[0])
        if found[far].max(initial=-1.0) > _ALONE * found[best]:
            return _Found(expected, math.nan, AMBIGUOUS, False)
        return self._match(state, image, pyramid, tried[best])

    def _loss(self, state: TrackState, angles: FloatArray) -> str:
        pixel = self.camera.pixel(state.home, *angles.tolist())
        return LOST if self._inside(pixel, _BORDER) else _OUT_OF_VIEW

    def _inside(self, pixel: FloatArray, border: float) -> bool:
        edge = np.array([self.camera.lens.width, self.camera.lens.height]) - border
        return bool((pixel > border).all() and (pixel < edge).all())

    def _track_of_lost(
        self, state: TrackState, given: FloatArray, verdict: str, score: float = math.nan
    ) -> tuple[Track, TrackState]:
        """Return the track of a lost patch at its place by the angles and their last error."""
        turned, place, pixel = given + state.turn, state.place, np.full(2, np.nan)
        if self.camera.inside(*turned.tolist()):
            pixel = np.asarray(self.camera.pixel(state.home, *turned.tolist()))
            if self.camera.inside(*given.tolist()) and np.isfinite(pixel).all():
                place = self.camera.place(pixel, *given.tolist())
        after = replace(state, missed=state.missed + 1, drift=np.zeros(2), place=place)
        return Track(pixel, place, float(score), verdict), after


def halves(image: Image) -> tuple[Image, Image]:
    """Return two pictures, each of every other pixel and the means of their neighbours between.

    They show the same wall with independent noise.
    """
    padded = np.pad(image, 1, mode="edge").astype(np.uint16)
    beside = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    between = ((beside + 2) // 4).astype(np.uint8)
    odd = np.add.outer(np.arange(image.shape[0]), np.arange(image.shape[1])) % 2 == 1
    return np.where(odd, between, image), np.where(odd, image, between)


def _patches_shown(
    pictures: PatchPictures, image: Image, places: FloatArray, angles: FloatArray, least: float
) -> Patches:
    """Return the patches about places (P, 2) on which two halves of a picture agree."""
    one, other, whole = (pictures.pyramid(each) for each in (*halves(image), image))
    still = np.zeros(2)
    half = pictures.at(places, one, angles, still, still)
    alike = pictures.compared(other, 0, half, angles, still)[0] >= least
    return pictures.at(half.places[alike], whole, angles, still, still)
