"""Follow a piece of the wall from frame to frame.

The piece is kept laid flat on the wall, so that neither turning nor coming nearer changes how it
looks. Where it must be in a frame follows from how the head was turned; a search about that
place makes up for what the commanded or measured angles do not say. After a loss the search
widens until the piece is found again::

    tracker = Tracker(eye)
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
from minorloop.head.vision.reflectance_map import NO_ANGLE, known_angles

TRACKED, LOST, OUT_OF_VIEW = "tracked", "lost", "out of view"
"""Verdicts of a step; further ones are those of ``health``."""

_FAR = 4
_BORDER = 4.0
_FADE = 0.5
_LIKELY = 3
_PLAIN = 1e-3
_KEPT = 16


@dataclass(frozen=True, eq=False)
class Track:
    """Where the piece is.

    Parameters
    ----------
    pixel : (2,) array
        Column and row in the frame; where it should be by the angles when it is not seen.
    place : (2,) array
        phi and z on the wall, with the angles that were given.
    score : float
        Correlation with the piece as it was picked, up to 1; NaN when nothing was looked at.
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
    """What a tracker remembers.

    Parameters
    ----------
    anchor, lately : (n, n) arrays of float32
        The piece as it was picked and as it looked lately, as logarithms of grey levels.
    place : (2,) array
        phi and z where it was last, with the angles that were given.
    drift : (2,) array
        Change of that from frame to frame.
    missed : int
        Frames since it was seen.
    before : (height, width) array of uint8
        The frame before.
    earlier : tuple of int
        Check sums of the last frames: noise never repeats itself.
    """

    anchor: Image32
    lately: Image32
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
    eye : CalibratedCamera
        The camera.
    size : float
        Side of the piece, in metres.
    texel : float
        Size of a texel, in metres.
    reach : float
        How far off the piece may be from where the angles say, in metres.
    widest : float
        How far the search for a lost piece goes, in metres.
    least : float
        Least correlation at which the piece counts as seen.
    again : float
        Least correlation at which a lost piece counts as found.
    learn : float
        Share of its newest look that the piece takes on with every frame; the look that was
        picked is kept beside it, so that it cannot drift away.

    Raises
    ------
    ParameterError
        If a size is not positive or a share is not between 0 and 1.
    """

    eye: CalibratedCamera
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
        if self.size < 8 * _FAR * self.texel:
            raise ParameterError(
                f"a piece of {self.size} m has too few texels of {self.texel} m; give at least "
                f"{8 * _FAR * self.texel} m"
            )

    def begin(
        self, image: Image, pixel: npt.ArrayLike, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Pick the piece about a (2,) pixel of a frame.

        Raises
        ------
        SignalError
            If the frame is not one of this camera, is black, does not show the piece whole, or
            shows nothing in it that could be found again.
        """
        self.eye.check(image)
        if frame_checks.judge(image, self.eye.lens) == frame_checks.BLACK:
            raise SignalError("the frame is black; switch the lights on before a piece is picked")
        place = self.eye.place(pixel, pan, tilt)
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
        state = TrackState(flat, flat, place, np.zeros(2), 0, image, (_key(image),))
        seen = np.asarray(pixel, dtype=np.float64)
        return Track(seen, place, 1.0, TRACKED), state

    def step(
        self, state: TrackState, image: Any, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Find the piece in the next frame; nothing is raised for a frame that is bad.

        Parameters
        ----------
        state : TrackState
        image : (height, width) array of uint8
            The frame.
        pan, tilt : float
            Where the head was when the frame was taken, measured or commanded, in radians; the
            verdict on what is no finite number is ``angle unknown``.
        """
        verdict = frame_checks.judge(image, self.eye.lens, state.before)
        known = known_angles(pan, tilt)
        pan, tilt = (pan, tilt) if known else (math.nan, math.nan)
        if verdict != frame_checks.WRONG_SIZE:
            key = _key(image)
            verdict = frame_checks.FROZEN if key in state.earlier else verdict
            state = replace(state, earlier=(*state.earlier, key)[-_KEPT:])
        expected = state.place + state.drift
        if not known and verdict in (frame_checks.GOOD, frame_checks.SATURATED):
            verdict = NO_ANGLE
        if verdict not in (frame_checks.GOOD, frame_checks.SATURATED):
            kept = state if verdict == frame_checks.WRONG_SIZE else replace(state, before=image)
            return self._unseen(kept, expected, pan, tilt, verdict)
        track, state = self._search(replace(state, before=image), image, expected, pan, tilt)
        if verdict == frame_checks.SATURATED and track.verdict != TRACKED:
            track = replace(track, verdict=verdict)
        return track, state

    def _search(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Find the piece in a frame that is good."""
        if not self.eye.inside(pan, tilt):
            return self._unseen(state, expected, math.nan, math.nan, LOST)
        if state.missed:
            return self._again(state, image, expected, pan, tilt)
        return self._near(state, image, expected, pan, tilt, self.reach, self.least)

    @property
    def _cells(self) -> int:
        """Texels along a side of the piece, a multiple of that of the coarsest search."""
        return int(round(self.size / self.texel / 2 / _FAR) * 2 * _FAR)

    def _flat(
        self, image: Image, place: FloatArray, pan: float, tilt: float, size: float, step: float
    ) -> Image32:
        """Logarithm of the wall about a place, an even number of texels each way."""
        count = 2 * max(round(size / step / 2), 1)
        half = (count - 1) / 2 * step
        window = Window(
            float(place[0]) - half / self.eye.radius, float(place[1]) - half, step, count, count
        )
        flat = unroll(image, self.eye, window, pan, tilt)
        kernels.levels(flat, flat)
        return flat

    def _near(
        self,
        state: TrackState,
        image: Image,
        expected: FloatArray,
        pan: float,
        tilt: float,
        reach: float,
        least: float,
    ) -> tuple[Track, TrackState]:
        """Look about the place where the piece is expected."""
        area = self._flat(
            image, expected, pan, tilt, self._cells * self.texel + 2 * reach, self.texel
        )
        best = self._match(area, state.anchor)
        if best[2] < 0.5 * (1 + least):
            other = self._match(area, state.lately)
            best = other if other[2] > best[2] + 0.1 else best
        if best[2] < least:
            why = self._why(expected, pan, tilt)
            return self._unseen(state, expected, pan, tilt, why, best[2])
        middle = (np.array(area.shape[::-1]) - self._cells) / 2
        off = (best[:2] - middle) * self.texel
        place = expected + off / np.array([self.eye.radius, 1.0])
        pixel = self.eye.pixel(place, pan, tilt)
        # A piece that was lost comes back without a drift.
        drift = np.zeros(2) if state.missed else state.drift + 0.5 * (place - expected) * _FADE
        lately = self._learned(state, area, best)
        after = replace(state, place=place, drift=drift, missed=0, lately=lately)
        return Track(pixel, place, float(best[2]), TRACKED), after

    def _learned(self, state: TrackState, area: Image32, best: FloatArray) -> Image32:
        n, j, i = self._cells, round(best[0]), round(best[1])
        newest = area[i : i + n, j : j + n]
        if newest.shape != state.lately.shape or not np.isfinite(newest).all():
            return state.lately
        blend: Image32 = ((1 - self.learn) * state.lately + self.learn * newest).astype(np.float32)
        return blend

    def _match(self, area: Image32, template: Image32) -> FloatArray:
        """Column, row and height of the best match, found at half and then at full size."""
        coarse, model = _shrunk(area), _shrunk(template)
        rough = _best(coarse, model)
        i0 = int(np.clip(2 * round(rough[1]) - 3, 0, max(area.shape[0] - self._cells - 6, 0)))
        j0 = int(np.clip(2 * round(rough[0]) - 3, 0, max(area.shape[1] - self._cells - 6, 0)))
        n = self._cells + 6
        fine = _best(np.ascontiguousarray(area[i0 : i0 + n, j0 : j0 + n]), template)
        return np.asarray(fine + np.array([j0, i0, 0.0]))

    def _again(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> tuple[Track, TrackState]:
        """Look for a lost piece, and closely at the likeliest places."""
        best = self._unseen(state, expected, pan, tilt, self._why(expected, pan, tilt))
        for rough in self._far(state, image, expected, pan, tilt):
            found = self._near(state, image, rough, pan, tilt, 6 * self.texel, self.again)
            if found[0].verdict == TRACKED and not found[0].score <= best[0].score:
                best = found
        return best

    def _far(
        self, state: TrackState, image: Image, expected: FloatArray, pan: float, tilt: float
    ) -> list[FloatArray]:
        """Where a lost piece may be, by a search that widens with every frame."""
        reach = min(self.reach * 1.5 ** min(state.missed, 20), self.widest)
        step = 2 * self.texel
        area = _shrunk(
            self._flat(image, expected, pan, tilt, self._cells * self.texel + 2 * reach, step)
        )
        scores = _scores(area, _shrunk(_shrunk(state.anchor)))
        middle = (np.array(area.shape[::-1]) - self._cells / _FAR) / 2
        places = []
        for _ in range(_LIKELY):
            best = np.empty(3)
            kernels.peak(scores, best)
            if best[2] < 0.7 * self.again:
                break
            off = (best[:2] - middle) * 2 * step
            places.append(np.asarray(expected + off / np.array([self.eye.radius, 1.0])))
            i, j = round(best[1]), round(best[0])
            scores[max(i - 2, 0) : i + 3, max(j - 2, 0) : j + 3] = -1.0
        return places

    def _why(self, expected: FloatArray, pan: float, tilt: float) -> str:
        pixel = self.eye.pixel(expected, pan, tilt)
        edge = np.array([self.eye.lens.width, self.eye.lens.height]) - _BORDER
        inside = (pixel > _BORDER).all() and (pixel < edge).all()
        return LOST if inside else OUT_OF_VIEW

    def _unseen(
        self,
        state: TrackState,
        expected: FloatArray,
        pan: float,
        tilt: float,
        verdict: str,
        score: float = math.nan,
    ) -> tuple[Track, TrackState]:
        known = self.eye.inside(pan, tilt)
        pixel = self.eye.pixel(expected, pan, tilt) if known else np.full(2, np.nan)
        after = replace(state, missed=state.missed + 1, drift=np.zeros(2), place=expected)
        return Track(pixel, expected, float(score), verdict), after


def _key(image: Image) -> int:
    return zlib.crc32(np.ascontiguousarray(image).tobytes())


def _shrunk(fine: Image32) -> Image32:
    coarse = np.empty((fine.shape[0] // 2, fine.shape[1] // 2), dtype=np.float32)
    kernels.shrink(fine, coarse)
    return coarse


def _scores(area: Image32, template: Image32) -> FloatArray:
    """Correlation with each place of an area; -1 where it is too small."""
    shape = np.maximum(np.array(area.shape) - template.shape + 1, 1)
    scores = np.full(tuple(shape), -1.0)
    if area.shape[0] >= template.shape[0] and area.shape[1] >= template.shape[1]:
        kernels.correlate(area, template, scores)
    return scores


def _best(area: Image32, template: Image32) -> FloatArray:
    """Column, row and height of the highest correlation."""
    found = np.empty(3)
    kernels.peak(_scores(area, template), found)
    return found
