"""Inspection of third-party pictures: holes, pits and cracks, picture by picture.

Each picture is searched alone, under whatever light it was taken, so there are more false findings
than in an acquisition under switched lights: one in twenty pictures of a dirty pipe.
The LEDs are at the lens, so that the far end of the pipe is dark wherever it is in the picture:
its place tells which part can be searched, and whether the pose is plausible.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.geometry import Pinhole, meet_wall, wall_point
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.trace import traces_of
from minorloop_head.reconstruction.findings import UNDECIDED
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.cracks import TracedCrack, plate_cracks
from minorloop_head.vision.defects import SINGLE, Hole, find_holes
from minorloop_head.vision.frame_checks import GOOD, WRONG_SIZE, check_frame
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.reflectance_map import LEAST_SEEN, LitFrame

LEAST_GREY = 8.0
"""Least grey level of wall that counts as searched. Of 57 simulated holes that a bright picture
shows, 54 are found if the picture is dimmed until the wall around them has this level, with noise
of one grey level; 35 at level 6, 12 at 4."""
_CELLS = (24, 32)
"""Rows and columns of the cells of a picture."""
_FEWEST = 32
"""Least pixels along a side of a picture of a plate."""
_FLOOR, _LEAST_LIGHT = 2.0, 1e-2
"""Grey level and irradiance that are added before the logarithm, so that noise in the dark and the
shape of the dark far end have little weight."""
_STEP, _STEEPEST = 5, 50
"""Degrees between compared directions, and the largest; the far end leaves the picture there."""
_LEAST_LIKE, _LEAST_GAIN, _LEAST_TURN = 0.7, 0.1, 15.0
"""Thresholds for another direction to contradict the stated one: least correlation, least lead, and
least distance in degrees. In simulated dirty pipes (30 scenes from 1000) the lead is at most 0.01
and the distance at most 10 where the stated direction is right."""
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
PLATE_COLUMNS = tuple({"phi [deg]": "x [mm]", "z [mm]": "y [mm]"}.get(n, n) for n in COLUMNS)
"""Those of cracks in a plate: from the left and from the top of the picture."""
_COLOURS = {UNDECIDED: (0, 160, 255), CRACK: (255, 200, 0)}
"""Blue, green and red of the marks."""


@dataclass(frozen=True, kw_only=True)
class PicturePose:
    """Pose of the camera of a picture."""

    pan: float = 0.0
    tilt: float = 0.0
    """Angles of the line of sight from the axis of the pipe, in radians."""
    advance: float = 0.0
    """Along the pipe, in metres."""
    roll: float = 0.0
    """Roll about the axis of the pipe, in radians."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PictureFinding:
    """A defect in a picture."""

    kind: str
    """``hole or pit``, or ``crack``."""
    phi: float
    z: float
    """Place on the wall, in radians and metres; on a plate across and down, both in metres."""
    width: float
    length: float
    """Diameter of a hole, twice; of a crack its median width and its length. In metres."""
    evidence: float
    """Logarithm of the odds that it is a hole, or a crack of a plate; NaN for a crack of a wall."""
    outline: FloatArray
    """Shape (N, 2). Pixels of its rim or its course."""

    @property
    def pixel(self) -> FloatArray:
        """(2,) middle of the outline."""
        return np.asarray(np.nanmean(self.outline, axis=0))


@dataclass(frozen=True, eq=False, kw_only=True)
class InspectedPicture:
    """A picture, and its findings."""

    name: str
    t: float
    """Time in its video, in seconds."""
    verdict: str
    """``good``, or why the picture cannot be used, as in `Findings`."""
    findings: tuple[PictureFinding, ...] = ()
    light: _PictureLight | None = None
    """The searched part, and whether the light contradicts the pose; None if the picture
    cannot be used."""
    plate: bool = False
    """Whether it shows a plate, and not the wall of a pipe."""

    def rows(self) -> list[dict[str, Any]]:
        """Return a row of the table for each finding, by the headers of its surface."""
        return [
            dict(
                zip(
                    PLATE_COLUMNS if self.plate else COLUMNS,
                    (
                        self.name,
                        round(self.t, 3),
                        found.kind,
                        round(1e3 * found.phi if self.plate else math.degrees(found.phi), 2),
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

    ``image`` (height, width): without pixels if the picture could not be read; ``view``: of the
    camera; ``pose``: where it was; ``t``: time in its video, in seconds.
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


def inspect_plate(image: Image, pixel: float, name: str = "", t: float = 0.0) -> InspectedPicture:
    """Find dark cracks in a picture of a flat rough surface, in light that is not known.

    Holes and pits are not searched: a single picture in unknown light does not tell them from
    stains. Raises a `ParameterError` if the size of a pixel is not positive.

    ``image`` (height, width): from straight above; ``pixel``: size of a pixel on the surface, in
    metres; ``t``: time in its video, in seconds.
    """
    if not as_finite("size of a pixel", pixel) > 0:
        raise ParameterError(f"the size of a pixel is {pixel} m; give a length > 0")
    if not image.size:
        return InspectedPicture(name=name, t=t, verdict=DAMAGED)
    height, width = image.shape
    verdict = check_frame(image, Pinhole(width, height, float(width)))
    if min(height, width) < _FEWEST:
        verdict = WRONG_SIZE
    if verdict != GOOD:
        return InspectedPicture(name=name, t=t, verdict=verdict)
    findings = []
    for crack in plate_cracks(image):
        x, y = pixel * crack.course[len(crack.course) // 2]
        findings.append(
            PictureFinding(
                kind=CRACK,
                phi=float(x),
                z=float(y),
                width=pixel * crack.width,
                length=pixel * float(np.hypot(*np.diff(crack.course, axis=0).T).sum()),
                evidence=crack.evidence,
                outline=crack.course,
            )
        )
    light = _PictureLight(float((_greys(image) >= LEAST_GREY).mean()), None)
    return InspectedPicture(
        name=name, t=t, verdict=GOOD, findings=tuple(findings), light=light, plate=True
    )


def unusable(pictures: Iterable[InspectedPicture]) -> dict[str, int]:
    """Return the number of pictures with each verdict except ``good``."""
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


@dataclass(frozen=True)
class _PictureLight:
    """Brightness of a picture, compared with its pose."""

    searched: float
    """Share of the picture that shows wall near and bright enough to be searched."""
    off: tuple[float, float] | None
    """Pan and tilt by the light, less the stated ones, in degrees, to about 5 degrees; None if they
    do not contradict."""


def light_in(image: Image, view: HeadCalibration, pan: float, tilt: float) -> _PictureLight:
    """Return the searched share of a picture, and whether its light contradicts a line of sight.

    ``image`` (height, width); ``pan`` and ``tilt``: of the line of sight, in radians.
    """
    grey = _greys(image)
    light, resolution = _expected(view, pan, tilt)
    near = resolution.reshape(_CELLS) >= LEAST_SEEN
    seen = float((near & (grey >= LEAST_GREY)).mean())
    level = _normal(np.log(grey.ravel() + _FLOOR))
    directions, patterns = _patterns(view)
    like = patterns @ level
    best = int(np.argmax(like))
    off = directions[best] - np.degrees([pan, tilt])
    if (
        like[best] < max(_LEAST_LIKE, float(_normal(light) @ level) + _LEAST_GAIN)
        or np.hypot(*off) < _LEAST_TURN
    ):
        return _PictureLight(seen, None)
    return _PictureLight(seen, (float(off[0]), float(off[1])))


def _greys(image: Image) -> FloatArray:
    """Return the mean grey level (rows, columns) of each cell of a picture."""
    at = [np.linspace(0, n, m + 1).astype(int) for n, m in zip(image.shape, _CELLS, strict=True)]
    total = np.add.reduceat(image.astype(np.float64), at[0][:-1], axis=0)
    cells = np.add.reduceat(total, at[1][:-1], axis=1)
    return np.asarray(cells / np.outer(np.diff(at[0]), np.diff(at[1])))


@lru_cache(maxsize=1)  # by identity: a run has one calibration
def _patterns(view: HeadCalibration) -> tuple[FloatArray, FloatArray]:
    """Return directions (N, 2) in degrees, and the light (N, cells) that each gives."""
    steps = range(-_STEEPEST, _STEEPEST + 1, _STEP)
    camera = view.camera_at((0.0, 0.0))
    pairs = [(a, b) for a in steps for b in steps if camera.inside(*np.radians([a, b]).tolist())]
    pairs = pairs or [(0, 0)]
    lights = [_normal(_expected(view, *np.radians(pair).tolist())[0]) for pair in pairs]
    return np.array(pairs, dtype=np.float64), np.array(lights)


def _expected(view: HeadCalibration, pan: float, tilt: float) -> tuple[FloatArray, FloatArray]:
    """Return the logarithm of the light on each cell, and its resolution in pixels per metre."""
    camera = view.camera_at((0.0, 0.0))  # the pipe looks alike from everywhere on its axis
    pose = camera.mount.pose(pan, tilt)
    v, u = ((np.arange(m) + 0.5) * n / m - 0.5 for n, m in zip(_size(view), _CELLS, strict=True))
    rays = camera.lens.rays(np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 3) @ pose.rotation.T
    phi, z, _ = np.moveaxis(meet_wall(pose.position, rays, camera.radius), -1, 0)
    phi, z = np.nan_to_num(phi), np.nan_to_num(z, nan=1.0, posinf=1.0, neginf=-1.0)
    points = wall_point(phi, z, camera.radius)
    inward = -np.stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)], axis=-1)
    light = np.zeros(phi.size)
    for led in pose.to_pipe(camera.leds):
        light += _facing(led - points, inward)
    light *= view.radius**2  # 1 at a right angle from the axis, in a pipe of any size
    way = pose.position - points
    far = np.maximum(np.linalg.norm(way, axis=-1), 1e-9)
    return np.log(light + _LEAST_LIGHT), camera.lens.focal * _cosine(way, inward) / far


def _size(view: HeadCalibration) -> tuple[int, int]:
    return view.lens.height, view.lens.width


def _cosine(way: FloatArray, inward: FloatArray) -> FloatArray:
    far = np.maximum(np.linalg.norm(way, axis=-1), 1e-9)
    return np.asarray(np.maximum((way * inward).sum(axis=-1) / far, 0.0))


def _facing(way: FloatArray, inward: FloatArray) -> FloatArray:
    """Return cos / r^2."""
    return np.asarray(_cosine(way, inward) / np.maximum((way**2).sum(axis=-1), 1e-18))


def _normal(values: npt.NDArray[np.float64]) -> FloatArray:
    """Return values less their mean, of norm 1."""
    off = values - values.mean()
    return np.asarray(off / max(float(np.linalg.norm(off)), 1e-9))
