"""Inspection of pictures that somebody else took: holes, pits and cracks, picture by picture.

Each picture is searched alone, under whatever light it was taken, so there are more false findings
than in an acquisition under switched lights: one in twenty pictures of a dirty pipe.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.picture_light import PictureLight, light_in
from minorloop_head.procedures.trace import traces_of
from minorloop_head.reconstruction.findings import UNDECIDED
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import SINGLE, Hole, find_holes
from minorloop_head.vision.frame_checks import GOOD
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.reflectance_map import LitFrame

CRACK = "crack"
DAMAGED = "not readable"
"""Verdict of a file that is no image, or only a part of one."""
TIME = "time [s]"
COLUMNS = (
    "picture",
    TIME,
    "kind",
    "phi [deg]",
    "z [mm]",
    "width [mm]",
    "length [mm]",
    "evidence",
    "u [px]",
    "v [px]",
)
"""Headers of the table of findings; still pictures have no time."""
_COLOURS = {UNDECIDED: (0, 160, 255), CRACK: (255, 200, 0)}
"""Blue, green and red of the marks."""


@dataclass(frozen=True, kw_only=True)
class PicturePose:
    """Where the camera was when a picture was taken.

    Parameters
    ----------
    pan, tilt : float
        Of the line of sight from the axis of the pipe, in radians.
    advance : float
        Along the pipe, in metres.
    roll : float
        About the pipe, in radians.
    """

    pan: float = 0.0
    tilt: float = 0.0
    advance: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureFinding:
    """A defect in a picture.

    Parameters
    ----------
    kind : str
        ``hole or pit``, or ``crack``.
    phi, z : float
        Place on the wall, in radians and metres.
    width, length : float
        Diameter of a hole, twice; of a crack its median width and its length. In metres.
    evidence : float
        Logarithm of the odds that it is a hole; NaN for a crack.
    outline : (N, 2) array
        Pixels of its rim or its course.
    """

    kind: str
    phi: float
    z: float
    width: float
    length: float
    evidence: float
    outline: FloatArray

    @property
    def pixel(self) -> FloatArray:
        """(2,) middle of the outline."""
        return np.asarray(np.nanmean(self.outline, axis=0))


@dataclass(frozen=True, eq=False, kw_only=True)
class InspectedPicture:
    """A picture, and what was found in it.

    Parameters
    ----------
    name : str
    t : float
        Time in its video, in seconds.
    verdict : str
        ``good``, or why the picture cannot be used, as in `Findings`.
    findings : tuple of PictureFinding
    light : PictureLight, optional
        Which part was searched, and whether the light contradicts the pose; None if the picture
        cannot be used.
    """

    name: str
    t: float
    verdict: str
    findings: tuple[PictureFinding, ...] = ()
    light: PictureLight | None = None

    def rows(self) -> list[dict[str, Any]]:
        """Return a row of the table for each finding, by the headers of `COLUMNS`."""
        return [
            dict(
                zip(
                    COLUMNS,
                    (
                        self.name,
                        round(self.t, 3),
                        found.kind,
                        round(math.degrees(found.phi), 2),
                        *(round(1e3 * x, 3) for x in (found.z, found.width, found.length)),
                        None if math.isnan(found.evidence) else round(found.evidence, 1),
                        *(round(float(x), 1) for x in found.pixel),
                    ),
                    strict=True,
                )
            )
            for found in self.findings
        ]


def inspect_picture(
    image: Image, view: HeadCalibration, pose: PicturePose, name: str = "", t: float = 0.0
) -> InspectedPicture:
    """Find holes, pits and cracks in a picture; a bad picture gives a verdict, not an error.

    Parameters
    ----------
    image : (height, width) array of uint8
        Without pixels if the picture could not be read.
    view : HeadCalibration
        Of the camera.
    pose : PicturePose
        Where it was.
    name : str
    t : float
        Time in its video, in seconds.
    """
    if not image.size:
        return InspectedPicture(name=name, t=t, verdict=DAMAGED)
    camera = view.camera_at((pose.advance, pose.roll))
    lit = (True,) * len(view.leds)
    found = find_holes([LitFrame(image, pose.pan, pose.tilt, lit)], camera, mode=SINGLE)
    if found.verdict != GOOD:
        return InspectedPicture(name=name, t=t, verdict=found.verdict)
    angles = pose.pan, pose.tilt
    holes = [hole_in(hole, camera, angles) for hole in found.holes]
    cracks = [crack_in(crack, camera, angles) for crack in traces_of(found, view.radius)]
    light = light_in(image, view, *angles)
    return InspectedPicture(name=name, t=t, verdict=GOOD, findings=(*holes, *cracks), light=light)


def unusable(pictures: Iterable[InspectedPicture]) -> dict[str, int]:
    """Return how many pictures have each verdict but ``good``."""
    return dict(Counter(each.verdict for each in pictures if each.verdict != GOOD))


def annotated(image: Image, findings: Sequence[PictureFinding], first: int = 1) -> Any:
    """Return a colour picture (height, width, 3) with the findings outlined and numbered."""
    cv2 = opencv()
    drawn = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for number, found in enumerate(findings, start=first):
        colour, closed = _COLOURS[found.kind], found.kind != CRACK
        seen = found.outline[np.isfinite(found.outline).all(axis=1)]
        points = np.round(seen).astype(np.int32)
        cv2.polylines(drawn, [points], closed, colour, 1, cv2.LINE_AA)
        right, top = int(points[:, 0].max()) + 4, int(points[:, 1].min()) - 4
        cv2.putText(
            drawn, str(number), (right, top), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA
        )
    return drawn


def hole_in(hole: Hole, camera: CalibratedCamera, angles: tuple[float, float]) -> PictureFinding:
    """Return a hole as a finding of a picture, which was taken at these angles."""
    return PictureFinding(
        kind=UNDECIDED,
        phi=float(hole.place[0]),
        z=float(hole.place[1]),
        width=hole.diameter,
        length=hole.diameter,
        evidence=hole.evidence,
        outline=camera.pixel(hole.rim, *angles),
    )


def crack_in(
    crack: TracedCrack, camera: CalibratedCamera, angles: tuple[float, float]
) -> PictureFinding:
    """Return a crack as a finding of a picture, which was taken at these angles."""
    phi, z = crack.middle
    return PictureFinding(
        kind=CRACK,
        phi=float(phi),
        z=float(z),
        width=crack.width,
        length=crack.length,
        evidence=math.nan,
        outline=camera.pixel(crack.places, *angles),
    )
