"""Pictures of a flat target for the calibration of a head: take them, and find the target in them.

They are taken by hand, or at several angles of the joints.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import OutputError, ParameterError, RecordError, are
from minorloop.files import PathLike, new_folder
from minorloop.lab.actuator import Actuator
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.lens_calibration import find_reflection
from minorloop_head.vision.target_search import markers_in, search_target
from minorloop_head.vision.targets import KINDS, NONE, SeenTarget, Target
from minorloop_head.vision.video import LiveCamera, frames
from minorloop_head.vision.video import names as names_in

_PATIENCE = 3.0
"""Longest time in seconds for a picture."""
_LAST = 5
"""Readings at the end of a hold whose mean is the angle."""
AUTO = "auto"
"""Kind of a target that is detected from the pictures."""
_SAMPLE, _EXPLAINED = 16, 5
"""Most pictures that are searched to detect the target, and most whose lack of one is explained."""
NAMED = 5
"""Largest number of pictures that a message names."""


def photograph(
    camera: str,
    out: PathLike,
    names: Iterable[str],
    *,
    exposure: float | None = None,
    told: Callable[[str], None] = lambda _: None,
) -> int:
    """Save a picture for each name, such as of `by_hand` and `at_angles`; return their number.

    ``camera`` is an address, ``out`` a new or empty folder, ``exposure`` in seconds. Raises a
    `ParameterError` if the exposure of the camera cannot be set.
    """
    taken = 0
    with new_folder(out) as folder:
        live = LiveCamera(camera, patience=_PATIENCE)
        try:
            if exposure is not None:
                if not live.exposes:
                    raise ParameterError(
                        f"{camera} does not let its exposure be set from here; set it at the "
                        "camera, and give no exposure"
                    )
                live.expose(exposure)
            for name in names:
                path = folder / f"{name}.png"
                if not opencv().imwrite(str(path), live.frame().image):
                    raise OutputError(f"{path} cannot be written; check the disk")
                taken += 1
                told(f"{taken} pictures, the last {name}")
        finally:
            live.close()
    return taken


def by_hand(told: Callable[[str], None], count: int = 16, every: float = 4.0) -> Iterator[str]:
    """Yield the name of a picture every ``every`` seconds, between which the target is moved."""
    _check("count", count, 1, 1000)
    _check("every", every, 0, 3600)
    for number in range(count):
        told(f"picture {number + 1} of {count} in {every:g} s; hold the target")
        time.sleep(every)
        yield f"{number:02d}"


def at_angles(
    plant: Actuator, highest: float = 0.35, steps: int = 4, hold: float = 40.0
) -> Iterator[str]:
    """Hold both currents at all pairs of levels; yield a name with the angles in degrees.

    ``highest`` is the largest current in A, ``hold`` the time at each pair in seconds.
    """
    _check("steps", steps, 2, 20)
    _check("hold", hold, 1, 3600)
    levels = np.linspace(0.0, highest, steps)
    try:
        for number, currents in enumerate(itertools.product(levels, levels)):
            readings = np.asarray(plant.apply(np.array(currents), hold, hold / (2 * _LAST)).y)
            pan, tilt = readings[:, -_LAST:].mean(axis=1)
            yield f"{number:02d}_pan{pan:.2f}_tilt{tilt:.2f}"
    finally:
        plant.safe()


def _check(name: str, value: float, least: float, most: float) -> None:
    if not least <= as_finite(name, value) <= most:
        raise ParameterError(f"{name} is {value}; give {least:g} to {most:g}")


@dataclass(frozen=True)
class ExpectedTarget:
    """A target as described by the user, before it is searched in pictures."""

    side: float
    """Side of a square, or distance of circles, in metres. Pictures do not show it."""
    kind: str = AUTO
    """One of `minorloop_head.vision.targets.KINDS`, or `AUTO`."""
    squares: tuple[int, int] | None = None
    """Columns and rows."""
    on_axis: bool = False
    """Whether the target of the mount is square to the pipe with its middle on the axis."""

    def printed(self) -> Target:
        """Return the target to print: by default the first of `KINDS` with 9 by 7 squares."""
        return Target(
            KINDS[0] if self.kind == AUTO else self.kind, *(self.squares or (9, 7)), self.side
        )


@dataclass(frozen=True, eq=False)
class TargetPictures:
    """A target as found in the pictures of a folder."""

    folder: str
    target: Target
    size: tuple[int, int]
    """Width and height, in pixels."""
    seen: tuple[SeenTarget, ...]
    left_out: dict[str, str]
    """Names of the pictures that cannot be used, and why."""
    reflections: dict[str, FloatArray]
    """The one saturated spot of a picture, in pixels."""

    def explained(self) -> str:
        """Return the end of a message: which pictures are left out, and why."""
        if not self.left_out:
            return ""
        shown = [f"{name} ({why})" for name, why in list(self.left_out.items())[:NAMED]]
        more = len(self.left_out) - len(shown)
        rest = f" and {more} more" if more else ""
        count = len(self.left_out)
        return f"; {count} {are(count)} left out: {', '.join(shown)}{rest}"


def find_target(folder: PathLike, expected: ExpectedTarget) -> Target:
    """Return the target that the pictures of a folder show.

    Raises a `RecordError` if the pictures show no target, or another one than expected.
    """
    kind, squares, square = expected.kind, expected.squares, expected.side
    called = _pictures_in(folder)
    chosen = set(np.linspace(0, len(called) - 1, min(len(called), _SAMPLE)).astype(int).tolist())
    read = (frame.image for frame in frames(str(folder), damaged=True))
    images = [image for number, image in enumerate(read) if number in chosen and image.size]
    found = search_target(images, square)
    said = None
    if squares is not None and (kind != AUTO or found is not None):
        said = Target(found.kind if kind == AUTO and found else kind, *squares, square)
    if found is None:
        if said is not None:
            return said  # it may be found where its size is known
        raise RecordError(f"no picture of {folder} shows a target{_why_none(images)}")
    if kind not in (AUTO, found.kind):
        raise RecordError(f"{folder} shows {found}, and --target is {kind}; leave it out")
    if said is None or sorted(squares or ()) == sorted((found.columns, found.rows)):
        return found
    if found.kind == "charuco" and found.columns == said.columns and found.rows < said.rows:
        return replace(found, rows=said.rows)
    if found.kind == "charuco" or not any(
        isinstance(said.find(image, ""), SeenTarget) for image in images
    ):
        raise RecordError(
            f"{folder} shows {found}, and --target has squares={said.columns}x{said.rows}: it is "
            "another target, or cut in every picture"
        )
    return said


def look_through(folder: PathLike, target: Target) -> TargetPictures:
    """Find the target in each picture of a folder.

    Raises a `ParameterError` if there is no such folder; a `RecordError` if the pictures have
    different sizes, none can be read, or none shows the target.
    """
    size: tuple[int, int] | None = None
    seen: list[SeenTarget] = []
    left_out, reflections = {}, {}
    called = _pictures_in(folder)
    first = ""
    for name, frame in zip(called, frames(str(folder), damaged=True), strict=True):
        if not frame.image.size:
            left_out[name] = "it cannot be read as an image"
            continue
        first = first or name
        height, width = frame.image.shape
        size = size or (width, height)
        if size != (width, height):
            raise RecordError(
                f"{name} in {folder} has {width} by {height} pixels and {first} {size[0]} by "
                f"{size[1]}; give pictures of one camera at one size"
            )
        found = target.find(frame.image, name)
        if isinstance(found, str):
            explain = len(left_out) < _EXPLAINED
            left_out[name] = _why_not(frame.image, target) if explain else found
            continue
        seen.append(found)
        spot = find_reflection(frame.image)
        if spot is not None:
            reflections[name] = spot
    if size is None:
        raise RecordError(f"no picture of {folder} can be read as an image; take them again")
    pictures = TargetPictures(str(folder), target, size, tuple(seen), left_out, reflections)
    if not seen:
        raise RecordError(
            f"no picture of {folder} shows {target}{pictures.explained()}; check "
            "--target, and that the whole picture is sharp and not too dark"
        )
    return pictures


def _pictures_in(folder: PathLike) -> list[str]:
    if not Path(folder).is_dir():
        raise ParameterError(f"there is no folder {folder}; give one with pictures of the target")
    return names_in(str(folder))


def _why_none(images: Sequence[Image]) -> str:
    """Return the end of a message: why no target is found in pictures."""
    turned = search_target([np.ascontiguousarray(image[:, ::-1]) for image in images], 1e-3)
    if turned is not None and turned.kind == "charuco":
        return ": they are mirrored; take them again, and let the camera not mirror them"
    family = markers_in(images)
    if family:
        return f": there are markers of {family}, but not in the places of a charuco target"
    return (
        ": no markers, chessboard or grid of circles; give pictures of a whole, flat target, or "
        "name it and its squares with --target"
    )


def _why_not(image: Image, target: Target) -> str:
    """Return why a target is not found in a picture."""
    other = search_target([image], target.square)
    marked = target.kind == "charuco" and bool(markers_in([image]))
    if other is None or (marked and other.kind != "charuco"):
        return NONE  # the squares between the markers of a charuco target are a chessboard
    if other.kind != target.kind:
        return f"it shows {other}"
    return f"it shows only {other.columns} by {other.rows} of its squares"


def led_folders(folder: PathLike) -> list[Path]:
    """Return the folders of the LEDs in the order of their names.

    Raises a `ParameterError` if there are none.
    """
    found = sorted(each for each in Path(folder).glob("*") if each.is_dir())
    if not found:
        raise ParameterError(f"{folder} has no folders; give one in it for each LED")
    return found
