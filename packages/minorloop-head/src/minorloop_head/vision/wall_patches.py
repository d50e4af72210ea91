"""Stored patches of the wall of the pipe, and the angles that a picture of it gives."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.vision.imaging import Image32

SEEN = "seen"
"""Verdict of a picture that shows the angles; other verdicts say why it does not."""
LATE, FEW, NO_PATCH, UNSURE = (
    "late",
    "too few patches agree",
    "no patch in view",
    "the patches in view do not determine the angles",
)


UNTURNED = "the view found in a search has not turned with the head yet"
"""Reason why angles are on trial."""
_HIDDEN_OR_NEW = (
    "something is before the wall, the light changed, this wall was not seen before, or the camera "
    "is not as it was calibrated"
)
"""Reasons why too few patches agree."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Angles that a picture gives."""

    angles: FloatArray
    """Shape (2,). Pan and tilt of the line of sight in radians; NaN if they are unknown."""
    sd: FloatArray
    """Shape (2,). Their standard deviations in radians: from the noise of the picture, from the
    disagreement of patches, and from the errors of their places."""
    agreeing: int
    seen: int
    """Number of patches that agree, and of patches in view."""
    verdict: str
    """``seen``, or why there are no angles."""
    likeness: float = math.nan
    """Median correlation of the patches that agree."""
    trial: bool = False
    """Whether the angles may be those of dirt on the lens: a search found them, the patches look
    different or a part disagrees, and no turn of the head has confirmed them yet."""
    needed: int = 0
    """Number of patches that must agree; 0 if the verdict has another reason."""

    @property
    def searched(self) -> bool:
        """Whether the picture was searched for the view: not if it shows nothing."""
        return self.verdict in (SEEN, FEW, NO_PATCH, UNSURE)

    @property
    def reason(self) -> str:
        """Reason why angles are missing or on trial, in words; empty without one."""
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
    """Stored patches of the wall."""

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
    """Shape (P,). Consecutive pictures in which each was in view and disagreed."""

    def of(self, chosen: npt.NDArray[np.int64]) -> Patches:
        """Return the chosen patches."""
        return Patches(
            self.places[chosen],
            self.points[chosen],
            np.take(self.templates, chosen, axis=1),  # in the order in which loops are compiled
            self.origins[chosen],
            self.sd[chosen],
            self.poor[chosen],
        )

    def with_more(self, other: Patches) -> Patches:
        """Return these patches and others."""
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
    """A found view that may be dirt on the lens."""

    image: Image32
    """Shape (height, width). Logarithm of the picture in which it was found, in the largest
    compared size."""
    angles: FloatArray
    """Shape (2,). Angles found in it, in radians."""


@dataclass(frozen=True, eq=False)
class WallState:
    """State of the estimator."""

    patches: Patches
    """Patches that are known to be wall."""
    trial: Patches
    """New patches, which may be dirt on the lens."""
    angles: FloatArray
    rates: FloatArray
    """Shape (2,). Values of the last picture that showed them, in rad and rad/s."""
    t: float
    """Time of that picture, in seconds."""
    missed: int
    """Number of pictures since."""
    hunted: int
    """Number of angles tried in the search for a lost view."""
    earlier: tuple[int, ...]
    """Check sums of the last pictures, to detect repeated ones."""
    newest: float
    """Time of the newest picture."""
    doubt: Doubt | None = None
    """Doubt about the view; None if it is known to be the wall."""


def nothing(verdict: str, agreeing: int = 0, seen: int = 0, needed: int = 0) -> Sight:
    """Return the result for a picture that does not show the angles."""
    none = np.full(2, np.nan)
    return Sight(none, none, agreeing, seen, verdict, needed=needed)
