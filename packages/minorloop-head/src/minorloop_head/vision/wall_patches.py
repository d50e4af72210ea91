"""What is remembered of the wall of the pipe, and what a picture of it says about the angles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.vision.imaging import Image32

SEEN = "seen"
"""Verdict of a picture that shows the angles; others say why it does not."""
LATE, FEW, NO_PATCH, UNSURE = (
    "late",
    "too few patches agree",
    "no patch in view",
    "the patches in view do not tell the angles",
)


UNTURNED = "the view that was found again has not turned with the head yet"
"""Why angles are on trial."""
_HIDDEN_OR_NEW = (
    "something is before the wall, the light changed, this wall was not seen before, or the camera "
    "is not as it was calibrated"
)
"""Why too few patches agree."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What a picture says about the angles."""

    angles: FloatArray
    """Shape (2,). Pan and tilt of the line of sight in radians; NaN where it does not tell."""
    sd: FloatArray
    """Shape (2,). Their standard deviations in radians: by the noise of the picture, by how much
    the patches disagree, and by how well their places are known."""
    agreeing: int
    seen: int
    """Number of patches that agree, and of those in view."""
    verdict: str
    """``seen``, or why there are no angles."""
    likeness: float = math.nan
    """Median correlation of the patches that agree."""
    trial: bool = False
    """Whether the angles may be those of dirt on the lens: a search found them, the patches do not
    look as they did or a part disagrees, and no turn of the head has confirmed them yet."""
    needed: int = 0
    """Number of patches that must agree; 0 where too few are not the reason."""

    @property
    def searched(self) -> bool:
        """Whether the angles were looked for: not in a picture that shows nothing."""
        return self.verdict in (SEEN, FEW, NO_PATCH, UNSURE)

    @property
    def reason(self) -> str:
        """Why there are no angles, or they are on trial, in words; empty if neither is so."""
        counts = f"{self.agreeing} of {self.seen} patches of wall in view agree"
        if self.trial:
            return f"{UNTURNED}, and {counts}"
        if self.verdict == SEEN:
            return ""
        if self.verdict == FEW:
            return f"{counts}, and {self.needed} are needed: {_HIDDEN_OR_NEW}"
        return (
            self.verdict if self.seen or " " in self.verdict else f"the picture is {self.verdict}"
        )


@dataclass(frozen=True, eq=False)
class Patches:
    """Remembered patches of the wall."""

    places: FloatArray
    """Shape (P, 2). Phi and z of their middles."""
    points: FloatArray
    """Shape (P, N, 3). Their texels in the pipe, in metres."""
    templates: FloatArray
    """Shape (levels, P, N). Logarithms of grey levels without mean and slope, of length 1, in each
    size of the picture."""
    origins: FloatArray
    """Shape (P, 2). Angles at which each was first seen, in radians."""
    sd: FloatArray
    """Shape (P, 2). Standard deviations of those angles, in radians."""
    poor: npt.NDArray[np.int64]
    """Shape (P,). Pictures in a row in which each was in view and did not agree."""

    def of(self, chosen: npt.NDArray[np.int64]) -> Patches:
        """Return some of them."""
        return Patches(
            self.places[chosen],
            self.points[chosen],
            np.take(self.templates, chosen, axis=1),  # in the order in which loops are compiled
            self.origins[chosen],
            self.sd[chosen],
            self.poor[chosen],
        )

    def with_more(self, other: Patches) -> Patches:
        """Return these and others."""
        return Patches(
            np.concatenate([self.places, other.places]),
            np.concatenate([self.points, other.points]),
            np.concatenate([self.templates, other.templates], axis=1),
            np.concatenate([self.origins, other.origins]),
            np.concatenate([self.sd, other.sd]),
            np.concatenate([self.poor, other.poor]),
        )


@dataclass(frozen=True, eq=False)
class Doubt:
    """A view that a search found and that may be dirt on the lens."""

    image: Image32
    """Shape (height, width). Logarithm of the picture in which it was found, in the largest size
    that is compared."""
    angles: FloatArray
    """Shape (2,). Those found in it, in radians."""


@dataclass(frozen=True, eq=False)
class WallState:
    """State of the estimator."""

    patches: Patches
    """Those that are known to be wall."""
    trial: Patches
    """New ones, which may be dirt on the lens."""
    angles: FloatArray
    rates: FloatArray
    """Shape (2,). Of the last picture that showed them, in radians and radians per second."""
    t: float
    """When that was, in seconds."""
    missed: int
    """Pictures since."""
    hunted: int
    """Angles that were tried in the search for a lost view."""
    earlier: tuple[int, ...]
    """Check sums of the last pictures, to detect repeated ones."""
    newest: float
    """Time of the newest picture."""
    doubt: Doubt | None = None
    """Of the view, None if it is known to be the wall."""


def nothing(verdict: str, agreeing: int = 0, seen: int = 0, needed: int = 0) -> Sight:
    """Return the sight of a picture that does not show the angles."""
    none = np.full(2, np.nan)
    return Sight(none, none, agreeing, seen, verdict, needed=needed)
