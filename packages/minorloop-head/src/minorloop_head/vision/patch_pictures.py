"""Patches of the wall in the pictures of a calibrated camera: found, compared and aligned.

A patch is remembered as texels on the cylinder of the wall. At given angles of the head it has a
place in a picture, where it is sampled and compared with how it was seen first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.geometry import Pinhole, wall_point, wrapped
from minorloop_head.vision import _alignment_kernels as kernels
from minorloop_head.vision.calibrated_camera import (
    CalibratedCamera,
    Image,
    numbers,
)
from minorloop_head.vision.imaging import Image32, shrunk
from minorloop_head.vision.wall_patches import Patches

SIDE = 16  # texels along a side of a patch
LEVELS = 3
"""Sizes of the picture: whole, half and quarter."""
_SMALLEST = 6.0
"""Least width of a patch in the picture, in pixels: fewer show no detail of it."""
_CELL = 20
"""Pixels between points of the picture about which new patches are looked for."""
_MOST, _MOST_KEPT = 28, 1000
"""Patches that are compared with a picture, the best known of each part of it first: more do not
make the angles better, but take time. Patches that are kept: ten for each that the wall within
reach has."""
_PARTS = 4
"""Parts of the picture each way: a fouled half leaves patches in eight of sixteen."""
_POOR = 25
"""Pictures in a row in which a patch disagrees, after which another may take its place: 1 s."""
_OWN_STEPS = 8
"""Steps of a patch by itself: each leaves about half of what it is off."""
_WIDTH = 160.0
"""Columns of the largest picture that is compared: in more, noise hides the wall."""
_DERIVATIVE = 1e-4
"""Difference in radians for derivatives of the pose: errors of 1e-8."""


@dataclass(frozen=True, eq=False)
class PatchPictures:
    """How patches of the wall look in pictures of a camera.

    Parameters
    ----------
    camera : CalibratedCamera
    size : float
        Side of a patch, in metres.
    readout : float
        Time in seconds from the first row of a picture to the last.
    """

    camera: CalibratedCamera
    size: float
    readout: float

    def compared(
        self,
        pyramid: list[Image32],
        level: int,
        patches: Patches,
        angles: FloatArray,
        rates: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return scores (P,), normal matrices (P, 2, 2) and slopes (P, 2) at angles."""
        count = len(patches.sd)
        scores, normal, slope = np.empty(count), np.empty((count, 2, 2)), np.empty((count, 2))
        kernels.align(
            pyramid[level],
            patches.points,
            patches.templates[level],
            SIDE,
            numbers(self.lenses[level]),
            *self._pose(angles),
            rates * self.readout / pyramid[level].shape[0],
            scores,
            normal,
            slope,
        )
        return scores, normal, slope

    def aligned(
        self, image: Image32, patches: Patches, angles: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return scores (P,), normal matrices (P, 2, 2), and by how much each is off (P, 2)."""
        count = len(patches.sd)
        scores, normal, off = np.empty(count), np.empty((count, 2, 2)), np.empty((count, 2))
        kernels.align_each(
            image,
            patches.points,
            patches.templates[0],
            SIDE,
            numbers(self.lenses[0]),
            *self._pose(angles),
            _OWN_STEPS,
            scores,
            normal,
            off,
        )
        return scores, normal, off

    def _pose(self, angles: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return rotation, position, and their derivatives by pan and tilt."""
        pan, tilt = angles.tolist()
        h, mount = _DERIVATIVE, self.camera.mount
        now = mount.pose(pan, tilt)
        pairs = [
            (mount.pose(pan + h, tilt), mount.pose(pan - h, tilt)),
            (mount.pose(pan, tilt + h), mount.pose(pan, tilt - h)),
        ]
        turns = np.array([(a.rotation - b.rotation) / (2 * h) for a, b in pairs])
        moves = np.array([(a.position - b.position) / (2 * h) for a, b in pairs])
        return np.ascontiguousarray(now.rotation), now.position, turns, moves

    def in_view(self, patches: Patches, angles: FloatArray) -> npt.NDArray[np.int64]:
        """Return which patches to compare: in view, not poor, and the best known of each part."""
        if not self.camera.inside(*angles.tolist()):
            return np.empty(0, dtype=np.int64)
        pixels = self.camera.pixel(patches.places, *angles.tolist())
        lens = self.camera.lens
        with np.errstate(invalid="ignore"):
            inside = np.asarray(((pixels > 0) & (pixels < (lens.width, lens.height))).all(axis=1))
        poor = patches.poor >= _POOR
        order = np.lexsort((np.hypot(*patches.sd.T), poor))
        order = order[inside[order]]
        column, row = (pixels[order] * _PARTS // (lens.width, lens.height)).T
        before = np.tril(np.equal.outer(row * _PARTS + column, row * _PARTS + column), -1)
        return np.asarray(order[np.lexsort((before.sum(axis=1), poor[order]))][:_MOST])

    def new(
        self,
        pyramid: list[Image32],
        angles: FloatArray,
        known: Patches,
        sd: FloatArray,
        rates: FloatArray,
    ) -> Patches:
        """Return new patches where the picture shows detail without a known one."""
        pan, tilt = angles.tolist()
        if not self.camera.inside(pan, tilt) or len(known.sd) >= _MOST_KEPT:
            return self.none
        places = self.camera.place(self._cells, pan, tilt)
        taken = known.places[known.poor < _POOR]
        places = places[np.isfinite(places).all(axis=1)]
        places = places[~self._beside(places, taken).any(axis=1)]
        places = places[self._large(places, pan, tilt)]
        free = np.ones(len(places), dtype=bool)
        crowded = self._beside(places, places)
        for n in range(len(places)):
            free[n + 1 :] &= ~(free[n] & crowded[n, n + 1 :])
        middles = places[free]
        if not len(middles):
            return self.none
        points = wall_point(
            middles[:, :1] + self._offsets[0] / self.camera.radius,
            middles[:, 1:] + self._offsets[1],
            self.camera.radius,
        )
        pose = self._pose(angles)
        templates = np.zeros((LEVELS, *points.shape[:2]))
        whole = np.ones(len(middles), dtype=bool)
        slopes = np.empty((2, points.shape[1]))
        for level in range(LEVELS):
            lens = numbers(self.lenses[level])
            shift = rates * self.readout / pyramid[level].shape[0]
            for n in range(len(middles)):
                values = templates[level, n]
                seen = kernels.sample(pyramid[level], points[n], lens, *pose, shift, values, slopes)
                whole[n] &= seen and kernels.normalise(values, SIDE) > self._detail
        return Patches(
            middles[whole],
            points[whole],
            templates[:, whole],
            np.tile(angles, (int(whole.sum()), 1)),
            np.tile(sd, (int(whole.sum()), 1)),
            np.zeros(int(whole.sum()), dtype=np.int64),
        )

    def tried(
        self, pyramid: list[Image32], trial: Patches, angles: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the scores (P,) of patches as wall, and as dirt that stays where it first was."""
        scores, stays = self.compared(pyramid, 0, trial, angles, rates)[0], np.empty(len(trial.sd))
        for origin in np.unique(trial.origins, axis=0):
            same = np.flatnonzero((trial.origins == origin).all(axis=1))
            stays[same] = self.compared(pyramid, 0, trial.of(same), origin, np.zeros(2))[0]
        return scores, stays

    def _beside(self, places: FloatArray, others: FloatArray) -> BoolArray:
        """Return (n, m) which places are beside which others."""
        x = self.camera.radius * np.abs(wrapped(places[:, None, 0] - others[:, 0]))
        apart = np.maximum(x, np.abs(places[:, None, 1] - others[:, 1]))
        return np.asarray(apart < 0.8 * self.size)

    def _large(self, middles: FloatArray, pan: float, tilt: float) -> BoolArray:
        """Return which patches are large enough in the picture to show detail."""
        around, along = np.array([self.size / self.camera.radius, 0.0]), np.array([0.0, self.size])
        ends = [
            self.camera.pixel(middles + 0.5 * sign * way, pan, tilt)
            for way in (around, along)
            for sign in (-1, 1)
        ]
        widths = [np.linalg.norm(ends[k + 1] - ends[k], axis=1) for k in (0, 2)]
        with np.errstate(invalid="ignore"):
            return np.asarray(np.min(widths, axis=0) >= _SMALLEST)

    def pyramid(self, image: Image) -> list[Image32]:
        """Return the logarithm of a picture in several sizes."""
        whole = np.empty(image.shape, dtype=np.float32)
        kernels.logarithm(np.ascontiguousarray(image), whole)
        found = [whole]
        while len(found) < self._skipped + LEVELS:
            found.append(shrunk(found[-1]))
        return found[self._skipped :]

    @cached_property
    def lenses(self) -> list[Pinhole]:
        """The lens at each size of the picture."""
        return [self.camera.lens.scaled(0.5 ** (self._skipped + n)) for n in range(LEVELS)]

    @cached_property
    def _skipped(self) -> int:
        """How often the largest picture that is compared is halved."""
        return max(round(math.log2(self.camera.lens.width / _WIDTH)), 0)

    @cached_property
    def none(self) -> Patches:
        """No patches."""
        texels = SIDE * SIDE
        return Patches(
            np.empty((0, 2)),
            np.empty((0, texels, 3)),
            np.empty((LEVELS, 0, texels)),
            np.empty((0, 2)),
            np.empty((0, 2)),
            np.empty(0, dtype=np.int64),
        )

    @cached_property
    def _cells(self) -> FloatArray:
        """Pixels (n, 2) about which new patches are looked for."""
        lens = self.camera.lens
        step = _CELL * lens.width / 320
        u, v = np.arange(step / 2, lens.width, step), np.arange(step / 2, lens.height, step)
        return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)

    @cached_property
    def _offsets(self) -> tuple[FloatArray, FloatArray]:
        """Texels of a patch from its middle, around and along the pipe, in metres."""
        steps = (np.arange(SIDE) - 0.5 * (SIDE - 1)) * self.size / SIDE
        around, along = np.meshgrid(steps, steps)
        return around.ravel(), along.ravel()

    @cached_property
    def _detail(self) -> float:
        """Least length of a patch's logarithms: 1.3 % contrast; noise of a grey picture has 1 %."""
        return 0.013 * SIDE
