"""Follow a patch of the wall from frame to frame.

The patch is kept unrolled, so that neither turns nor a smaller distance change it. The angles of
the head give its expected place in a frame; a search about that place corrects for errors of the
angles. After a loss the search widens until the patch is found again::

    tracker = PatchTracker(camera)
    track, state = tracker.begin(frame.image, pixel, pan, tilt)
    while ...:
        track, state = tracker.step(state, frame.image, pan, tilt)
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop.head.vision import _track_kernels as kernels
from minorloop.head.vision import frame_checks
from minorloop.head.vision.calibrated_camera import CalibratedCamera, Image, Image32, Window, unroll
from minorloop.head.vision.reflectance_map import NO_ANGLE, finite_angles

TRACKED, LOST, OUT_OF_VIEW = "tracked", "lost", "out of view"
"""Verdicts of a step; others are those of ``frame_checks``."""

_COARSE = 4  # texels in one of the coarsest search
_BORDER = 4.0  # pixels
_FADE = 0.5  # damping of the drift
_LIKELY = 3
"""Number of coarse matches that are searched closely."""
_PLAIN = 1e-3
"""Standard deviation of the logarithm of grey levels below which a patch has no detail."""
_KEPT = 16
"""Number of frames in which a repeated one counts as frozen."""


@dataclass(frozen=True, eq=False)
class Track:
    """Place of the patch.

    Parameters
    ----------
    pixel : (2,) array
        Column and row in the frame; if the patch is not seen, those expected by the angles.
    place : (2,) array
        Phi and z on the wall, for the given angles.
    score : float
        Correlation with the patch, up to 1; NaN without a search.
    verdict : str
        ``tracked``, ``lost``, ``out of view``, ``angle unknown``, or what is wrong with the
        frame.
    """

    pixel: FloatArray
    place: FloatArray
    score: float
    verdict: str


@dataclass(frozen=True, eq=False)
class TrackState:
    """State of a tracker.

    Parameters
    ----------
    picked, recent : (n, n) arrays of float32
        The patch as it was picked and as it looked recently, as logarithms of grey levels.
    place : (2,) array
        Its last phi and z, for the given angles.
    drift : (2,) array
        Change of the place from frame to frame.
    missed : int
        Frames since it was seen.
    before : (height, width) array of uint8
        The last frame.
    earlier : tuple of int
        Check sums of the last frames, to detect repeated ones.
    """

    picked: Image32
    recent: Image32
    place: FloatArray
    drift: FloatArray
    missed: int
    before: Image
    earlier: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class PatchTracker:
    """Normalised correlation on the unrolled wall, coarse to fine.

    Parameters
    ----------
    camera : CalibratedCamera
        The camera.
    size : float
        Side of the patch, in metres.
    texel : float
        Size of a texel, in metres.
    reach : float
        Largest distance of the patch from its expected place, in metres.
    widest : float
        Largest distance in the search for a lost patch, in metres.
    least : float
        Least correlation of a patch that is seen.
    again : float
        Least correlation of a lost patch that is found again.
    learn : float
        Weight of a new frame in the recent patch; the patch as picked is kept too, so that the
        place cannot drift.

    Raises
    ------
    ParameterError
        If a size is not positive or a share is not between 0 and 1.
    """

    camera: CalibratedCamera
    size: float = 2.4e-3
    texel: float = 0.05e-3
    reach: float = 1.2e-3
    widest: float = 8e-3
    least: float = 0.6
    again: float = 0.75
    learn: float = 0.1

    def __post_init__(self) -> None:
        for name in ("size", "texel", "reach", "widest"):
            if not getattr(self, name) > 0:
                raise ParameterError(
                    f"{name} of the tracker is {getattr(self, name)}; give a length > 0 in m"
                )
        for name in ("least", "again", "learn"):
            if not 0 <= getattr(self, name) < 1:
                raise ParameterError(
                    f"{name} of the tracker is {getattr(self, name)}; give a share in [0, 1)"
                )
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
            no detail in it.
        """
        self.camera.check(image)
        if frame_checks.check_frame(image, self.camera.lens) == frame_checks.BLACK:
            raise SignalError("the frame is black; switch the lights on before a patch is picked")
        place = self.camera.place(pixel, pan, tilt)
        flat = self._flat(image, place, pan, tilt, self._cells * self.texel, self.texel)
        u, v = np.asarray(pixel, dtype=np.float64)
        if not np.isfinite(flat).all():
            raise SignalError(
                f"the frame does not show {1e3 * self.size:.3g} mm of wall about pixel "
                f"({u:.0f}, {v:.0f}); pick a point further from its edge"
            )
        if not flat.std() > _PLAIN:
            raise SignalError(
                f"the wall about pixel ({u:.0f}, {v:.0f}) is of one grey; pick one with detail"
            )
        state = TrackState(flat, flat, place, np.zeros(2), 0, image, (_checksum(image),))
        seen = np.asarray(pixel, dtype=np.float64)
        return Track(seen, place, 1.0, TRACKED), state

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
        pan, tilt = (pan, tilt) if known else (math.nan, math.nan)
        if verdict != frame_checks.WRONG_SIZE:
            key = _checksum(image)
            verdict = frame_checks.FROZEN if key in state.earlier else verdict
            state = replace(state, earlier=(*state.earlier, key)[-_KEPT:])
        expected = state.place + state.drift
        if not known and verdict in (frame_checks.GOOD, frame_checks.SATURATED):
            verdict = NO_ANGLE
        if verdict not in (frame_checks.GOOD, frame_checks.SATURATED):
            kept = state if verdict == frame_checks.WRONG_SIZE else replace(state, before=image)
            return self._not_seen(kept, expected, pan, tilt, verdict)
        track, state = self._search(replace(state, before=image), image, expected, pan, tilt)
        if verdict == frame_checks.SATURATED and track.verdict != TRACKED:
            track = replace(track, verdict=verdict)
        return track, state

    def _search(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Find the patch in a good frame."""
        if not self.camera.inside(pan, tilt):
            return self._not_seen(state, expected, math.nan, math.nan, LOST)
        if state.missed:
            return self._search_again(state, image, expected, pan, tilt)
        return self._search_near(state, image, expected, pan, tilt, self.reach, self.least)

    @property
    def _cells(self) -> int:
        """Texels along a side of the patch, a multiple of those of the coarsest search."""
        return int(round(self.size / self.texel / 2 / _COARSE) * 2 * _COARSE)

    def _flat(
        self, image: Image, place: FloatArray, pan: float, tilt: float, size: float, step: float
    ) -> Image32:
        """Return the logarithm of the wall about a place, an even number of texels each way."""
        count = 2 * max(round(size / step / 2), 1)
        half = (count - 1) / 2 * step
        window = Window(
            float(place[0]) - half / self.camera.radius, float(place[1]) - half, step, count, count
        )
        flat = unroll(image, self.camera, window, pan, tilt)
        kernels.levels(flat, flat)
        return flat

    def _search_near(
        self,
        state: TrackState,
        image: Image,
        expected: FloatArray,
        pan: float,
        tilt: float,
        reach: float,
        least: float,
    ) -> tuple[Track, TrackState]:
        """Search about the expected place."""
        area = self._flat(
            image, expected, pan, tilt, self._cells * self.texel + 2 * reach, self.texel
        )
        best = self._match(area, state.picked)
        if best[2] < 0.5 * (1 + least):
            other = self._match(area, state.recent)
            best = other if other[2] > best[2] + 0.1 else best
        if best[2] < least:
            verdict = self._loss_verdict(expected, pan, tilt)
            return self._not_seen(state, expected, pan, tilt, verdict, best[2])
        middle = (np.array(area.shape[::-1]) - self._cells) / 2
        off = (best[:2] - middle) * self.texel
        place = expected + off / np.array([self.camera.radius, 1.0])
        pixel = self.camera.pixel(place, pan, tilt)
        # A patch that was lost has no known drift.
        drift = np.zeros(2) if state.missed else state.drift + 0.5 * (place - expected) * _FADE
        recent = self._blended(state, area, best)
        after = replace(state, place=place, drift=drift, missed=0, recent=recent)
        return Track(pixel, place, float(best[2]), TRACKED), after

    def _blended(self, state: TrackState, area: Image32, best: FloatArray) -> Image32:
        n, j, i = self._cells, round(best[0]), round(best[1])
        newest = area[i : i + n, j : j + n]
        if newest.shape != state.recent.shape or not np.isfinite(newest).all():
            return state.recent
        blend: Image32 = ((1 - self.learn) * state.recent + self.learn * newest).astype(np.float32)
        return blend

    def _match(self, area: Image32, template: Image32) -> FloatArray:
        """Return column, row and height of the best match, found at half and then at full size."""
        coarse, model = _shrunk(area), _shrunk(template)
        rough = _best(coarse, model)
        i0 = int(np.clip(2 * round(rough[1]) - 3, 0, max(area.shape[0] - self._cells - 6, 0)))
        j0 = int(np.clip(2 * round(rough[0]) - 3, 0, max(area.shape[1] - self._cells - 6, 0)))
        n = self._cells + 6
        fine = _best(np.ascontiguousarray(area[i0 : i0 + n, j0 : j0 + n]), template)
        return np.asarray(fine + np.array([j0, i0, 0.0]))

    def _search_again(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Search for a lost patch, coarsely, then closely at the likeliest places."""
        best = self._not_seen(state, expected, pan, tilt, self._loss_verdict(expected, pan, tilt))
        for rough in self._likely_places(state, image, expected, pan, tilt):
            found = self._search_near(state, image, rough, pan, tilt, 6 * self.texel, self.again)
            if found[0].verdict == TRACKED and not found[0].score <= best[0].score:
                best = found
        return best

    def _likely_places(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> list[FloatArray]:
        """Return likely places of a lost patch; the search widens with every frame."""
        reach = min(self.reach * 1.5 ** min(state.missed, 20), self.widest)
        step = 2 * self.texel
        area = _shrunk(
            self._flat(image, expected, pan, tilt, self._cells * self.texel + 2 * reach, step)
        )
        scores = _scores(area, _shrunk(_shrunk(state.picked)))
        middle = (np.array(area.shape[::-1]) - self._cells / _COARSE) / 2
        places = []
        for _ in range(_LIKELY):
            best = np.empty(3)
            kernels.peak(scores, best)
            if best[2] < 0.7 * self.again:
                break
            off = (best[:2] - middle) * 2 * step
            places.append(np.asarray(expected + off / np.array([self.camera.radius, 1.0])))
            i, j = round(best[1]), round(best[0])
            scores[max(i - 2, 0) : i + 3, max(j - 2, 0) : j + 3] = -1.0
        return places

    def _loss_verdict(self, expected: FloatArray, pan: float, tilt: float) -> str:
        pixel = self.camera.pixel(expected, pan, tilt)
        edge = np.array([self.camera.lens.width, self.camera.lens.height]) - _BORDER
        inside = (pixel > _BORDER).all() and (pixel < edge).all()
        return LOST if inside else OUT_OF_VIEW

    def _not_seen(
        self,
        state: TrackState,
        expected: FloatArray,
        pan: float,
        tilt: float,
        verdict: str,
        score: float = math.nan,
    ) -> tuple[Track, TrackState]:
        known = self.camera.inside(pan, tilt)
        pixel = self.camera.pixel(expected, pan, tilt) if known else np.full(2, np.nan)
        after = replace(state, missed=state.missed + 1, drift=np.zeros(2), place=expected)
        return Track(pixel, expected, float(score), verdict), after


def _checksum(image: Image) -> int:
    return zlib.crc32(np.ascontiguousarray(image).tobytes())


def _shrunk(fine: Image32) -> Image32:
    coarse = np.empty((fine.shape[0] // 2, fine.shape[1] // 2), dtype=np.float32)
    kernels.shrink(fine, coarse)
    return coarse


def _scores(area: Image32, template: Image32) -> FloatArray:
    """Return the correlation with each place of an area; -1 if it is too small."""
    shape = np.maximum(np.array(area.shape) - template.shape + 1, 1)
    scores = np.full(tuple(shape), -1.0)
    if area.shape[0] >= template.shape[0] and area.shape[1] >= template.shape[1]:
        kernels.correlate(area, template, scores)
    return scores


def _best(area: Image32, template: Image32) -> FloatArray:
    """Return column, row and height of the highest correlation."""
    found = np.empty(3)
    kernels.peak(_scores(area, template), found)
    return found
