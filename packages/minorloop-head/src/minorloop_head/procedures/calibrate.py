"""Calibration of a head from folders of pictures of a flat target."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError, counted
from minorloop.files import PathLike
from minorloop.lab.columns import opened
from minorloop.lab.headers import split_header
from minorloop_head.geometry import AXES, Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import HeadFile
from minorloop_head.procedures.target_pictures import (
    NAMED,
    ExpectedTarget,
    TargetPictures,
    find_target,
    led_folders,
    look_through,
)
from minorloop_head.procedures.values import ALL_LIGHTS
from minorloop_head.vision.hand_eye import fit_hand_eye
from minorloop_head.vision.lens_calibration import (
    LensFit,
    TargetPose,
    fit_led,
    fit_lens,
    target_pose,
)
from minorloop_head.vision.measured import Measured
from minorloop_head.vision.mount_calibration import MountFit, fit_mount
from minorloop_head.vision.targets import Target

_CORNER_SD = 0.1
"""Standard deviation of a corner in pixels, for a lens that was calibrated before."""
_FEWEST = 6
"""Least number of corners away from a reflection that determines the pose of the target."""
_IN_NAME = re.compile(r"pan([+-]?\d+(?:\.\d+)?)_?tilt([+-]?\d+(?:\.\d+)?)")
_LED = "LED "
"""Prefix of the names of results for LEDs."""
_FAR, _CONTRADICTED = 4.0, 2.0
"""Residual above which a message names an angle, and rms above which angles contradict pictures, in
standard deviations. With Gaussian angles of six pictures, the fewest, each is rarer than 0.1 %."""
_ALIGNED, _ASIDE = 1.0, 0.3
"""Least deviations of the mount from the ideal one that are reported, in degrees and mm."""


@dataclass(frozen=True, eq=False)
class CalibratedHead:
    """A calibration with its evidence."""

    head: HeadFile
    """Head to be saved."""
    lens: LensFit | None
    mount: MountFit | None
    left_out: dict[str, str]
    """Pictures that were not used, and why."""
    used: dict[str, int]
    """Pictures that were used, for each purpose."""
    advice: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    """Why the mount cannot be trusted, see `mount_doubts`."""
    target: Target | None = None
    """The target in the pictures."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Parameters that the pictures hardly determine, and why the mount cannot be trusted."""
        return (*(self.lens.warnings if self.lens else ()), *self.doubts)


def calibrate_lens(pictures: TargetPictures) -> LensFit:
    """Fit the lens to the pictures of a folder.

    Raises a `RecordError` if they do not determine it.
    """
    try:
        return fit_lens(pictures.seen, pictures.size)
    except RecordError as error:
        raise RecordError(f"{pictures.folder}: {error}{pictures.explained()}") from None


def calibrate_mount(
    pictures: TargetPictures,
    lens: Pinhole,
    angles: PathLike | None,
    *,
    corner_sd: float = _CORNER_SD,
    angle_sd: float = 0.1,
    on_axis: bool = False,
    centre_sd: tuple[float, float] = (0.0, 0.0),
) -> MountFit:
    """Fit the mount of the camera to pictures of a target at several angles of the joints.

    Its standard deviations contain the share of the principal point of the lens.

    Raises a `RecordError` if angles are missing or in another unit, or the pictures do not
    determine the mount.

    ``angles``: table with columns ``picture``, ``pan [deg]`` and ``tilt [deg]``; without it, the
    names of the pictures have the angles. ``corner_sd``, ``angle_sd``: standard deviations of a
    corner in pixels and of an angle in degrees. ``on_axis``: whether the target is square to the
    pipe with its middle on the axis. ``centre_sd``: standard deviations of the principal point, in
    pixels.
    """
    known = _angles_of_names(pictures) if angles is None else _angles_of_table(angles)
    joints = _of_pictures(known, pictures, lens, angles)
    middle = pictures.target.size / 2 if on_axis else None

    def fitted(lens: Pinhole) -> MountFit:
        poses = [target_pose(lens, each, corner_sd) for each in pictures.seen]
        return fit_mount(poses, joints, sd=angle_sd, middle=middle)

    try:
        found = fitted(lens)
        moved = [fitted(each) for each in _shifted(lens, centre_sd)]
    except RecordError as error:
        raise RecordError(f"{pictures.folder}: {error}{pictures.explained()}") from None
    measured = [
        replace(each, sd=math.hypot(each.sd, *(other.value - each.value for other in others)))
        for each, *others in zip(found.measured, *(fit.measured for fit in moved), strict=True)
    ]
    return replace(found, measured=tuple(measured))


def calibrate_hand_eye(
    pictures: TargetPictures, lens: Pinhole, robot: PathLike, *, corner_sd: float = _CORNER_SD
) -> tuple[Measured, ...]:
    """Fit the pose of the camera on the flange of a robot to pictures of a target at rest.

    Raises a `RecordError` if the table or a row is missing, or the pictures do not determine the
    pose.

    ``robot``: table with columns ``picture``, ``x``, ``y`` and ``z`` in mm or m, and a rotation
    vector ``rx``, ``ry`` and ``rz`` in deg or rad, or a quaternion ``qw``, ``qx``, ``qy`` and
    ``qz``: poses of the flange in the base; ``corner_sd``: standard deviation of a corner, in
    pixels.
    """
    flange = _of_pictures(_flanges_of_table(robot), pictures, lens, robot)
    return fit_hand_eye([target_pose(lens, each, corner_sd) for each in pictures.seen], flange)


def _of_pictures(
    known: Mapping[str, FloatArray | tuple[float, float]],
    pictures: TargetPictures,
    lens: Pinhole,
    table: PathLike | None,
) -> FloatArray:
    """Return the angles (N, 2) or poses (N, 4, 4) of pictures, by their names in a table.

    Raises a `ParameterError` if the target does not show which way is up; a `RecordError` if a row
    is missing, or the pictures have another size than those of the lens.
    """
    _check_size(pictures, lens)
    if not pictures.target.oriented:
        raise ParameterError(
            f"{pictures.target} looks the same upside down; use a charuco target, or a chessboard "
            "with an odd and an even number of squares, for the mount"
        )
    missing = [each.name for each in pictures.seen if each.name not in known]
    if missing:
        raise RecordError(
            f"{table} has no row for {missing[0]}; name every picture of {pictures.folder} in "
            "its column 'picture'"
        )
    return np.array([known[each.name] for each in pictures.seen])


def mount_doubts(mount: MountFit, names: Sequence[str], angle_sd: float) -> tuple[str, ...]:
    """Return why the angles of the joints contradict the pictures of a mount; empty if they do not.

    ``names``: of its pictures; ``angle_sd``: standard deviation of an angle in the fit, in degrees.
    """
    largest = np.abs(mount.joints).max(axis=1)
    far = [k for k in np.argsort(-largest).tolist() if largest[k] > _FAR * angle_sd]
    if not far and mount.rms <= _CONTRADICTED * angle_sd:
        return ()
    shown = ", ".join(f"{names[k]} ({largest[k]:.2g} deg)" for k in far[:NAMED])
    more = f" and {len(far) - NAMED} more" if len(far) > NAMED else ""
    where = f", most in {shown}{more}" if far else ""
    return (
        f"the angles of the joints differ from the pictures by {mount.rms:.2g} deg rms{where}, and "
        f"--angle-sd is {angle_sd:g} deg: the mount is not to be trusted; check the scale of the "
        "angle sensors and these angles, take the pictures again, or give a larger --angle-sd",
    )


def _shifted(lens: Pinhole, sd: tuple[float, float]) -> list[Pinhole]:
    """Return lenses with the principal point shifted by one standard deviation, in u and in v."""
    (u, v), (du, dv) = lens.centre, sd
    shifts = [(u + du, v)] * (du > 0) + [(u, v + dv)] * (dv > 0)
    return [replace(lens, centre=centre) for centre in shifts]


def centre_sd_of(measured: Iterable[Measured]) -> tuple[float, float]:
    """Return the standard deviations of the principal point in pixels; 0 where it is not known."""
    sds = {each.name: each.sd for each in measured}
    return sds.get("principal point u", 0.0), sds.get("principal point v", 0.0)


def calibrate_leds(
    folders: Sequence[TargetPictures], lens: Pinhole, corner_sd: float = _CORNER_SD
) -> tuple[FloatArray, tuple[Measured, ...]]:
    """Fit the positions of LEDs to their reflections, one folder for each LED.

    Returns positions (N, 3) in the camera, in metres, and the results with standard deviations.

    Raises a `RecordError` if a folder has too few reflections, or of several LEDs.
    """
    positions, measured = [], []
    for number, pictures in enumerate(folders, 1):
        _check_size(pictures, lens)
        name = f"{_LED}{number}"
        poses: list[TargetPose] = []
        spots = []
        for each in pictures.seen:
            spot = pictures.reflections.get(each.name)
            kept = None if spot is None else each.away_from(spot)
            if kept is not None and len(kept.points) >= _FEWEST:
                poses.append(target_pose(lens, kept, corner_sd))
                spots.append(spot)
        try:
            position, sd = fit_led(lens, poses, np.array(spots).reshape(-1, 2), name)
        except RecordError as error:
            raise RecordError(f"{pictures.folder}: {error}") from None
        positions.append(position)
        measured += [
            Measured(f"{name} {axis}", 1e3 * float(value), 1e3 * float(spread), "mm")
            for axis, value, spread in zip("xyz", position, sd, strict=True)
        ]
    return np.array(positions), tuple(measured)


def _lens_of(head: HeadFile) -> Pinhole:
    """Return the lens of a head that was calibrated before.

    Raises a `ParameterError` if it was not.
    """
    if head.calibration is None:
        raise ParameterError("the lens is not calibrated; give its pictures with --pictures")
    return head.calibration.lens


def _check_size(pictures: TargetPictures, lens: Pinhole) -> None:
    """Refuse pictures of another size than those of the lens.

    Raises a `RecordError` if they have.
    """
    if pictures.size != (lens.width, lens.height):
        raise RecordError(
            f"the pictures of {pictures.folder} have {pictures.size[0]} by {pictures.size[1]} "
            f"pixels, and the lens was calibrated with {lens.width} by {lens.height}; give "
            "pictures of this camera at this size"
        )


def calibrate_head(
    before: HeadFile,
    *,
    target: ExpectedTarget,
    pictures: PathLike | None = None,
    mount: PathLike | None = None,
    angles: PathLike | None = None,
    angle_sd: float = 0.1,
    leds: FloatArray | PathLike | None = None,
    radius: float | None = None,
    thickness: float | None = None,
    told: Callable[[str], object] = lambda text: None,
) -> CalibratedHead:
    """Calibrate lens, mount and LEDs of a head from folders of pictures of a flat target.

    Raises a `ParameterError` if there is nothing to calibrate, or the lens is not known; a
    `RecordError` if pictures or tables do not determine the lens, the mount or an LED.

    ``before``: the head as known so far; parameters that are not measured keep their values.
    ``pictures``, ``mount``: folders of pictures everywhere in the image, for the lens, and of a
    target at rest at several angles of the joints.
    ``angles``: table of the angles of the joints, as of `calibrate_mount`, or of the poses of a
    flange, as of `calibrate_hand_eye`.
    ``angle_sd``: standard deviation of an angle of the joints, in degrees.
    ``leds`` (N, 3): positions of the LEDs in the camera, in metres; or a folder with a folder of
    pictures for each LED.
    ``radius``, ``thickness``: of the pipe and its wall, in metres.
    ``told``: called with a text on the progress.
    """
    if not (pictures or mount or leds is not None):
        raise ParameterError("there is nothing to calibrate; give --pictures, --mount or --leds")
    if angles and not mount:
        raise ParameterError("--angles are those of the pictures of --mount; give it too")
    if not 1e-3 <= angle_sd <= 10.0:
        raise ParameterError(f"--angle-sd is {angle_sd}; give 0.001 to 10 degrees")
    used, left_out = dict[str, int](), dict[str, str]()
    shown: Target | None = None

    def looked(folder: PathLike, what: str) -> TargetPictures:
        nonlocal shown
        told(f"looking for the target in {folder}")
        shown = shown or find_target(folder, target)
        found = look_through(folder, shown)
        used[what] = len(found.seen)
        left_out.update({f"{Path(folder).name}/{n}": why for n, why in found.left_out.items()})
        return found

    lens, fit, sd = None, None, _CORNER_SD
    doubts: tuple[str, ...] = ()
    measured: tuple[Measured, ...] = ()
    if pictures:
        lens = calibrate_lens(looked(pictures, "the lens"))
        sd = lens.rms / math.sqrt(2)
        left_out.update({f"{Path(pictures).name}/{n}": why for n, why in lens.left_out.items()})
        used["the lens"] = len(lens.seen)
    known = lens.lens if lens else _lens_of(before)
    if mount and angles and _of_flange(angles):
        found = looked(mount, "the flange")
        measured = calibrate_hand_eye(found, known, angles, corner_sd=sd)
    elif mount:
        found = looked(mount, "the mount")
        fit = calibrate_mount(
            found, known, angles, corner_sd=sd, angle_sd=angle_sd, on_axis=target.on_axis,
            centre_sd=centre_sd_of(lens.measured if lens else before.measured),
        )  # fmt: skip
        doubts = mount_doubts(fit, [each.name for each in found.seen], angle_sd)
    places = leds if isinstance(leds, np.ndarray) else None
    if leds is not None and not isinstance(leds, np.ndarray):
        lit = [looked(each, f"LED {n}") for n, each in enumerate(led_folders(leds), 1)]
        places, found_leds = calibrate_leds(lit, known, sd)
        measured = (*measured, *found_leds)
    head, advice = _calibrated(before, lens, fit, places, measured, radius, thickness)
    return CalibratedHead(head, lens, fit, left_out, used, advice, doubts, shown)


def _calibrated(
    before: HeadFile,
    lens: LensFit | None,
    mount: MountFit | None,
    leds: FloatArray | None,
    measured: tuple[Measured, ...] = (),
    radius: float | None = None,
    thickness: float | None = None,
) -> tuple[HeadFile, tuple[str, ...]]:
    """Return the head with its new calibration, and advice; a None keeps the former value."""
    old = before.calibration
    seen_by = _lens_of(before) if lens is None else lens.lens
    base = replace(old or HeadCalibration(lens=seen_by, leds=np.zeros((1, 3))), lens=seen_by)
    if mount is not None:
        pan, tilt = mount.straight
        base = replace(
            base,
            lever=mount.lever,
            straight=(base.straight[0] if pan is None else pan, tilt),
            squint=mount.squint,
            camera_roll=mount.camera_roll,
        )
        if mount.roll is not None and mount.offset is not None:
            base = replace(base, roll=mount.roll, offset=mount.offset)
    base = replace(
        base,
        leds=base.leds if leds is None else leds,
        radius=base.radius if radius is None else radius,
        thickness=base.thickness if thickness is None else thickness,
    )
    fresh = [*(lens.measured if lens else ()), *(mount.measured if mount else ()), *measured]
    kept = [each for each in before.measured if leds is None or not each.name.startswith(_LED)]
    numbers = {each.name: each for each in (*kept, *fresh)}
    head = replace(
        before, calibration=base, calibrated=datetime.now(UTC), measured=tuple(numbers.values())
    )
    return head, tuple(_advice(head, old is None, lens, mount, leds))


def _advice(
    head: HeadFile,
    first: bool,
    lens: LensFit | None,
    mount: MountFit | None,
    leds: FloatArray | None,
) -> list[str]:
    said = []
    if head.identified is not None:
        said.append(
            "the wires were identified before this calibration; identify them again with "
            "minorloop head identify"
        )
    if first and leds is None:
        wanted = len(ALL_LIGHTS)
        said.append(
            f"one LED at the lens is assumed, which the console and head inspect refuse: they "
            f"switch {wanted}; give the places of all {wanted} with --leds"
        )
    if leds is not None and len(leds) != len(ALL_LIGHTS):
        said.append(
            f"the head has {counted(len(leds), 'LED')}, and the console and head inspect switch "
            f"{len(ALL_LIGHTS)}; give the places of all {len(ALL_LIGHTS)} with --leds"
        )
    if first and mount is None:
        said.append("the lever of the camera is not measured; give pictures with --mount")
    if lens is not None and mount is None and not first:
        said.append("the mount is still that of the lens before; take its pictures again")
    if mount is None:
        return said
    known = {each.name: each for each in mount.measured}
    limits = {"deg": _ALIGNED, "mm": _ASIDE}
    for name in ("lean of the base", "lens right of the axis", "lens below the axis",
                 "tilt axis before the pan axis"):  # fmt: skip
        each = known.get(name)
        if each is not None and abs(each.value) > limits[each.unit] + 2 * each.sd:
            said.append(
                f"the {name} is {each.value:.1f} {each.unit}, and 0 is assumed; align the camera "
                "better, or expect places on the wall to be off by as much"
            )
    return said


def _angles_of_names(pictures: TargetPictures) -> dict[str, tuple[float, float]]:
    found = {}
    for each in pictures.seen:
        match = _IN_NAME.search(each.name)
        if match is None:
            raise RecordError(
                f"the name of {each.name} has no angles; rename it, such as pan12.5_tilt-3.png, or "
                "give a table with --angles"
            )
        found[each.name] = (float(match[1]), float(match[2]))
    return found


def _angles_of_table(file: PathLike) -> dict[str, tuple[float, float]]:
    with opened(file) as table:
        for header in map(table.find, AXES):
            name, unit = split_header(header)
            if unit != "deg":
                raise RecordError(
                    f"column '{header}' of {file} is in {unit or 'no unit'}; give '{name} [deg]'"
                )
        columns = table.read(AXES, ["picture"])
    pictures = [str(name) for name in columns["picture"].tolist()]
    rows = zip(*(columns[axis].tolist() for axis in AXES), strict=True)
    found = dict(zip(pictures, ((pan, tilt) for pan, tilt in rows), strict=True))
    if len(found) < len(pictures):
        raise RecordError(f"{file} names a picture twice; give one row for each")
    return found


def _of_flange(file: PathLike) -> bool:
    """Return whether a table has poses of a flange instead of angles of joints."""
    with opened(file) as table:
        return "x" in [split_header(header)[0] for header in table.headers]


def _flanges_of_table(file: PathLike) -> dict[str, FloatArray]:
    """Return poses (4, 4) of the flange, in metres, by the names of pictures."""
    units = {"mm": 1e-3, "m": 1.0, "deg": math.radians(1.0), "rad": 1.0, "": 1.0}
    with opened(file) as table:
        names = [split_header(header)[0] for header in table.headers]
        turn = ["qx", "qy", "qz", "qw"] if "qw" in names else ["rx", "ry", "rz"]
        columns = ["x", "y", "z", *turn]
        given = [split_header(table.find(name))[1] for name in columns]
        allowed = [("mm", "m")] * 3 + [("",) if "qw" in turn else ("deg", "rad")] * len(turn)
        for name, unit, each in zip(columns, given, allowed, strict=True):
            if unit not in each:
                raise RecordError(
                    f"column {name!r} of {file} is in {unit or 'no unit'}; give it in "
                    f"{' or '.join(each) or 'no unit'}"
                )
        read = table.read(columns, ["picture"])
    values = np.stack([units[unit] * read[name] for name, unit in zip(columns, given, strict=True)])
    turns = values[3:].T
    turned = Rotation.from_quat(turns) if "qw" in turn else Rotation.from_rotvec(turns)
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turned.as_matrix(), values[:3].T
    return dict(zip(map(str, read["picture"].tolist()), poses, strict=True))
