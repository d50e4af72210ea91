"""Pan and tilt of a head, estimated from its pictures of the wall of the pipe alone.

A head without joint sensors turns its camera past a wall that stands still. Patches of the wall are
stored at their places by the angles of their first picture. The angles of every further picture are
those at which the patches agree with it::

    estimator = WallAngles(camera)
    sight, state = estimator.begin(frame.image, at_rest, frame.t)
    while ...:
        sight, state = estimator.step(state, frame.image, frame.t)
        sight.angles  # (2,) radians; NaN where the picture does not tell

New patches are added as the view moves, once a further turn has shown that they are not dirt on the
lens. A patch is kept as long as it agrees, so that a return to an old view removes the drift.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.imaging import Image32
from minorloop_head.vision.patch_pictures import Agreement, PatchPictures
from minorloop_head.vision.wall_patches import (
    FEW,
    LATE,
    NO_PATCH,
    SEEN,
    UNSURE,
    Doubt,
    Patches,
    Sight,
    WallState,
    nothing,
)

NOTHING_SEEN = "check lights, lens and cable"
"""Advice on a picture that shows nothing."""
_SIZE, LEAST = 1.6e-3, 0.55
"""Side of a patch in metres, and least correlation of one that agrees."""
_FEWEST = 4
"""Least number of patches that agree; after a search for a lost view it is twice that."""
_WIDEST = math.radians(0.25)
"""Largest standard deviation of an angle, in radians."""
_ONE_IN = 3
"""A picture is used if one in three patches in view agree. Far down the pipe their looks change
fast, and half of them may disagree; at wrong angles one in seven agrees on average."""
_HIDDEN = 5
"""Consecutive pictures in which a patch disagrees, after which it does not count: something hides
it, such as dirt on the lens."""
_SEARCHED = 2
"""After a search one in two patches must agree, and twice as many as otherwise: among many angles,
dirt on the lens matches at some. Of 160 fine textures of dirt, 21 reached one in three, and none
one in two; of 40 coarse ones, six did."""
_SURE, _MOST = 0.85, 0.75
"""Least median correlation of agreeing patches, and least share of those in view, with which a
found view is the wall: where dirt matched it was 0.77 at most."""
_NEARLY, _MANY = 0.9, 3.5
"""The same if noise lowers correlations: least share of the patches in view, and multiple of the
fewest that must agree. Where dirt matched, 0.6 did at most, or 10 of 10 where it hid the others. A
view with less is on trial."""
_ALL = 6
"""Fewest patches in view if they are less than must agree after a search; all must agree then. It
lets a head be found that stopped beside its stored view."""
_HUNT = math.radians(2.0)
"""Distance between tried angles in the search for a lost view: those between lead to a peak too."""
_AROUND = math.radians(5.0)
"""Distance from old patches within which angles are tried again after few pictures: axes that cool
do not return on the way on which they were heated."""
_BESIDE, _FINE = math.radians(6.0), math.radians(1.0)
"""Range of tried angles about the last ones, and their distance: a lost head stops near, and with
few patches in view the steps lead to the peak from less than a degree."""
_GOING = 5
"""Number of pictures for which a lost head is assumed to continue its turn."""
_SETTLES = 5.0
"""Assumed time constant of its settling in seconds: that of a wire in still air."""
_FASTEST = math.radians(60.0)
"""Highest assumed rate of a found head in rad/s, twice that of a real one. If the head were assumed
at rest, a fast one would need a search in every picture, and new patches would not be learned."""
_TURNED = math.radians(0.4)
"""Turn after which new patches are searched: it brings a tenth of a patch into view."""
_TRIAL = math.radians(3.0)
"""Turn after which a new patch must agree: dirt whose grains are 2 % of the width of the picture
does not."""
_UNEVEN = 1e-3
"""Uncertainty in seconds of when a row of a moving picture was taken."""


@dataclass(frozen=True, eq=False)
class WallAngles:
    """Estimator of the angles at which all stored patches of the wall agree best with a picture.

    Raises a `ParameterError` if a least angle is not below the largest.
    """

    camera: CalibratedCamera
    """Calibrated camera."""
    low: tuple[float, float] = (math.radians(-36.0), math.radians(-36.0))
    high: tuple[float, float] = (math.radians(36.0), math.radians(36.0))
    """Least and largest pan and tilt of the line of sight, in radians; a lost view is searched
    between them."""
    readout: float = 8e-3
    """Time in seconds from the first row of a picture to the last, 0 if they are taken at once. The
    standard deviations do not contain its error."""
    tries: int = 64
    """Number of angles tried in each picture while the view is lost; half as many are tried beside
    the last ones."""

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise ParameterError(f"angles from {self.low} to {self.high}; give low < high")

    @cached_property
    def pictures(self) -> PatchPictures:
        """Comparison of patches with pictures of this camera."""
        return PatchPictures(self.camera, _SIZE, LEAST, self.readout)

    def begin(self, image: Image, angles: npt.ArrayLike, t: float = 0.0) -> tuple[Sight, WallState]:
        """Return the state for a first picture at known angles, such as of the head at rest.

        Raises a `SignalError` if the picture is not from this camera, or shows too little of the
        wall.

        ``angles`` (2,): pan and tilt of the line of sight, in radians; ``t``: time of the picture,
        in seconds.
        """
        self.camera.check(image)
        verdict = frame_checks.check_frame(image, self.camera.lens)
        if verdict not in (frame_checks.GOOD, frame_checks.SATURATED):
            raise SignalError(f"the first picture is {verdict}; {NOTHING_SEEN}")
        at = np.asarray(angles, dtype=np.float64)
        none = self.pictures.none
        patches = self.pictures.new(
            self.pictures.pyramid(image), at, none, np.zeros(2), np.zeros(2)
        )
        if len(patches.sd) < _FEWEST:
            if verdict == frame_checks.SATURATED:
                raise SignalError(f"the first picture is {verdict}; {NOTHING_SEEN}")
            raise SignalError(
                f"the first picture shows {len(patches.sd)} patches of wall with detail, and "
                f"{_FEWEST} are needed; set focus, lights and gain"
            )
        state = WallState(
            patches, none, at, np.zeros(2), t, 0, 0, frame_checks.repeated(image, ())[1], t,
        )  # fmt: skip
        count = len(patches.sd)
        return Sight(at, np.zeros(2), count, count, SEEN), state

    def step(self, state: WallState, image: Any, t: float) -> tuple[Sight, WallState]:
        """Return the angles by the next picture; a bad picture gives a verdict, not an error.

        ``image`` (height, width); ``t``: its time, in seconds.
        """
        verdict = frame_checks.check_frame(image, self.camera.lens)
        if verdict == frame_checks.WRONG_SIZE:
            return self._missed(state, verdict)
        repeats, earlier = frame_checks.repeated(image, state.earlier)
        if verdict == frame_checks.GOOD and repeats:
            verdict = frame_checks.FROZEN
        verdict = verdict if t > state.newest else LATE
        state = replace(state, earlier=earlier)
        if verdict not in (frame_checks.GOOD, frame_checks.SATURATED):
            return self._missed(state, verdict)
        state = replace(state, newest=t)
        pyramid = self.pictures.pyramid(image)
        sight, patches = self._find(pyramid, state, self._expected(state, t))
        if sight.verdict != SEEN:
            again, state = self._search_lost(pyramid, state)
            if again is None:
                # If some patches agree, not all of the picture is white: there is another reason.
                white = verdict == frame_checks.SATURATED and not sight.agreeing
                return self._missed(state, verdict, None if white else sight)
            sight, patches = again
        doubt = self._trial_of(pyramid, state, sight)
        moved = self._next_state(pyramid, replace(state, patches=patches, doubt=doubt), sight, t)
        return replace(sight, trial=doubt is not None), moved

    def rolled(self, state: WallState, image: Image, sd: FloatArray) -> WallState:
        """Return the state after a roll of the camera: new patches that agree after it are wall.

        Others are on trial until the next roll. After a turn of the head, `step` does this.

        ``state``: after the step of this picture, which gave angles; ``sd`` (2,): their standard
        deviations, in radians.
        """
        pyramid, still = self.pictures.pyramid(image), np.zeros(2)
        scores = self.pictures.compared(pyramid, 0, state.trial, state.angles, still)[0]
        patches = state.patches.with_more(state.trial.of(np.flatnonzero(scores >= LEAST)))
        trial = self.pictures.new(pyramid, state.angles, patches, sd, still)
        return replace(state, patches=patches, trial=trial)

    def _trial_of(self, pyramid: list[Image32], state: WallState, sight: Sight) -> Doubt | None:
        """Return the trial of a view; None if it is known to be the wall.

        It is the wall if the patches look as before, or if they match after a turn at places in the
        picture where they did not match before it. Dirt stays in place: it matches there before and
        after.
        """
        alike = sight.likeness >= _SURE and sight.agreeing >= _MOST * sight.seen
        sure = alike or sight.agreeing >= max(_MANY * _FEWEST, _NEARLY * sight.seen)
        if sure or not (state.hunted or state.doubt):
            return None
        if state.doubt is None or state.missed > _GOING:
            return Doubt(pyramid[0], sight.angles)
        if np.abs(sight.angles - state.doubt.angles).max() < _TRIAL:
            return state.doubt
        some = state.patches.of(self.pictures.in_view(state.patches, sight.angles))
        now, before = (
            self.pictures.compared([image], 0, some, sight.angles, np.zeros(2))[0]
            for image in (pyramid[0], state.doubt.image)
        )
        turned = (now >= LEAST) & (before < 0.5 * LEAST)  # noise changes it by less
        return None if turned.sum() >= _FEWEST else state.doubt

    def _expected(self, state: WallState, t: float) -> FloatArray:
        """Return the angles at a time if the head continues its turn for a while."""
        if state.missed > _GOING:
            return state.angles
        passed = -_SETTLES * math.expm1(-(t - state.t) / _SETTLES)
        return np.clip(state.angles + passed * state.rates, self.low, self.high)

    def _missed(
        self, state: WallState, verdict: str, sight: Sight | None = None
    ) -> tuple[Sight, WallState]:
        found = nothing(verdict) if sight is None else sight
        return found, replace(state, missed=state.missed + 1)

    def _next_state(
        self, pyramid: list[Image32], state: WallState, sight: Sight, t: float
    ) -> WallState:
        """Return the state after a picture that showed the angles."""
        passed = t - state.t
        rates = (sight.angles - state.angles) / passed
        if state.missed > _GOING or (state.hunted and np.abs(rates).max() > _FASTEST):
            rates = np.zeros(2)
        patches, trial = self._try_new(pyramid, state, sight.angles, rates)
        origins = np.concatenate([patches.origins, trial.origins])
        if not (np.abs(origins - sight.angles).max(axis=1) < _TURNED).any():
            smear, every = np.hypot(sight.sd, _UNEVEN * rates), patches.with_more(trial)
            trial = trial.with_more(self.pictures.new(pyramid, sight.angles, every, smear, rates))
        return replace(
            state,
            patches=patches,
            trial=trial,
            angles=sight.angles,
            rates=rates,
            t=t,
            missed=0,
            hunted=0,
        )

    def _try_new(
        self, pyramid: list[Image32], state: WallState, angles: FloatArray, rates: FloatArray
    ) -> tuple[Patches, Patches]:
        """Return the patches with new ones that proved to be wall, and those still on trial.

        A new patch is wall if it still agrees after a turn, and agrees better than at its old place
        in the picture: dirt on the lens and reflections stay there. After a search all new patches
        are dropped: they may have caused the loss of the view.
        """
        trial = self.pictures.none if state.hunted else state.trial
        turned = np.abs(trial.origins - angles).max(axis=1) >= _TRIAL
        if not turned.any():
            return state.patches, trial
        ripe = trial.of(np.flatnonzero(turned))
        scores, stays = self.pictures.tried(pyramid, ripe, angles, rates)
        wall = ripe.of(np.flatnonzero((scores >= LEAST) & ~(stays >= scores)))
        return state.patches.with_more(wall), trial.of(np.flatnonzero(~turned))

    def _find(
        self, pyramid: list[Image32], state: WallState, start: FloatArray
    ) -> tuple[Sight, Patches]:
        """Return the angles near others at which patches agree, and mark patches that disagree."""
        patches, chosen = state.patches, self.pictures.in_view(state.patches, start)
        if chosen.size < _FEWEST:
            return nothing(NO_PATCH, 0, int(chosen.size)), patches
        levels = (2, 1, 0, 0) if state.missed or state.hunted else (1, 0)
        agreement = self.pictures.agreed(pyramid, patches.of(chosen), start, state.rates, levels)
        return self._judge(state, chosen, agreement)

    def _judge(
        self, state: WallState, chosen: npt.NDArray[np.int64], agreement: Agreement
    ) -> tuple[Sight, Patches]:
        """Return the angles if enough patches agree on them."""
        patches, searched = state.patches, state.hunted > 0
        angles, sd, scores = agreement.angles, agreement.sd, agreement.scores
        seen = np.isfinite(scores)
        agree = seen & (np.nan_to_num(scores, nan=-1.0) >= LEAST)
        hidden = (patches.poor[chosen] >= _HIDDEN) & (not searched and state.doubt is None)
        counts = int(agree.sum()), int((agree | (seen & ~hidden)).sum())
        fewest, one_in = _FEWEST, _ONE_IN
        if searched:
            fewest, one_in = min(2 * _FEWEST, max(counts[1], _ALL)), _SEARCHED
        needed = max(fewest, math.ceil(counts[1] / one_in))
        if counts[0] < needed:
            return nothing(FEW, *counts, needed), patches
        inside = (angles > np.array(self.low)) & (angles < np.array(self.high))
        if sd is None or not (sd.max() <= _WIDEST and inside.all()):
            return nothing(UNSURE, *counts), patches
        poor = patches.poor.copy()
        poor[chosen[seen & ~agree]] += 1
        poor[chosen[agree]] = 0
        likeness = float(np.median(scores[agree]))
        return Sight(angles, sd, *counts, SEEN, likeness), replace(patches, poor=poor)

    def _search_lost(
        self, pyramid: list[Image32], state: WallState
    ) -> tuple[tuple[Sight, Patches] | None, WallState]:
        """Try further angles for a lost view: beside the last ones, near old patches, and others.

        Angles near old patches come first: a head on its way back is beside its way there.
        """
        grid = self._grid
        pan, tilt = (np.abs(grid[:, n, None] - state.patches.origins[:, n]) for n in range(2))
        apart = np.maximum(pan, tilt).min(axis=1)
        order = np.lexsort((np.hypot(*(grid - state.angles).T), np.ceil(apart / _HUNT - 0.5)))
        each = (self.tries + 1) // 2
        around = min(max(each, int((apart <= _AROUND).sum())), len(order) - 1)
        near, far = np.split(grid[order], [around])
        beside, n = state.angles + self._beside, state.hunted
        parts = [some[n % len(some) :][:each] for some in (beside, near, far)]
        tried = np.concatenate(parts)
        state = replace(state, hunted=state.hunted + each)
        ranks = -self.pictures.searched(pyramid, state.patches, tried)
        best = int(np.argmin(ranks[: len(parts[0])]))
        others = len(parts[0]) + np.argsort(ranks[len(parts[0]) :])[:2]
        for index in (best, *others.tolist()):
            found_again = self._find(pyramid, state, tried[index])
            if found_again[0].verdict == SEEN:
                return found_again, state
        return None, state

    @cached_property
    def _beside(self) -> FloatArray:
        """Turns (n, 2) from the last angles, which are tried first, the smallest first."""
        axis = np.arange(-_BESIDE, _BESIDE + _FINE, _FINE)
        turns = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
        return np.asarray(turns[np.argsort(np.hypot(*turns.T), kind="stable")])

    @cached_property
    def _grid(self) -> FloatArray:
        """Angles (n, 2) at which a lost view is searched."""
        axes = [
            np.arange(low, high + _HUNT, _HUNT)
            for low, high in zip(self.low, self.high, strict=True)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
