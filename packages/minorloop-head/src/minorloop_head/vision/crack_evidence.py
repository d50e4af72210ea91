"""Evidence that a dark line on the wall is a crack, from profiles across its course.

A crack takes the same share of every light, and nothing beside it is brighter than the wall. A
groove has a bright flank beside a dark one, a stain another brightness on its other side, and the
share that a flank takes depends on the light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop_head.vision.imaging import Image32

LEAST_EVIDENCE = -0.25
"""Evidence above which a line counts as a crack: 0.03 false findings an acquisition of the scenes
of the fit, and as many cracks as with less."""
ALONG = (9.41, -5.22, 9.38, -11.63, 1.02)
WHOLE = (0.88, 2.97, 1.22)
"""Constant and weights of the features of places along a line, and of a whole line, by logistic
regression on scenes 5000 to 5199 of `papers.catheter.crack_scenes`, each with and without a
crack; by ``python -m benchmarks.cracks fit --first 5000 --count 200``."""
_DARK = 0.93
"""Share of the light of the wall that a crack takes."""
_SIDE, _CORE = 14, 9
"""Half texels to either side of a course, and those of them that may belong to the line; beyond
them is the wall: 0.23 mm contain half a crack of 0.3 mm with its blur."""
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
    length: float
    """In texels."""

    @property
    def widths(self) -> FloatArray:
        """Widths (N,) in texels of a black line that takes as much light."""
        net = self.taken[..., _core()].sum(axis=-1).mean(axis=0) * 0.5 / _DARK
        even: FloatArray = ndimage.median_filter(net, 5, mode="nearest")
        return np.maximum(even, 0.0)


def _core() -> slice:
    return slice(_SIDE - _CORE, _SIDE + _CORE + 1)


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
    return Profiles(smooth, taken, float(steps.sum()))


def smoothed(course: FloatArray, sd: float) -> FloatArray:
    """Return a course (N, 2) smoothed along itself, with its ends where they are."""
    beyond = round(4 * sd)
    # An end that is repeated would draw the smooth course back from it.
    padded = np.pad(course, ((beyond, beyond), (0, 0)), mode="reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(padded, sd, axis=0)[beyond:-beyond])


def _off(taken: FloatArray, off: FloatArray) -> FloatArray:
    """Return how far (N,) in texels the middle of the line is from its course."""
    dark = np.maximum(ndimage.gaussian_filter1d(taken.mean(axis=0), 1.5, axis=0), 0.0)
    dark = dark * np.exp(-0.5 * (off / 1.5) ** 2)  # the neighbour of the line is not part of it
    middle = (dark * off).sum(axis=1) / np.maximum(dark.sum(axis=1), 1e-6)
    shifted: FloatArray = ndimage.gaussian_filter1d(np.clip(middle, -1.5, 1.5), 1.0)
    return shifted


_LEAST, _MOST, _FINEST = -1.0, 3.0, 0.2
"""Evidence of a place above which it counts for its line, and most of it, so that no short part
decides alone; and texels of a course below which its bends are noise; by trial."""
FEATURES = ("net", "peak", "bright", "bent")
_LIKELY, _POSSIBLE, _FEWEST = -0.5, -2.0, 8
"""Evidence of a texel that may be of a crack, that of a part which goes on from such texels, and
fewest of them in a part; by trial. With less evidence scratches are joined to cracks, with more
faint parts are lost."""
_BRIDGED = 8
"""Texels of little evidence that are bridged within a course, by trial."""


def features_of(found: Profiles) -> FloatArray:
    """Return the features (N, F) of a line along its course; names are those of ``FEATURES``."""
    taken = ndimage.gaussian_filter1d(found.taken, _EVEN, axis=1, mode="nearest")
    core = taken[..., _core()]
    net = 0.5 * core.sum(axis=-1)
    whole = core.mean(axis=0)
    peak = np.maximum(whole[:, _CORE - 1 : _CORE + 2].mean(axis=-1), 0.02)
    dark = np.maximum(np.maximum(whole, 0).sum(axis=-1), 0.1)
    bright = np.maximum(-whole, 0).sum(axis=-1)
    typical = np.maximum(net.mean(axis=0), 0.05)
    near, far = (
        ndimage.gaussian_filter1d(found.course, size, axis=0, mode="nearest") for size in (1.5, 10)
    )
    bent = np.sqrt(ndimage.gaussian_filter1d(((near - far) ** 2).sum(axis=1), 10, mode="nearest"))
    return np.stack([np.log(typical), np.log(peak), bright / dark, np.log(_FINEST + bent)], axis=1)


def _evidence_along(found: Profiles, weights: Sequence[float] = ALONG) -> FloatArray:
    """Return the evidence (N,) of each place of a line, linear in its features."""
    each = weights[0] + features_of(found) @ np.array(weights[1:])
    even: FloatArray = ndimage.gaussian_filter1d(each, _EVEN, mode="nearest")
    return even


def likely_parts(found: Profiles, weights: Sequence[float] = ALONG) -> list[FloatArray]:
    """Return the parts (N, 2) of a course that may be those of a crack."""
    along = _evidence_along(found, weights)
    possible = np.pad(along > _POSSIBLE, _BRIDGED)
    possible = ndimage.binary_closing(possible, np.ones(_BRIDGED + 1, dtype=bool))
    labels, _ = ndimage.label(possible[_BRIDGED:-_BRIDGED])
    parts = [part for (part,) in ndimage.find_objects(labels)]
    return [found.course[part] for part in parts if (along[part] > _LIKELY).sum() >= _FEWEST]


def whole_features(found: Profiles, weights: Sequence[float] = ALONG) -> FloatArray:
    """Return the features (2,) of a whole line: how it is bent, and its evidence for a crack.

    A scratch is drawn by one motion, so that a parabola fits its course; grains turn a crack.
    Places count by their evidence: what crosses a crack does not count against it, and what noise
    bends does not count for it.
    """
    along = np.clip(_evidence_along(found, weights), _LEAST, _MOST) - _LEAST
    share = (along + 1e-6) / (along + 1e-6).sum()
    _, axes = np.linalg.eigh(np.cov(found.course.T))
    across, length = (found.course @ axes).T
    bent = across - np.polynomial.Polynomial.fit(length, across, 2, w=np.sqrt(share))(length)
    spread = float(np.sqrt((share * bent**2).sum()))
    return np.array([np.log(_FINEST + spread), (share * along).sum()])


def crack_evidence(found: Profiles) -> float:
    """Return the logarithm of the odds that a line is a crack, linear in its features."""
    return float(WHOLE[0] + whole_features(found) @ np.array(WHOLE[1:]))
