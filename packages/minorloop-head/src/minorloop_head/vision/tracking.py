"""Follow a patch of the wall from frame to frame.

The patch is kept unrolled, together with the wall around it, so that neither turns nor a smaller
distance change it. The angles of the head give its expected place in a frame; a search about that
place corrects for errors of the angles, which shift patch and surroundings alike. A patch that
does not go with its surroundings is lost, not tracked; so is one whose surroundings look different,
as in a mirror image, where a round hole looks the same. When the head sees the wall from elsewhere,
a further view of it is kept; the first one stays, so that the place does not drift. After a loss
the search widens until the patch is found again::

    tracker = PatchTracker(camera)
    track, state = tracker.begin(frame.image, pixel, pan, tilt)
    while ...:
        track, state = tracker.step(state, frame.image, pan, tilt)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop_head.geometry import wall_point
from minorloop_head.vision import _track_kernels as kernels
from minorloop_head.vision import frame_checks, wall_views
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.imaging import Image32, shrunk
from minorloop_head.vision.reflectance_map import NO_ANGLE, finite_angles
from minorloop_head.vision.sighting import sighted_angles
from minorloop_head.vision.wall_views import SIDE, View

TRACKED, LOST, OUT_OF_VIEW = "tracked", "lost", "out of view"
AMBIGUOUS, APART, JUMPED = "several alike", "apart from its surroundings", "jumped"
ELSEWHERE = "in other surroundings"
"""Verdicts of a step; others are those of ``frame_checks``."""

_COARSE = 4  # texels in one of the coarsest search
_BORDER, _EDGE = 4.0, 45.0
"""Distances from the edge of a frame in pixels within which a patch is out of view: nothing is
searched, and plain wall is not followed, of which half of the patch is beyond the edge."""
_RIDGE = 0.06
"""Least share by which the agreement falls at 0.2 mm. Over a hole far out of focus it falls by
less than 0.1. In 42 sequences (seeds 1100 to 1106) 1.1 % of the frames of plain wall that are
tracked are off by more than a pixel of 320, and 1.0 % with 0.1, which loses such holes."""
_FADE = 0.5  # damping of the drift
_CLOSE = 4
"""Texels about where the surroundings put the patch in which it is searched closely, and beside
its peak at which this is told from a ridge: 0.2 mm."""
_ALIKE = 0.03e-3
"""Largest distance in metres between a patch and where its surroundings put it, for a new view to
be kept: a view repeats the error of the match that it is taken from."""
_HIDDEN = 0.5
"""Share of its usual correlation below which a patch is hidden, though its surroundings are not."""
_HALF = 0.5
"""Least share of the tiles that are seen of a patch that is tracked: in 4,000 frames of plain wall
(seeds 1000 to 1003) the errors are three times as large below it."""
_WHOLE = 0.7
"""Share of the tiles with which a lost patch is found again, and a view of it kept: part of a
regular pattern fits often."""
_ELSEWHERE, _SAME = 0.3, 0.5
"""Share of what the surroundings repeat below which they are others, as in a mirror image, and from
which a new view is kept, so that dirt on the lens is not remembered as wall. In sequences of the
twin (seed 1000) it is 0.5 to 1, and below 0.1 where pictures are mirrored."""
_USUAL = 0.1
"""Weight of a new frame in the usual correlation: light changes it over some frames."""


@dataclass(frozen=True, eq=False)
class Track:
    """Place of the patch."""

    pixel: FloatArray
    """Shape (2,). Column and row in the frame; if the patch is not seen, those expected by the
    angles."""
    place: FloatArray
    """Shape (2,). Phi and z on the wall, for the given angles."""
    score: float
    """Correlation with the patch, up to 1; NaN without a search."""
    verdict: str
    """``tracked``, ``lost``, ``out of view``, ``several alike``, ``apart from its surroundings``,
    ``in other surroundings``, ``jumped``, ``angle unknown``, or what is wrong with the frame."""


@dataclass(frozen=True, eq=False)
class TrackState:
    """State of a tracker."""

    views: tuple[View, ...]
    """The wall about the patch, first as it was picked."""
    home: FloatArray
    """Shape (2,). Phi and z of the patch when it was picked."""
    place: FloatArray
    """Shape (2,). Its last phi and z, for the given angles."""
    turn: FloatArray
    """Shape (2,). Error of the given angles, in radians: with angles plus turn the patch is at its
    home."""
    drift: FloatArray
    """Shape (2,). Change of the turn from frame to frame."""
    missed: int
    """Frames since it was seen."""
    before: Image
    """Shape (height, width). The last frame."""
    earlier: tuple[int, ...] = ()
    """Check sums of the last frames, to detect repeated ones."""
    usual: float = 0.0
    """Correlation with the patch itself while it was seen, averaged; 0 before the second frame."""
    jump: FloatArray | None = None
    """Shape (2,). Turn at which the patch was found too far away to be believed at once."""


@dataclass(frozen=True, eq=False)
class _Found:
    """A match: pixel, angles at which the head sees the patch there, and how good it is.

    ``seen`` is the share of the tiles, ``gap`` the distance in metres from where the surroundings
    put the patch, and ``same`` whether they look as they did.
    """

    pixel: FloatArray
    angles: FloatArray
    score: float
    verdict: str
    seen: float
    gap: float
    same: bool


@dataclass(frozen=True, eq=False)
class PatchTracker:
    """Normalised correlation on the unrolled wall, of the patch and of eight tiles around it.

    Raises
    ------
    ParameterError
        If a size is not positive or a share is not between 0 and 1.
    """

    camera: CalibratedCamera
    """The camera."""
    size: float = 2.4e-3
    """Side of the patch, in metres."""
    texel: float = 0.05e-3
    """Size of a texel, in metres."""
    reach: float = 1.2e-3
    """Largest distance of the patch from its expected place, in metres."""
    widest: float = 8e-3
    """Largest distance in the search for a lost patch, in metres."""
    smooth: float = 1.0e-3
    """Side of the box whose mean is taken off, in metres: less than a reflection on brushed metal
    is wide, more than a scratch or the edge of a hole."""
    least: float = 0.3
    """Least correlation of a patch and its surroundings, on average."""
    again: float = 0.4
    """The same of a lost patch that is found again."""
    surely: float = 0.6
    """The same of one that is found far from where it is expected; and of the patch itself, from
    which its place is its own. With less, the place is that of the surroundings."""
    distinct: float = 0.4
    """Correlation of the patch itself from which it has to be where its surroundings put it."""
    alone: float = 0.75
    """Largest correlation elsewhere, as a share of the best, with which a match is unique."""
    apart: float = 0.1e-3
    """Largest distance in metres of the patch from where its surroundings put it."""
    jump: float = 0.7e-3
    """Largest distance in metres from the expected place that is believed at once; a farther one is
    believed when the next frame confirms it."""
    fresh: float = 0.07
    """Difference of two views, see `wall_views.farness`, from which a new one is kept."""
    most_views: int = 24
    """Views that are kept."""

    def __post_init__(self) -> None:
        for name in ("size", "texel", "reach", "widest", "smooth", "apart", "jump", "fresh"):
            if not getattr(self, name) > 0:
                raise ParameterError(
                    f"{name} of the tracker is {getattr(self, name)}; give a number > 0"
                )
        for name in ("least", "again", "surely", "distinct", "alone"):
            if not 0 <= getattr(self, name) < 1:
                raise ParameterError(
                    f"{name} of the tracker is {getattr(self, name)}; give a share in [0, 1)"
                )
        if self.most_views < 1:
            raise ParameterError(f"{self.most_views} views of the tracker; give at least 1")
        if self.size < 8 * _COARSE * self.texel:
            raise ParameterError(
                f"a patch of {self.size} m has too few texels of {self.texel} m; give at least "
                f"{8 * _COARSE * self.texel} m"
            )

    def begin(
        self, image: Image, pixel: npt.ArrayLike, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Pick the patch about a (2,) pixel of a frame.

        Raises
        ------
        SignalError
            If the frame is not from this camera, is black, does not show the whole patch, or shows
            too little detail for its noise, in the patch and about it.
        """
        self.camera.check(image)
        if frame_checks.check_frame(image, self.camera.lens) == frame_checks.BLACK:
            raise SignalError("the frame is black; switch the lights on before a patch is picked")
        place, angles = self.camera.place(pixel, pan, tilt), np.array([pan, tilt])
        view = self._view(image, place, angles)
        u, v = np.asarray(pixel, dtype=np.float64)
        if wall_views.filled(self._patch(view)) is None:
            raise SignalError(
                f"the frame does not show {1e3 * self.size:.3g} mm of wall about pixel "
                f"({u:.0f}, {v:.0f}); pick a point further from its edge"
            )
        score = self._repeated(image, place, angles)
        if score < self.again:
            raise SignalError(
                f"the wall about pixel ({u:.0f}, {v:.0f}) is of one grey or lost in noise, two "
                f"halves of the frame agree by {max(score, 0.0):.2f} and {self.again} is needed; "
                "pick one with detail, or set focus, lights and gain"
            )
        still, (_, sums) = np.zeros(2), frame_checks.repeated(image, ())
        state = TrackState((view,), place, place, still, still, 0, image, sums)
        return Track(np.array([u, v]), place, 1.0, TRACKED), state

    def step(
        self, state: TrackState, image: Any, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Find the patch in the next frame; a bad frame gives a verdict, not an error.

        Parameters
        ----------
        state : TrackState
        image : (height, width) array of uint8
            The frame.
        pan, tilt : float
            Of the head when the frame was taken, measured or commanded, in radians; without
            finite numbers the verdict is ``angle unknown``.
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
            return self._not_seen(kept, given, verdict)
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
            return self._not_seen(state, np.full(2, np.nan), LOST)
        if state.missed:
            found = self._search_again(state, image, expected)
        else:
            found = self._search_near(state, image, expected, self.reach, self.least)
        if found.verdict != TRACKED:
            return self._not_seen(state, given, found.verdict, found.score)
        turn = found.angles - given
        if not state.missed and not self._believed(state, turn, expected - given):
            state = replace(state, jump=turn)
            return self._not_seen(state, given, JUMPED, found.score)
        return self._seen(state, image, given, found)

    def _believed(self, state: TrackState, turn: FloatArray, expected: FloatArray) -> bool:
        return self._metres(state, turn - expected) <= self.jump

    def _metres(self, state: TrackState, turn: FloatArray) -> float:
        """Return by how much a turn shifts the patch on the wall, about, in metres."""
        return float(np.hypot(*turn)) * self._distance(state)

    def _distance(self, state: TrackState) -> float:
        """Return the distance of the patch from the pivot of the head, in metres."""
        wall = wall_point(float(state.home[0]), float(state.home[1]), self.camera.radius)
        return float(np.linalg.norm(self.camera.mount.way_to(wall)))

    def _seen(
        self, state: TrackState, image: Image, given: FloatArray, found: _Found
    ) -> tuple[Track, TrackState]:
        """Return the track of a match, and the state, with a new view where none is alike."""
        turn = found.angles - given
        # A patch that was lost has no known drift.
        drift = np.zeros(2)
        if not state.missed:
            drift = state.drift + _FADE * (turn - state.turn - state.drift)
        views = state.views
        sure = not state.missed and found.same and found.seen > _WHOLE and found.gap < _ALIKE
        room = len(views) < self.most_views
        if sure and room and self._nearest(state, found.angles)[1] > self.fresh:
            view = self._view(image, state.home, found.angles)
            if wall_views.filled(self._patch(view)) is not None:
                views = (*views, view)
        place = self.camera.place(found.pixel, *given.tolist())
        share = _USUAL if state.usual else 1.0
        usual = state.usual + share * (max(found.score, 0.0) - state.usual)
        after = replace(
            state,
            views=views,
            place=place,
            turn=turn,
            drift=drift,
            missed=0,
            usual=usual,
            jump=None,
        )
        return Track(found.pixel, place, found.score, TRACKED), after

    @property
    def _cells(self) -> int:
        """Texels along a side of the patch, a multiple of those of the coarsest search."""
        return int(round(self.size / self.texel / 2 / _COARSE) * 2 * _COARSE)

    def _view(self, image: Image, place: FloatArray, angles: FloatArray) -> View:
        size = SIDE * self._cells * self.texel
        fine = self._area(image, place, angles, size, self.texel)
        lens_at = self.camera.mount.pose(*angles.tolist()).position
        # The mean over a box is one-sided at the edge of an area, alike in both halves.
        edge = round(self.smooth / self.texel / 4)
        wide = size + 4 * edge * self.texel
        one, other = (
            shrunk(self._area(half, place, angles, wide, self.texel))[edge:-edge, edge:-edge]
            for half in wall_views.halves(image)
        )
        return View(lens_at, fine, shrunk(fine), wall_views.repeated(one, other))

    def _area(
        self, image: Image, place: FloatArray, angles: FloatArray, size: float, texel: float
    ) -> Image32:
        return wall_views.unrolled(image, self.camera, place, angles, size, texel, self.smooth)

    def _patch(self, view: View) -> Image32:
        """Return the middle tile of a view."""
        n = self._cells
        return view.fine[n : 2 * n, n : 2 * n]

    def _nearest(self, state: TrackState, angles: FloatArray) -> tuple[View, float]:
        """Return the view that is most like the one from these angles, and its difference."""
        lens_at = self.camera.mount.pose(*angles.tolist()).position
        wall = wall_point(float(state.home[0]), float(state.home[1]), self.camera.radius)
        far = [wall_views.farness(view.lens_at, lens_at, wall) for view in state.views]
        best = int(np.argmin(far))
        return state.views[best], far[best]

    def _search_near(
        self, state: TrackState, image: Image, expected: FloatArray, reach: float, least: float
    ) -> _Found:
        """Search about the place that angles put the patch at."""
        view = self._nearest(state, expected)[0]
        area, agreed = self._agreed(view, image, state.home, expected, reach)
        return self._closely(state, view, area, expected, agreed, least)

    def _agreed(
        self, view: View, image: Image, place: FloatArray, angles: FloatArray, reach: float
    ) -> tuple[Image32, wall_views.Agreement]:
        """Return the wall about a place, and where in it a view is found."""
        n = self._cells
        margin = 2 * round(reach / self.texel / 2) + 2 * _CLOSE
        size = (SIDE * n + 2 * margin) * self.texel
        area = self._area(image, place, angles, size, self.texel)
        ways = wall_views.tile_motions(self.camera, place, angles, n * self.texel)
        return area, wall_views.agree(view, shrunk(area), ways, 2 * self.texel)

    def _repeated(self, image: Image, place: FloatArray, angles: FloatArray) -> float:
        """Return by how much the wall about a place agrees in two halves of a picture."""
        one, other = wall_views.halves(image)
        view = self._view(one, place, angles)
        return self._agreed(view, other, place, angles, self.reach)[1].score

    def _closely(
        self,
        state: TrackState,
        view: View,
        area: Image32,
        expected: FloatArray,
        agreed: wall_views.Agreement,
        least: float,
    ) -> _Found:
        """Find the patch itself about the shift on which patch and surroundings agree."""
        n = self._cells
        first = (np.array(area.shape[::-1]) - n) / 2 + agreed.shift / self.texel
        corner = np.rint(first).astype(int) - 2 * _CLOSE
        corner = np.clip(corner, 0, np.array(area.shape[::-1]) - n)
        j, i = corner.tolist()
        template = wall_views.filled(self._patch(view))
        assert template is not None
        part = np.ascontiguousarray(area[i : i + n + 4 * _CLOSE, j : j + n + 4 * _CLOSE])
        scores = wall_views.scores_of(part, template)
        best = wall_views.best_of(scores)
        middle = (np.array(area.shape[::-1]) - n) / 2
        off = (best[:2] + corner - middle) * self.texel
        verdict, score = TRACKED, float(best[2])
        # A patch that is its own, such as a hole, has a place also on a ridge.
        drop = wall_views.drop_of(scores, best, _CLOSE) if score >= self.surely else 0.0
        if agreed.score < least or score < _HIDDEN * state.usual:
            verdict = self._loss_verdict(state.home, expected)
        elif agreed.around < _ELSEWHERE:
            verdict = ELSEWHERE
        elif agreed.other > self.alone * agreed.score or max(agreed.drop, drop) < _RIDGE:
            verdict = AMBIGUOUS
        elif score >= self.distinct and np.hypot(*(off - agreed.shift)) > self.apart:
            verdict = APART
        elif score < self.surely:
            off = agreed.shift
        place = state.home + off / np.array([self.camera.radius, 1.0])
        pixel = self.camera.pixel(place, *expected.tolist())
        beyond = score < self.surely and not self._inside(pixel, _EDGE)
        if verdict == TRACKED and (beyond or agreed.seen < _HALF):
            verdict = OUT_OF_VIEW
        angles = None
        if verdict == TRACKED:
            angles = sighted_angles(self.camera, state.home, pixel, expected)
            verdict = LOST if angles is None else verdict
        if angles is None:
            angles = expected
        gap = float(np.hypot(*(off - agreed.shift)))
        same = not agreed.around < _SAME
        return _Found(pixel, angles, score, verdict, agreed.seen, gap, same)

    def _search_again(self, state: TrackState, image: Image, expected: FloatArray) -> _Found:
        """Search for a lost patch about its expected place, then farther away.

        Farther away it has to be unlike everything else that is seen, and to match by itself. Where
        it is expected at the edge of the frame, it may be beyond, and what is alike is not it.
        """
        pixel = self.camera.pixel(state.home, *expected.tolist())
        if not self._inside(pixel, _EDGE):
            return _Found(pixel, expected, math.nan, OUT_OF_VIEW, 0.0, math.inf, False)
        near = self._search_near(state, image, expected, self.reach, self.again)
        if near.verdict == TRACKED and near.score > self.distinct and near.seen > _WHOLE:
            return near
        for rough in self._likely_angles(state, image, expected):
            found = self._search_near(state, image, rough, self.reach / 2, self.surely)
            sure = found.score > self.surely and found.seen > _WHOLE
            if found.verdict == TRACKED and sure:
                return found
        return replace(near, verdict=LOST) if near.verdict == TRACKED else near

    def _likely_angles(
        self, state: TrackState, image: Image, expected: FloatArray
    ) -> list[FloatArray]:
        """Return angles at which the patch is found alone; the search widens with every frame."""
        reach = min(self.reach * 1.5 ** min(state.missed, 20), self.widest)
        view, step = self._nearest(state, expected)[0], 2 * self.texel
        area = self._area(image, state.home, expected, self._cells * self.texel + 2 * reach, step)
        half = self._cells // 2
        tile = wall_views.filled(shrunk(view.coarse[half : 2 * half, half : 2 * half]))
        if tile is None:
            return []
        scores = wall_views.scores_of(shrunk(area), tile)
        best = wall_views.best_of(scores)
        if kernels.second(scores, best, 2) > self.alone * best[2] or best[2] < self.again:
            return []
        off = (best[:2] - (np.array(scores.shape[::-1]) - 1) / 2) * 2 * step
        place = state.home + off / np.array([self.camera.radius, 1.0])
        pixel = self.camera.pixel(place, *expected.tolist())
        found = sighted_angles(self.camera, state.home, pixel, expected)
        return [] if found is None or not self.camera.inside(*found.tolist()) else [found]

    def _loss_verdict(self, place: FloatArray, angles: FloatArray) -> str:
        pixel = self.camera.pixel(place, *angles.tolist())
        return LOST if self._inside(pixel, _BORDER) else OUT_OF_VIEW

    def _inside(self, pixel: FloatArray, border: float) -> bool:
        edge = np.array([self.camera.lens.width, self.camera.lens.height]) - border
        return bool((pixel > border).all() and (pixel < edge).all())

    def _not_seen(
        self, state: TrackState, given: FloatArray, verdict: str, score: float = math.nan
    ) -> tuple[Track, TrackState]:
        """Return the track of a patch that stays where angles and their last error put it."""
        turned, place, pixel = given + state.turn, state.place, np.full(2, np.nan)
        if self.camera.inside(*turned.tolist()):
            pixel = np.asarray(self.camera.pixel(state.home, *turned.tolist()))
            if self.camera.inside(*given.tolist()) and np.isfinite(pixel).all():
                place = self.camera.place(pixel, *given.tolist())
        after = replace(state, missed=state.missed + 1, drift=np.zeros(2), place=place)
        return Track(pixel, place, float(score), verdict), after
