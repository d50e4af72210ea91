"""Patches of the wall in the pictures of a calibrated camera: found, compared and aligned.

A patch is stored as texels on the cylinder of the wall. For known angles of the head it has a place
in a picture, where it is sampled and compared with its first view.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.geometry import Pinhole, wall_point, wrapped
from minorloop_head.vision import _alignment_kernels as kernels
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image, numbers
from minorloop_head.vision.imaging import Image32, shrunk
from minorloop_head.vision.wall_patches import Patches

LEVELS = 3
"""Sizes of the picture: whole, half and quarter."""
_SMALLEST = 6.0
"""Least width of a patch in the picture, in pixels: fewer show no detail of it."""
_CELL = 20
"""Distance in pixels of the points of the picture about which new patches are searched."""
_MOST, _MOST_KEPT = 28, 1000
"""Most patches that are compared with a picture, the best known of each part of it first: more take
time without improving the angles. Most stored patches: ten for each place on the wall within
reach."""
_PARTS = 4
"""Parts of the picture in each direction: dirt on one half leaves patches in eight of sixteen."""
_POOR = 25
"""Consecutive pictures in which a patch disagrees, after which another may replace it: 1 s."""
_OWN_STEPS = 8
"""Steps of the alignment of a single patch: each leaves about half of the error."""
_COARSE = 2
"""Texels of a patch that `PatchPictures.searched` takes as one, along a side."""
_STEPS = 3
"""Steps of Gauss-Newton in each size of the picture, by trial."""
_CLOSE, _FARTHEST = 2e-5, math.radians(3.0)
"""Length of a step that ends the fit, and of the longest step, in radians."""
_ALIKE = 4.0
"""Texels whose noise is alike, since they share pixels."""
_LOGARITHMS = np.log(np.arange(256, dtype=np.float32) + 4)
"""Logarithms of grey levels, so that light becomes a sum."""
_ALL = 6
"""Fewest patches in view whose mean correlation has full weight in a search."""
_DERIVATIVE = 1e-4
"""Step in radians of numerical derivatives of the pose: errors are 1e-8."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """The angles at which patches agree best with a picture."""

    angles: FloatArray
    """Shape (2,). Pan and tilt, in radians."""
    sd: FloatArray | None
    """Shape (2,). Their standard deviations in radians; None if they are not determined."""
    scores: FloatArray
    """Shape (P,). Correlation of each patch there; NaN if it is not wholly in view."""


@dataclass(frozen=True, eq=False)
class PatchPictures:
    """Comparison of patches of the wall with pictures of a camera.

    Notes
    -----
    Grey levels are logarithms, so that light is a sum, and each patch is compared without its mean
    and slope. The sum of the correlations of all patches is maximised by Gauss-Newton steps on pan
    and tilt, from a quarter of the picture to the whole. The derivatives are those of the
    interaction matrix of a head with a lever (`minorloop_head.vision.servo`), of each texel.
    Patches whose correlation stays low, such as those on reflections, do not take part.

    References
    ----------
    Baker and Matthews, Lucas-Kanade 20 years on, 2004: the steps. Evangelidis and Psarakis,
    Parametric image alignment using enhanced correlation coefficient maximization, 2008: the
    criterion.
    """

    camera: CalibratedCamera
    size: float
    """Side of a patch, in metres."""
    least: float
    """Correlation of a patch that agrees."""
    readout: float = 0.0
    """Time in seconds from the first row of a picture to the last."""
    side: int = 16
    """Texels along a side of a patch."""
    width: float = 160.0
    """Most columns of a compared picture: in larger ones noise hides the wall."""
    detail: float = 0.013
    """Least contrast of a patch, as a share; noise of a grey picture has 1 %."""

    def agreed(
        self,
        pyramid: list[Image32],
        patches: Patches,
        start: FloatArray,
        rates: FloatArray,
        levels: Sequence[int],
    ) -> Agreement:
        """Return the angles near others at which patches agree, by three steps at each level."""
        angles, weights = start, np.ones(len(patches.sd))
        for level in levels:
            for _ in range(_STEPS):
                scores, normal, slope = self.compared(pyramid, level, patches, angles, rates)
                known = np.clip(np.nan_to_num(scores, nan=0.0), 0.0, 0.99)
                noise = 2.0 * _ALIKE / self.side**2 * (1.0 - known)
                weights = self._weights(scores, normal, noise, patches.sd)
                move = _solved(np.tensordot(weights, normal, 1), weights @ slope)
                if move is None:
                    break
                length = float(np.hypot(*move))
                angles = angles + move * min(1.0, _FARTHEST / max(length, 1e-12))
                if length < _CLOSE:
                    break
        sd = self._deviations(weights, noise, normal, slope, patches.sd)
        return Agreement(angles, sd, scores)

    def _deviations(
        self,
        weights: FloatArray,
        noise: FloatArray,
        normal: FloatArray,
        slope: FloatArray,
        known: FloatArray,
    ) -> FloatArray | None:
        """Return the standard deviations (2,) of the angles, None if they are not determined.

        The greater of two variances counts: that of the noise of the picture, and that of the
        disagreement of patches (Huber, 1967). Two parts are added: the last step of the fit, as it
        has not fully converged, and the error of the angles of the first views of the patches.
        """
        total = np.tensordot(weights, normal, 1)
        if not np.linalg.eigvalsh(total)[0] > 0:
            return None
        inverse = np.linalg.inv(total)
        last = inverse @ (weights @ slope)
        each = weights[:, None] * (slope - normal @ last)
        count = weights.sum()
        spread = inverse @ (each.T @ each) @ inverse * count / max(count - 2.0, 1.0)
        picture = inverse @ np.tensordot(weights**2 * noise, normal, 1) @ inverse
        place = weights @ known**2 / count
        return np.asarray(np.sqrt(np.maximum(np.diag(spread), np.diag(picture)) + last**2 + place))

    def _weights(
        self, scores: FloatArray, normal: FloatArray, noise: FloatArray, sd: FloatArray
    ) -> FloatArray:
        """Return the weights (P,) of patches by agreement and by variance of their places."""
        good = np.clip((np.nan_to_num(scores, nan=0.0) - 0.5 * self.least) / 0.5, 0.0, 1.0)
        own = 2.0 * noise / np.maximum(np.trace(normal, axis1=1, axis2=2), 1e-12)
        return np.asarray(good / (1.0 + (sd**2).mean(axis=1) / own))

    def searched(self, pyramid: list[Image32], patches: Patches, tried: FloatArray) -> FloatArray:
        """Return the mean correlation (M,) of patches at angles (M, 2), by every other texel.

        It is less where few are in view, and -1 where the lens would be beyond the wall.
        """
        poses = [self.camera.mount.pose(*each.tolist()) for each in tried]
        across = np.array([np.hypot(*pose.position[:2]) for pose in poses])
        few, shape, count = slice(None, None, _COARSE), (-1, self.side, self.side), len(patches.sd)
        points = patches.points.reshape(*shape, 3)[:, few, few].reshape(count, -1, 3)
        templates = patches.templates[-1].reshape(shape)[:, few, few].reshape(count, -1)
        lengths = np.linalg.norm(templates, axis=1, keepdims=True)
        found = np.empty(len(tried))
        kernels.search(
            pyramid[-1],
            np.ascontiguousarray(points),
            np.ascontiguousarray(templates / np.maximum(lengths, 1e-9)),
            self.side // _COARSE,
            numbers(self.lenses[-1]),
            np.array([pose.rotation for pose in poses]),
            np.array([pose.position for pose in poses]),
            _ALL,
            found,
        )
        return np.where(across < self.camera.radius, found, -1.0)

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
            self.side,
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
        """Return scores (P,), normal matrices (P, 2, 2) and turns (P, 2) that align patches."""
        count = len(patches.sd)
        scores, normal, off = np.empty(count), np.empty((count, 2, 2)), np.empty((count, 2))
        kernels.align_each(
            image, patches.points, patches.templates[0], self.side, numbers(self.lenses[0]),
            *self._pose(angles), _OWN_STEPS, scores, normal, off,
        )  # fmt: skip
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
        """Return which patches to compare: the best known of each part, in view and not poor."""
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
        """Return new patches where the picture shows detail and has no known patch."""
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
        return self.at(places[free], pyramid, angles, sd, rates)

    def at(
        self,
        middles: FloatArray,
        pyramid: list[Image32],
        angles: FloatArray,
        sd: FloatArray,
        rates: FloatArray,
    ) -> Patches:
        """Return the patches about places (P, 2) that a picture shows wholly and with detail."""
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
                whole[n] &= seen and kernels.normalise(values, self.side) > self.detail * self.side
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
        """Return the scores (P,) of patches as wall, and as dirt in the same place on the lens."""
        scores, stays = self.compared(pyramid, 0, trial, angles, rates)[0], np.empty(len(trial.sd))
        for origin in np.unique(trial.origins, axis=0):
            same = np.flatnonzero((trial.origins == origin).all(axis=1))
            stays[same] = self.compared(pyramid, 0, trial.of(same), origin, np.zeros(2))[0]
        return scores, stays

    def _beside(self, places: FloatArray, others: FloatArray) -> BoolArray:
        """Return for each pair (n, m) whether a place is beside another one."""
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

    def pyramid(self, image: Image, levels: int = LEVELS) -> list[Image32]:
        """Return the logarithm of a picture in several sizes, so that light is a sum."""
        found = [_LOGARITHMS[image]]
        while len(found) < self._halvings + levels:
            found.append(shrunk(found[-1]))
        return found[self._halvings :]

    @property
    def lenses(self) -> list[Pinhole]:
        """The lens at each size of the picture."""
        return _scaled(self.camera.lens, self._halvings)

    @cached_property
    def _halvings(self) -> int:
        """Number of halvings of the largest compared picture."""
        return max(round(math.log2(self.camera.lens.width / self.width)), 0)

    @cached_property
    def none(self) -> Patches:
        """No patches."""
        texels = self.side**2
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
        """Pixels (n, 2) about which new patches are searched."""
        lens = self.camera.lens
        step = _CELL * lens.width / 320
        u, v = np.arange(step / 2, lens.width, step), np.arange(step / 2, lens.height, step)
        return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)

    @cached_property
    def _offsets(self) -> tuple[FloatArray, FloatArray]:
        """Texels of a patch from its middle, around and along the pipe, in metres."""
        steps = (np.arange(self.side) - 0.5 * (self.side - 1)) * self.size / self.side
        around, along = np.meshgrid(steps, steps)
        return around.ravel(), along.ravel()


@lru_cache(maxsize=8)
def _scaled(lens: Pinhole, skipped: int) -> list[Pinhole]:
    """Return a lens at each size of a picture; a camera that travels has the same ones."""
    return [lens.scaled(0.5 ** (skipped + n)) for n in range(LEVELS)]


def _solved(matrix: FloatArray, slope: FloatArray) -> FloatArray | None:
    """Return the solution (2,) of the normal equations, None if they do not determine it."""
    values = np.linalg.eigvalsh(matrix)
    if not values[0] > 1e-6 * values[1] > 0:
        return None
    return np.asarray(np.linalg.solve(matrix, slope))
