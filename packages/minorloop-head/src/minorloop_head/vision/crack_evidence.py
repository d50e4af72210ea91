"""Evidence that a line on the wall is a crack, from profiles across its course.

A crack is a thin line with bends. Under each light it is darker or brighter than the wall on both
of its sides, and its flanks reflect lights from different sides differently. A scratch is straight;
the wall inside the rim of a bead or a stain has another brightness than outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop_head.vision import _line_kernels as kernels
from minorloop_head.vision.crack_widths import measured_widths
from minorloop_head.vision.imaging import Image32

LEAST_EVIDENCE = 1.0
"""Evidence above which a line counts as a crack: with 0.5, one of six inspections reports a scratch
as a crack."""
WEIGHTS = Path(__file__).with_name("crack_weights.npz")
"""Trees for places and weights for whole lines, written by ``python -m benchmarks.cracks fit``."""
PLATE_WEIGHTS = Path(__file__).with_name("plate_weights.npz")
"""The same for rough plates in unknown light, written by ``python -m benchmarks.plates fit``."""
_SIDE, _CORE = 24, 9
"""Half texels of a profile to either side of a course, and of the line; the rest is wall: 0.23 mm
contain half of a crack of 0.3 mm with its blur, and 0.6 mm show the inside of a stain whose edge is
the line."""
_SMOOTH = 2.0
"""Standard deviation in texels by which a course of whole texels is smoothed, by trial."""
_EVEN = 4.0
"""Standard deviation in texels over which profiles are averaged along a course, as in the heights
of lines."""


@dataclass(frozen=True, eq=False)
class Profiles:
    """Shares of the light that a line takes, across its course."""

    course: FloatArray
    """Shape (N, 2). Rows and columns along it, in texels."""
    taken: FloatArray
    """Shape (K, N, M). Share taken under each light, every half texel across; negative where it is
    brighter than the wall."""
    step: FloatArray
    """Shape (K, N). Logarithm of the brightness on one side over that on the other."""
    length: float
    """In texels."""

    def widths(self) -> tuple[FloatArray, FloatArray]:
        """Return the widths (N,) along the course and their standard deviations, in texels."""
        return measured_widths(self.taken, _SIDE, _CORE, _EVEN)


def profiles_of(course: FloatArray, levels: Image32) -> Profiles:
    """Return the profiles of a course (N, 2) of rows and columns on maps (K, rows, columns)."""
    smooth = smoothed(course, _SMOOTH)
    off = np.arange(-_SIDE, _SIDE + 1) / 2
    for last in (False, True):
        heading = np.gradient(smooth, axis=0)
        norm = np.maximum(np.hypot(heading[:, 0], heading[:, 1]), 1e-9)[:, None]
        normal = np.stack([-heading[:, 1], heading[:, 0]], axis=1) / norm
        lines = np.moveaxis(smooth[:, None, :] + off[None, :, None] * normal[:, None, :], -1, 0)
        across = np.stack(
            [ndimage.map_coordinates(one, lines, order=1, mode="nearest") for one in levels]
        ).astype(np.float64)
        left = np.median(across[..., : _SIDE - _CORE], axis=-1)
        right = np.median(across[..., _SIDE + _CORE + 1 :], axis=-1)
        left, right = (
            ndimage.gaussian_filter1d(one, _EVEN, axis=-1, mode="nearest") for one in (left, right)
        )
        share = (np.arange(2 * _SIDE + 1) / (2 * _SIDE)).astype(np.float64)
        ground = left[..., None] * (1 - share) + right[..., None] * share
        taken = 1 - np.exp(across - ground)
        if not last:
            smooth = smooth + _off(taken, off)[:, None] * normal
    steps = np.hypot(*np.diff(smooth, axis=0).T)
    return Profiles(smooth, taken, left - right, float(steps.sum()))


def smoothed(course: FloatArray, sd: float) -> FloatArray:
    """Return a course (N, 2) smoothed along itself, with its ends where they are."""
    beyond = round(4 * sd)
    # Repeated end points would shorten the smooth course.
    padded = np.pad(course, ((beyond, beyond), (0, 0)), mode="reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(padded, sd, axis=0)[beyond:-beyond])


def _off(taken: FloatArray, off: FloatArray) -> FloatArray:
    """Return the distances (N,) of the middle of the line from its course, in texels."""
    share = np.abs(ndimage.gaussian_filter1d(taken, 1.5, axis=1)).mean(axis=0)
    share = share * np.exp(-0.5 * (off / 1.5) ** 2)  # the neighbour of the line is not part of it
    middle = (share * off).sum(axis=1) / np.maximum(share.sum(axis=1), 1e-6)
    shifted: FloatArray = ndimage.gaussian_filter1d(np.clip(middle, -1.5, 1.5), 1.0)
    return shifted


FEATURES = (
    "height",
    "amount",
    "height over texture",
    "height over wall",
    "height over noise",
    "alike",
    "change over amount",
    "beyond",
    "breadth",
    "odd",
    "sign",
    "uneven",
    "bent near",
    "bent far",
    "straight",
    "step",
    "beside",
    "change",
    "closed",
    "change over wall",
)
_NEARBY = (10, 20, 30)
"""Texels over which a course is compared with its smoothed course, and to either side over which
its straightness is computed."""
_LIKELY, _POSSIBLE, _FEWEST = -0.5, -2.0, 8
"""Evidence that starts a part of a crack, evidence that continues it, and fewest starting texels in
a part; by trial. With less evidence scratches are joined to cracks, with more faint parts are
lost."""
_BRIDGED = 8
"""Longest gap of little evidence in texels that is bridged within a course, by trial."""
_LEAST, _MOST, _FINEST = -1.0, 3.0, 0.2
"""Evidence above which a place counts for its line, and its limit, so that no short part decides
alone; and length of a course in texels below which its bends are noise; by trial."""


def features_of(found: Profiles, texture: float) -> FloatArray:
    """Return the features (N, F) of a line along its course; names are those of ``FEATURES``.

    ``texture`` is the median height of lines on the wall. ``height`` is the largest share of light
    that the line takes, ``amount`` the sum of shares across; ``wall`` and ``noise`` the variation
    beside the line, along it and between texels; ``alike`` the part common to all lights,
    ``change`` the differences between them; ``beyond`` the difference from the brightness of both
    sides, ``breadth`` amount over height, ``odd`` the part with two signs across, ``sign`` 1 for
    dark and -1 for bright; ``uneven`` the change of height along; ``step`` the difference of both
    sides and ``beside`` their level farther off, over the height; ``closed`` small if ends meet;
    ``change over wall`` the largest difference between lights over that beside the line.
    """
    even = _smoothed(found.taken, _EVEN, 1)
    off = np.abs(np.arange(-_SIDE, _SIDE + 1))
    core, wall = even[..., off <= _CORE], even[..., off > _CORE]
    rough = (found.taken - even)[..., off > _CORE]
    sizes = np.abs(core)
    each = sizes.max(axis=-1).mean(axis=0)
    height = np.maximum(each, 0.01)
    amount = np.maximum(0.5 * sizes.sum(axis=-1).mean(axis=0), 0.03)
    noise = np.sqrt(_smoothed((rough**2).mean(axis=(0, 2)), 6.0))
    spread = even.std(axis=0)
    between, beside = spread[:, off <= _CORE], spread[:, off > _CORE]
    change = 0.5 * between.sum(axis=-1)
    middle = np.abs(core[..., _CORE - 2 : _CORE + 3].mean(axis=-1))
    odd = 0.5 * np.abs(core - core[..., ::-1]).sum(axis=-1).mean(axis=0)
    ripple = _smoothed(each, 1.0)
    ripple = np.sqrt(_smoothed((ripple - _smoothed(ripple, 8.0)) ** 2, 8.0))
    near = _smoothed(found.course, 1.5, 0)
    bent = [
        np.sqrt(_smoothed(((near - _smoothed(found.course, size, 0)) ** 2).sum(axis=1), size))
        for size in _NEARBY[:2]
    ]
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(found.course, axis=0).T)))
    places = np.arange(len(way))
    low, high = (np.clip(places + n, 0, len(way) - 1) for n in (-_NEARBY[2], _NEARBY[2]))
    chord = np.hypot(*(found.course[high] - found.course[low]).T)
    ends = float(np.hypot(*(found.course[-1] - found.course[0])))
    return np.stack(
        [
            height,
            amount,
            height / texture,
            height / (np.sqrt((wall**2).mean(axis=(0, 2))) + 0.01),
            height / (noise + 0.01),
            0.5 * np.abs(core.mean(axis=0)).sum(axis=-1) / amount,
            change / amount,
            (middle - 0.5 * np.abs(found.step)).mean(axis=0) / height,
            amount / height,
            0.5 * odd / amount,
            0.5 * core.sum(axis=-1).mean(axis=0) / amount,
            ripple / height,
            *bent,
            chord / np.maximum(way[high] - way[low], 1e-6),
            np.abs(found.step).mean(axis=0) / height,
            np.abs(even[..., off > 16].mean(axis=-1)).mean(axis=0) / height,
            change,
            np.full(len(way), ends / max(way[-1], 1e-6)),
            between.max(axis=-1) / (np.sqrt((beside**2).mean(axis=-1)) + 0.005),
        ],
        axis=1,
    )


def _smoothed(values: FloatArray, size: float, axis: int = 0) -> FloatArray:
    even: FloatArray = ndimage.gaussian_filter1d(values, size, axis=axis, mode="nearest")
    return even


@dataclass(frozen=True, eq=False)
class CrackOdds:
    """Logarithms of odds: of places by boosted trees, of whole lines linear in their features."""

    base: float
    """Evidence of a place before any tree."""
    first: npt.NDArray[np.int32]
    """Shape (T,). First node of each tree."""
    feature: npt.NDArray[np.int8]
    """Shape (nodes,). Feature that is compared; -1 at a leaf."""
    threshold: FloatArray
    """Shape (nodes,). Threshold, up to which the lower branch is taken."""
    branches: npt.NDArray[np.int16]
    """Shape (nodes, 2). Lower and upper branch, counted from the first node of the tree."""
    value: FloatArray
    """Shape (nodes,). Value that a leaf adds."""
    whole: FloatArray
    """Constant and weights of `whole_features`."""

    def along(self, features: FloatArray) -> FloatArray:
        """Return the evidence (N,) of each place of a line with features (N, F)."""
        each = kernels.sum_of_trees(
            features, self.first, self.feature, self.threshold, self.branches, self.value
        )
        return _smoothed(self.base + each, _EVEN)

    def of_line(self, found: Profiles, along: FloatArray) -> float:
        """Return the evidence of a whole line from that along it."""
        return float(self.whole[0] + whole_features(found, along) @ self.whole[1:])

    def save(self, path: Path) -> None:
        """Write the odds to a file of NumPy."""
        np.savez_compressed(path, **vars(self))


def likely_parts(found: Profiles, along: FloatArray) -> list[FloatArray]:
    """Return the parts (N, 2) of a course that may belong to a crack."""
    possible = np.pad(along > _POSSIBLE, _BRIDGED)
    possible = ndimage.binary_closing(possible, np.ones(_BRIDGED + 1, dtype=bool))
    labels, _ = ndimage.label(possible[_BRIDGED:-_BRIDGED])
    parts = [part for (part,) in ndimage.find_objects(labels)]
    return [found.course[part] for part in parts if (along[part] > _LIKELY).sum() >= _FEWEST]


def whole_features(found: Profiles, along: FloatArray) -> FloatArray:
    """Return the features (5,) of a whole line from the evidence (N,) along it.

    They are its bend, its evidence where it is likely, its mean evidence, its length, and the
    distance of its ends. One motion makes a scratch, so that a parabola fits its course; grains
    turn a crack. Places are weighted by their evidence: lines that cross a crack do not count
    against it, and bends by noise do not count for it.
    """
    counted = np.clip(along, _LEAST, _MOST) - _LEAST
    share = (counted + 1e-6) / (counted + 1e-6).sum()
    _, axes = np.linalg.eigh(np.cov(found.course.T))
    across, length = (found.course @ axes).T
    bent = across - np.polynomial.Polynomial.fit(length, across, 2, w=np.sqrt(share))(length)
    spread = float(np.sqrt((share * bent**2).sum()))
    ends = float(np.hypot(*(found.course[-1] - found.course[0])))
    return np.array(
        [
            np.log(_FINEST + spread),
            (share * counted).sum(),
            np.clip(along, -_MOST, _MOST).mean(),
            np.log(found.length),
            ends / found.length,
        ]
    )


@cache
def crack_odds(weights: Path = WEIGHTS) -> CrackOdds:
    """Return the odds in a file, those of the wall of a pipe if none is given."""
    with np.load(weights) as kept:
        return CrackOdds(**{name: kept[name] for name in kept.files})
