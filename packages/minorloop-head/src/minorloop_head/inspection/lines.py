"""Lines of the journal of an inspection or a sweep, as schemas with bounds, and rows of findings.

A line is made from a result (``ViewLine.values``), and restores it (``ViewLine.restored``). Limits
that depend on the head, as the size of the pipe and the swept part, are checked in `_defect` and
`check_burst`. Names of rows contain their units: ``phi [deg]``, ``z [mm]``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import PurePath
from typing import Annotated, Any, TypeAlias

import numpy as np
from msgspec import Meta, Struct, field

from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import wrapped
from minorloop_head.inspection.journal import (
    BeginLine,
    EndLine,
    Impossible,
    Line,
    ResumeLine,
    Seconds,
    converted,
)
from minorloop_head.procedures.calibration import THICKNESS_SD, HeadCalibration
from minorloop_head.procedures.inspected_view import (
    InspectedView,
    Unconfirmed,
    view_with,
    with_finding,
)
from minorloop_head.procedures.pictures import InspectedPicture
from minorloop_head.procedures.probe_steps import grade_of
from minorloop_head.procedures.ring import Ring as RingSweep
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import WaterLine
from minorloop_head.reconstruction.findings import rounded
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.ultrasound.echoes import DEAD_TIME
from minorloop_head.ultrasound.echoes import Burst as MeanBurst
from minorloop_head.ultrasound.pits import MEASURED, PitDepth
from minorloop_head.ultrasound.wall_echoes import Profile, SweptBurst
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole

_TURN, FARTHEST, _ODDS = 2.0 * math.pi, 10.0, 1e3
"""Limits of angles in radians, of places along a pipe in metres, and of evidence."""
Roll = Annotated[float, Meta(ge=-2.0 * _TURN, le=2.0 * _TURN)]
Along = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
_HalfTurn = Annotated[float, Meta(ge=-180.0, le=180.0)]
_AlongMm = Annotated[float, Meta(ge=-1e3 * FARTHEST, le=1e3 * FARTHEST)]
_EXACT = 9
"""Digits of a pose, so that a resumed inspection has the same map as one without interruption."""
_FEWEST = 200
"""Samples after the dead time, as in `trace_fault`."""
_BESIDE = 20e-3
"""Largest distance in metres of a burst from the swept part, along the pipe."""
_ANGLES = ("pan", "tilt", "roll", "phi", "phi_sd")
_LENGTHS = (
    *("advance", "z", "z_sd", "width", "width_sd", "length", "length_sd"),
    *("depth", "depth_sd", "wall", "wall_sd"),
)
_SCALES = dict.fromkeys(_ANGLES, math.radians(1.0)) | dict.fromkeys(_LENGTHS, 1e-3)
_NAMES = {name: f"{name} [{'deg' if name in _ANGLES else 'mm'}]" for name in _SCALES}


def _in_units(digits: int, **values: float) -> dict[str, Any]:
    """Return angles in degrees and lengths in millimetres by their names; None if not finite."""
    scaled = {
        name: math.degrees(value) if name in _ANGLES else 1e3 * value
        for name, value in values.items()
    }
    return {name: rounded(x, digits) for name, x in scaled.items()}


class Row(Struct, kw_only=True, rename=_NAMES):
    """Values in degrees and millimetres."""

    def si(self) -> dict[str, Any]:
        """Return the numbers in radians and metres, and the other values."""
        values = {name: getattr(self, name) for name in self.__struct_fields__}
        return {n: _SCALES[n] * each if n in _SCALES else each for n, each in values.items()}


class _SightRow(Row):
    """Pan and tilt of the line of sight."""

    pan: _HalfTurn
    tilt: _HalfTurn


class PoseRow(_SightRow):
    """Angles of the joints, and place of the catheter."""

    advance: _AlongMm
    roll: Annotated[float, Meta(ge=-720.0, le=720.0)]

    @classmethod
    def of(
        cls, angles: tuple[float, float], place: tuple[float, float], digits: int = _EXACT
    ) -> PoseRow:
        """Return the row of pan and tilt in radians, and advance and roll in metres and radians."""
        (pan, tilt), (advance, roll) = angles, place
        return cls(**_in_units(digits, pan=pan, tilt=tilt, advance=advance, roll=roll))


class StepRow(Struct):
    """A step of a visit."""

    step: str
    outcome: str
    succeeded: bool

    @classmethod
    def of(cls, steps: Sequence[LogEntry]) -> list[StepRow]:
        """Return entries of a log without their times."""
        return [cls(each.what, each.outcome, each.succeeded) for each in steps]


def _entries(steps: Sequence[StepRow], t: float) -> tuple[LogEntry, ...]:
    return tuple(LogEntry(t, each.step, each.outcome, each.succeeded) for each in steps)


class LostRow(Row):
    """A candidate that was not confirmed."""

    kind: str
    phi: Annotated[float, Meta(ge=-360.0, le=360.0)]
    z: _AlongMm
    evidence: Annotated[float, Meta(ge=-_ODDS, le=_ODDS)] | None
    seen_in: list[str] = field(name="seen in")
    why: str

    @classmethod
    def of(cls, lost: Unconfirmed) -> LostRow:
        """Return the row of an unconfirmed candidate, in degrees and millimetres."""
        evidence = None if math.isnan(lost.evidence) else round(lost.evidence, 1)
        where = _in_units(4, phi=float(wrapped(lost.phi)), z=lost.z)
        seen_in = list(lost.seen_in)
        return cls(**asdict(lost) | where | {"evidence": evidence, "seen_in": seen_in})

    def lost(self) -> Unconfirmed:
        """Return the unconfirmed candidate, in radians and metres."""
        evidence = math.nan if self.evidence is None else self.evidence
        seen_in = tuple(self.seen_in)
        return Unconfirmed(**self.si() | {"evidence": evidence, "seen_in": seen_in})


def _finding_row(view: InspectedView) -> dict[str, Any]:
    """Return the finding of a view in degrees and millimetres, None where unknown."""
    assert view.finding is not None
    values = asdict(view.finding)
    known = _in_units(4, **{name: values[name] for name in values if name in _SCALES})
    return {
        **{_NAMES.get(name, name): known.get(name, value) for name, value in values.items()},
        "evidence": None if math.isnan(view.evidence) else round(view.evidence, 1),
        "picture": f"{view.picture.name}.png",
        "course": None if view.course is None else view.course.round(6),
    }


def visit_row(
    view: InspectedView, thickness: float, least_wall: float | None = None
) -> dict[str, Any]:
    """Return the finding of a view with its grade, its steps, and the results of its visit.

    A result None means not tried. Without an echo of the wall a place does not count as scanned,
    and its reach is unknown.

    ``thickness``: of the wall, in metres: ``wall`` is the remaining part. ``least_wall``: least
    accepted remaining wall, in mm, compared with the lower end of its 90 % band. It is unknown
    for a depth that is not measured, such as that of an uneven floor.
    """
    assert view.finding is not None
    left = thickness - view.finding.depth
    left_sd = math.hypot(view.finding.depth_sd, THICKNESS_SD * thickness)
    if view.finding.kind == "hole":
        left, left_sd = 0.0, math.nan
    surely = left if math.isnan(left_sd) else left - PER_DEVIATION * left_sd
    measured = view.probed is not None and view.probed.verdict == MEASURED and not view.failed
    sure = view.finding.kind == "hole" or measured
    known = least_wall is not None and sure
    last = {each.what: each.succeeded for each in view.steps}
    if last.get("modality") is False:
        last["scan"] = False
    return {
        **_finding_row(view),
        "grade": grade_of(view.probed, view.evidence),
        **{_NAMES[name]: value for name, value in _in_units(4, wall=left, wall_sd=left_sd).items()},
        "accepted": bool(1e3 * surely >= (least_wall or 0.0)) if known else None,
        "found": True,
        "centred": last.get("centre"),
        "reached": last.get("reach", last.get("scan") or None),
        "touched": last.get("touch"),
        "scanned": last.get("scan"),
        "steps": StepRow.of(view.steps),
    }


class _BurstRow(Struct):
    """The mean of a burst; its numbers are exact, and NaN means unknown."""

    angles: tuple[float, float]
    shots: tuple[int, int]
    """Number of shots in the mean, and of fired shots."""
    noise: float
    verdict: str
    interval: float
    trace: bytes
    """Trace of 64-bit floats, as base64."""


def _burst_values(burst: MeanBurst) -> dict[str, Any]:
    """Return the values of the row of a burst."""
    return {
        "angles": burst.angles,
        "shots": (burst.used, burst.fired),
        "noise": burst.noise,
        "verdict": burst.verdict,
        "interval": burst.sample_interval,
        "trace": np.asarray(burst.trace, dtype="<f8").tobytes(),
    }


_BURST = {
    "angles": ((-math.pi, math.pi), (-math.pi, math.pi)),
    "shots": ((0, 1000), (1, 1000)),
    "noise": ((0.0, 1.0),),
    "interval": ((1e-9, 50e-9),),
}


def burst_of(row: _BurstRow | BurstLine) -> MeanBurst:
    """Return the burst of a row or a line.

    Raises an `Impossible` if no shots can give it. A burst with a verdict may have no trace and
    unknown numbers.
    """
    trace = np.frombuffer(row.trace, "<f8").astype(np.float64)
    if not row.verdict:
        check(row, _BURST)
        least = int(DEAD_TIME / row.interval) + _FEWEST
        if trace.size < least:
            raise Impossible("samples of the trace", trace.size, f"at least {least}")
        check({"trace": trace}, {"trace": ((-1.0 - 1e-9, 1.0 + 1e-9),)})
    if row.shots[0] > row.shots[1]:
        raise Impossible("shots", row.shots, "no more used than fired")
    return MeanBurst(trace, row.interval, np.array(row.angles), *row.shots, row.noise, row.verdict)


def check(
    row: Any, limits: Mapping[str, Sequence[tuple[float, float]]], *, unknown: bool = False
) -> None:
    """Refuse numbers of a row beyond their limits.

    Raises an `Impossible`.

    ``limits``: by names; one pair, or one for each column of an array. ``unknown``: whether numbers
    may be NaN.
    """
    values = row if isinstance(row, dict) else {name: getattr(row, name, None) for name in limits}
    for name, pairs in limits.items():
        if values[name] is not None:
            low, high = np.transpose(pairs)
            each = np.asarray(values[name], dtype=np.float64).reshape(-1, len(pairs))
            off = ~((low <= each) & (each <= high) | (unknown & np.isnan(each))).all(axis=1)
            if off.any():
                allowed = " and ".join(f"{a:.4g} to {b:.4g}" for a, b in pairs)
                raise Impossible(name, np.squeeze(each[off][0]).tolist(), allowed)


class StepLine(Line):
    """A step of the log."""

    step: str
    outcome: str
    succeeded: bool


class ViewLine(Line):
    """A view of an inspection; it replaces an older view of the same picture."""

    picture: Annotated[str, Meta(pattern=r"^[^/\\]+\.png$")]
    """Its file in the folder ``pictures``."""
    taken: Seconds
    verdict: str
    pose: PoseRow
    sight: _SightRow
    seen: list[dict[str, Any]]
    """Holes and cracks in the picture, in radians and metres."""
    finding: dict[str, Any] | None
    """Row as of `_finding_row`."""
    unconfirmed: LostRow | None
    steps: list[StepRow] = field(default_factory=list)
    probed: dict[str, Any] | None = None
    """Depth of the finding by its echoes, in radians and metres."""
    shown: list[dict[str, Any]] = field(default_factory=list)
    """Findings in the picture, for readers."""

    @classmethod
    def values(cls, view: InspectedView) -> dict[str, Any]:
        """Return the values of the line of a view."""
        return {
            "picture": f"{view.picture.name}.png",
            "taken": view.picture.t,
            "verdict": view.picture.verdict,
            "pose": PoseRow.of(view.joints, view.place),
            "sight": _SightRow(**_in_units(_EXACT, pan=view.angles[0], tilt=view.angles[1])),
            "shown": view.picture.rows(),
            "seen": view.seen,
            "finding": None if view.finding is None else _finding_row(view),
            "unconfirmed": None if view.unconfirmed is None else LostRow.of(view.unconfirmed),
            "steps": StepRow.of(view.steps),
            "probed": view.probed,
        }

    def restored(self, image: Any, calibration: HeadCalibration) -> InspectedView:
        """Return the view, given its picture.

        Raises an `Impossible` if its defects are outside of the pipe of the head.
        """
        pose, sight = self.pose.si(), self.sight.si()
        place, name = (pose["advance"], pose["roll"]), PurePath(self.picture).stem
        found = InspectedView(
            picture=InspectedPicture(name=name, t=self.taken, verdict=self.verdict),
            image=image,
            angles=(sight["pan"], sight["tilt"]),
            joints=(pose["pan"], pose["tilt"]),
            place=place,
            unconfirmed=None if self.unconfirmed is None else self.unconfirmed.lost(),
            steps=_entries(self.steps, self.taken),
            probed=None if self.probed is None else _defect(self.probed, calibration),
        )
        shown = [_defect(each, calibration) for each in self.seen]
        found = view_with(found, shown, calibration.camera_at(place))
        return found if self.finding is None else with_finding(found, calibration.radius)


class ScanLine(Line):
    """A scan of the probe so far, with the bursts that no earlier line has."""

    name: str
    reference: tuple[Along, Roll]
    point: Annotated[int, Meta(ge=0, le=1000)]
    onward: Annotated[int, Meta(ge=-1, le=1)]
    done: bool
    steps: list[StepRow]
    bursts: list[_BurstRow]

    @classmethod
    def values(cls, name: str, scanned: ScannedRaster, known: int) -> dict[str, Any]:
        """Return the values of the line of a scan, of whose bursts some are known."""
        return {
            "name": name,
            "reference": scanned.reference,
            "point": scanned.point,
            "onward": scanned.onward,
            "done": scanned.done,
            "steps": StepRow.of(scanned.steps),
            "bursts": [_BurstRow(**_burst_values(burst)) for burst in scanned.bursts[known:]],
        }

    def restored(self, before: ScannedRaster | None) -> ScannedRaster:
        """Return the scan, given that of its lines before."""
        bursts = tuple(burst_of(row) for row in self.bursts)
        return ScannedRaster(
            reference=np.array(self.reference),
            bursts=bursts if before is None else (*before.bursts, *bursts),
            point=self.point,
            onward=self.onward,
            done=self.done,
            steps=_entries(self.steps, self.t),
        )


class RingLine(Line):
    """The sweep round the pipe."""

    profile: Profile
    water: WaterLine

    def restored(self) -> RingSweep:
        """Return the sweep."""
        spot = (-2.0 * _TURN, 2.0 * _TURN), (-FARTHEST, FARTHEST)
        check(self.profile, {"spots": spot})
        if self.water.seen:
            check(self.water, {"height": ((-1.0, 1.0),), "sd": ((0.0, 1.0),)})
        return RingSweep(self.profile, self.water)


class BurstLine(Line):
    """A burst of a sweep: its time, the place of the catheter, its spot, and a `_BurstRow`."""

    fired: Seconds
    place: tuple[Along, Roll]
    spot: tuple[float, float, float]
    angles: tuple[float, float]
    shots: tuple[int, int]
    noise: float
    verdict: str
    interval: float
    trace: bytes

    @classmethod
    def values(cls, swept: SweptBurst) -> dict[str, Any]:
        """Return the values of the line of a burst."""
        own = {"fired": swept.t, "place": swept.place, "spot": swept.spot}
        return {**own, **_burst_values(swept.burst)}

    def restored(self) -> SweptBurst:
        """Return the burst."""
        return SweptBurst(self.fired, np.array(self.place), np.array(self.spot), burst_of(self))


InspectionLine: TypeAlias = (
    BeginLine | ResumeLine | StepLine | ViewLine | ScanLine | RingLine | EndLine
)
SweepLine: TypeAlias = BeginLine | ResumeLine | BurstLine | EndLine


def _defect(values: dict[str, Any], calibration: HeadCalibration) -> Any:
    """Return a hole, a crack, or the depth of one by echoes.

    Raises an `Impossible` if it is beyond the pipe of a head or its wall.
    """
    known = {name: value for name, value in values.items() if value is not None}
    kind: type[Any] = PitDepth if "phi" in known else CrackDepth
    if "evidence" in known or "rim" in known or "places" in known:
        kind = Hole if "rim" in known else TracedCrack
    found = converted(known, kind)
    place = (-_TURN, _TURN), (-FARTHEST, FARTHEST)
    limits = {
        place: ("place", "rim", "places"),
        place[:1]: ("phi",),
        place[1:]: ("z",),
        ((0.0, 2.0 * calibration.radius),): ("diameter", "widths", "least_width"),
        ((0.0, calibration.thickness),): ("depth", "least_depth"),
        ((0.0, FARTHEST),): ("length", "depth_sd", "place_sd", "diameter_sd"),
        ((-_ODDS, _ODDS),): ("contrast",),
        ((-_ODDS, math.inf),): ("evidence",),
    }
    named = {name: pairs for pairs, names in limits.items() for name in names}
    check(found, named, unknown=kind in (PitDepth, CrackDepth))
    return found


def check_burst(line: BurstLine, along: Sequence[float]) -> None:
    """Refuse a burst far from the swept part; with a verdict, its spot may be anywhere.

    ``along``: ends of the swept part, in metres. Raises an `Impossible`.
    """
    z = along[0] - _BESIDE, along[1] + _BESIDE
    if not line.verdict:
        limits = {
            "place": (z, (-2.0 * _TURN, 2.0 * _TURN)),
            "spot": ((-_TURN, _TURN), z, (1e-3, 1.0)),
        }
        check(line, limits)


def check_new(traces: dict[Any, str], key: tuple[Any, bytes], where: str) -> None:
    """Refuse a burst with the trace of an earlier line: two bursts never have the same noise.

    Raises an `Impossible`.

    ``traces``: line of each earlier key, to which this one is added. ``key``: identity of the burst
    and its trace; a burst without a trace may repeat.
    """
    if key[1] and key in traces:
        raise Impossible("trace", "a trace again", f"another one than in {traces[key]}")
    traces[key] = where
