"""Views of an inspection: the candidates in each, and the candidate that it confirms or rejects."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from minorloop.arrays import FloatArray
from minorloop_head.procedures.pictures import (
    CRACK,
    InspectedPicture,
    PictureFinding,
    crack_in,
    hole_in,
)
from minorloop_head.procedures.steps import CLAIMED, REFUSED
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.findings import UNDECIDED, Finding, finding_of, kind_of, outlined
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_finding
from minorloop_head.ultrasound.pits import HOLE, PitDepth
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole
from minorloop_head.vision.frame_checks import BLURRED, CLEAR, GOOD, VEILED, clarity

_NOT_SCANNED = "not scanned"
"""Verdict of the echoes of a finding that was not scanned."""
_UNCLEAR = {BLURRED: "blurred, if the wall is not smooth,", VEILED: "veiled"}
"""Words for the verdict of a picture: a blurred wall and a wall without texture look the same."""
AROUND = "view"
"""First word of the names of views that look round; the others visit a candidate."""
AGAIN = " again"
"""End of the name of a second visit, under another angle, after the name of the first."""


@dataclass(frozen=True, kw_only=True)
class Unconfirmed:
    """A candidate that was not seen again, or not visited."""

    kind: str
    """``hole or pit``, or ``crack``."""
    phi: float
    z: float
    """Place on the wall, in radians and metres."""
    evidence: float
    """The largest of its views, as of a `Hole`; NaN for a crack."""
    seen_in: tuple[str, ...]
    """Names of the views that show it there."""
    why: str
    """Result of its visit, or the reason why it was not visited."""


def unconfirmed(shown: Hole | TracedCrack, seen_in: tuple[str, ...], why: str) -> Unconfirmed:
    """Return a candidate of some views as not confirmed, with the reason."""
    if isinstance(shown, Hole):
        kind, place, evidence = UNDECIDED, shown.place, shown.evidence
    else:
        kind, place, evidence = CRACK, shown.middle, math.nan
    phi, z = place.tolist()
    return Unconfirmed(kind=kind, phi=phi, z=z, evidence=evidence, seen_in=seen_in, why=why)


@dataclass(frozen=True, eq=False, kw_only=True)
class InspectedView:
    """One acquisition of an inspection."""

    picture: InspectedPicture
    """The picture with its defects: all candidates if it looks round, else the visited one."""
    image: Image
    """Shape (height, width). Under all lights."""
    angles: tuple[float, float]
    """Pan and tilt of the line of sight, in radians."""
    joints: tuple[float, float]
    """Pan and tilt that the joints read there, in radians, as a file of poses has them."""
    place: tuple[float, float]
    """Advance in metres and roll in radians of the catheter."""
    seen: tuple[Hole | TracedCrack, ...] = ()
    """Candidates in the picture, from which an interrupted inspection continues."""
    finding: Finding | None = None
    """The candidate that was visited, if it was seen again."""
    evidence: float = math.nan
    """Evidence of the finding, as of a `Hole`; NaN for a crack."""
    course: FloatArray | None = None
    """Shape (N, 2). Phi and z along the rim of a hole, or along a crack."""
    unconfirmed: Unconfirmed | None = None
    """The candidate that was visited, if it was not seen again."""
    steps: tuple[LogEntry, ...] = ()
    """Steps of the visit except the search; the verdict of the finding names failed steps."""
    probed: PitDepth | CrackDepth | None = None
    """Depth of the finding by its echoes; None before it is scanned, and without a probe."""

    @property
    def failed(self) -> str:
        """The word failed and the names of the failed steps; empty if no step failed.

        A step whose outcome is the verdict of the echoes is left out. So are the touch of a
        through-hole, where the tool meets no wall, and the centring of a place beyond the cone.
        """
        said = None if self.probed is None else self.probed.verdict
        bad = [each for each in self.steps if not each.succeeded and each.outcome != said]
        counts = [name for name in CLAIMED if said != HOLE or name != "touch"]
        names = [each.what for each in bad if each.what in counts and not _beyond_cone(each)]
        return f"failed: {', '.join(names)}" if names else ""

    @property
    def looks_round(self) -> bool:
        """Whether it looks round, instead of visiting a candidate."""
        return self.picture.name.partition(" ")[0] == AROUND


def _beyond_cone(step: LogEntry) -> bool:
    return step.what == "centre" and step.outcome.startswith(REFUSED)


def first_visit(name: str) -> str:
    """Return the name of the first visit of a candidate, by the name of either of its visits."""
    return name.removesuffix(AGAIN)


def lens_words(views: Sequence[InspectedView]) -> str:
    """Return a sentence if most pictures along the pipe are blurred or veiled; empty otherwise."""
    around = [view for view in views if view.looks_round and view.picture.verdict == GOOD]
    verdicts = [clarity(view.image) for view in around]
    bad = [verdict for verdict in verdicts if verdict != CLEAR]
    if 2 * len(bad) <= len(verdicts):
        return ""
    what = " or ".join(sorted({_UNCLEAR[verdict] for verdict in bad})).rstrip(",")
    return (
        f"pictures are {what}: {len(bad)} of {len(verdicts)}; small defects may be missed; clean "
        "the lens, or check its focus"
    )


def view_with(
    view: InspectedView, shown: Sequence[Hole | TracedCrack], camera: CalibratedCamera
) -> InspectedView:
    """Return a view that shows holes and cracks, as seen by the camera at its place."""
    found = tuple(_in_picture(each, camera, view.angles) for each in shown)
    return replace(view, seen=tuple(shown), picture=replace(view.picture, findings=found))


def with_finding(view: InspectedView, radius: float) -> InspectedView:
    """Return the view of a visit with the one defect that it shows as its finding."""
    (shown,) = view.seen
    probed = view.probed
    if isinstance(shown, Hole):
        phi, z = shown.place.tolist()
        found = outlined(phi, z, shown.diameter, _NOT_SCANNED, radius=radius)
        if isinstance(probed, PitDepth):
            measured = math.isfinite(probed.diameter_sd)
            kind = kind_of(probed.verdict)
            found = (
                finding_of(probed, radius=radius)
                if measured
                else replace(found, kind=kind, verdict=probed.verdict)
            )
        course, evidence = shown.rim, shown.evidence
    else:
        depth = probed if isinstance(probed, CrackDepth) else CrackDepth(_NOT_SCANNED)
        found = crack_finding(shown.places, shown.width, depth, radius, width_sd=shown.width_sd)
        course, evidence = shown.places, math.nan
    if view.failed:
        found = replace(found, verdict=f"{found.verdict}, but {view.failed}")
    return replace(view, finding=found, evidence=evidence, course=course)


def _in_picture(
    shown: Hole | TracedCrack, camera: CalibratedCamera, angles: tuple[float, float]
) -> PictureFinding:
    if isinstance(shown, Hole):
        return hole_in(shown, camera, angles)
    return crack_in(shown, camera, angles)
