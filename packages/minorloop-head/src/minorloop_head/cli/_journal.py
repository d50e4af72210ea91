"""The journal of an inspection or a sweep, from which it goes on after it was cut off.

It has a line for each view of an inspection, and for each burst of a sweep.
"""

from __future__ import annotations

import json
import math
import os
import time
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.errors import OutputError, ParameterError, RecordError
from minorloop.files import first_difference, lock_path, refusal, write_atomically
from minorloop_head.cli._journal_checks import AGAIN, LATEST, check, check_view

if TYPE_CHECKING:
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.inspected_view import InspectedView, Unconfirmed
    from minorloop_head.procedures.rig import LogEntry
    from minorloop_head.ultrasound.crack_depth import CrackDepth
    from minorloop_head.ultrasound.pits import PitDepth
    from minorloop_head.vision.cracks import TracedCrack
    from minorloop_head.vision.defects import Hole

FINISHED = "finished"
NAME = "journal.jsonl"
_EXACT = 9
"""Digits of a pose, so that an inspection that goes on has the same map as one that was not cut."""


class Journal:
    """A journal that is being written; each line is on the disk when its method returns.

    Parameters
    ----------
    folder : path
        Existing.
    begun : dict
        What is begun, and by what.
    lines : sequence of dict
        Of one that was cut off, which is continued.

    Attributes
    ----------
    began : str
        When its first line was written.
    resumed : list of str
        When it was continued.
    """

    def __init__(
        self, folder: Path, begun: dict[str, Any], lines: Sequence[dict[str, Any]] = (), **kept: int
    ) -> None:
        # Also one that is not closed, because of an error, is free again.
        self._unlock = weakref.finalize(self, os.close, _locked(folder))
        now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
        passed = max((float(line["t"]) for line in lines), default=0.0)
        self._began = time.monotonic() - passed
        self.began = str(lines[0]["began"]) if lines else now
        self.resumed = [str(line["resumed"]) for line in lines if line["what"] == "resume"]
        self.resumed += [now] * bool(lines)
        # A line that was not written to its end is left out.
        write_atomically(folder / NAME, "".join(f"{json.dumps(line)}\n" for line in lines))
        self._file = (folder / NAME).open("ab", buffering=0)
        if lines:
            self.note("resume", resumed=now, **kept)
        else:
            self.note("begin", **begun, began=self.began)

    def note(self, what: str, **content: Any) -> None:
        """Add a line.

        Raises
        ------
        OutputError
            If it cannot be written, as on a full disk. The lines before stay as they are.
        """
        line = {"what": what, "t": self.seconds(), **content}
        data, size = f"{json.dumps(line)}\n".encode(), os.fstat(self._file.fileno()).st_size
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise refusal(Path(self._file.name), error) from None

    def seconds(self) -> float:
        """Return for how many seconds it has been written."""
        return round(time.monotonic() - self._began, 2)

    def close(self) -> None:
        """End it."""
        self._file.close()
        self._unlock()


def _locked(folder: Path) -> int:
    """Return what keeps other programs from writing a journal in a folder until it is closed."""
    found = lock_path(folder)
    if found is None:
        raise OutputError(
            f"another program writes to {folder}; wait until it has ended, or give another folder"
        )
    return found


@dataclass(frozen=True)
class Resumed:
    """What the journal of an inspection or a sweep that was cut off has: nothing of a new one."""

    lines: Sequence[dict[str, Any]] = ()
    """Up to the first that is damaged."""
    damaged: int = 0
    """Number of the first damaged line, from 1; 0 without one."""

    @classmethod
    def of(cls, folder: Path, begun: dict[str, Any], what: str) -> Resumed:
        """Return it by the journal in a folder.

        Parameters
        ----------
        folder : path
        begun : dict
            What is begun, and by what.
        what : str
            ``inspection`` or ``sweep``.

        Raises
        ------
        RecordError
            If there is no folder, or no journal in it.
        ParameterError
            If it is finished, or another one was begun.
        """
        _check_folder(folder, what)
        every = _parsed_lines(folder / NAME)
        found = cls(*_sound_lines(every, folder / NAME))
        _check_resumed([line for line in every if line is not None], folder, begun, what)
        return found

    def set_aside(self, folder: Path, kept: str) -> str:
        """Copy a damaged journal beside it, and say so in a sentence with what is ``kept``."""
        file = folder / NAME
        copies = (folder / f"journal.damaged{n or ''}.jsonl" for n in range(1000))
        copy = next(each for each in copies if not each.exists())
        write_atomically(copy, file.read_bytes())
        return (
            f"line {self.damaged} of {file} is damaged; what is kept before it: {kept}; the rest "
            f"is measured again, and the journal as it was is kept in {copy}"
        )


def _check_folder(folder: Path, what: str) -> None:
    """Refuse to resume an inspection or a sweep whose folder does not exist.

    Raises
    ------
    RecordError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise RecordError(
            f"there is no folder {folder}; give that of the {what} that was cut off, or begin one "
            "without --resume"
        )


def _check_resumed(
    lines: Sequence[dict[str, Any]], folder: Path, begun: dict[str, Any], what: str
) -> None:
    """Refuse to go on with an inspection or a sweep that cannot be resumed.

    Raises
    ------
    ParameterError
        If it is finished, or another one was begun.
    """
    if lines[-1].get("why") == FINISHED:
        raise ParameterError(
            f"the {what} in {folder} is finished; give another folder, without --resume"
        )
    other = first_difference({name: lines[0].get(name) for name in begun}, begun)
    if other:
        raise ParameterError(
            f"the {what} in {folder} is another one: {other}; resume it as it was begun, or give "
            "another folder"
        )


def journal_of(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal; a last one that was not written to its end is left out.

    Raises
    ------
    RecordError
        If it is no journal.
    """
    lines, damaged = _sound_lines(_parsed_lines(file), file)
    if damaged:
        raise RecordError(
            f"line {damaged} of {file} is damaged; delete it and all lines after it, so that what "
            "they say is measured again"
        )
    return lines


def _sound_lines(
    every: Sequence[dict[str, Any] | None], file: Path
) -> tuple[list[dict[str, Any]], int]:
    """Return parsed lines up to the first that is damaged, and its number; 0 without one."""
    damaged = 1 + every.index(None) if None in every else 0
    before = every[: damaged - 1] if damaged else every
    if not before:
        raise unreadable(file)
    return [line for line in before if line is not None], damaged


def _parsed_lines(file: Path) -> list[dict[str, Any] | None]:
    """Return the lines of a journal, None for one that is damaged; none if it cannot be read.

    A last one that was not written to its end is left out.
    """
    try:
        *lines, rest = file.read_bytes().split(b"\n")
    except OSError:
        return []
    found, last = [_parsed(line) for line in lines], _parsed(rest)
    return found if last is None else [*found, last]


def _parsed(line: bytes) -> dict[str, Any] | None:
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        if isinstance(found, dict) and "what" in found:
            return found
    return None


def unreadable(file: Path) -> RecordError:
    """Return the error of a file that is no journal, or of which nothing can be used."""
    return RecordError(
        f"{file} is not the journal of an inspection or a sweep, or is damaged; give its {NAME}"
    )


def view_line(view: InspectedView) -> dict[str, Any]:
    """Return the content of the line of a view."""
    picture, (advance, roll) = view.picture, view.place
    return {
        "picture": f"{picture.name}.png",
        "taken": picture.t,
        "verdict": picture.verdict,
        "pose": {
            **_degrees(view.joints, _EXACT),
            "advance [mm]": round(1e3 * advance, _EXACT),
            "roll [deg]": round(math.degrees(roll), _EXACT),
        },
        "sight": _degrees(view.angles, _EXACT),
        "shown": picture.rows(),
        "seen": [_noted(shown) for shown in view.seen],
        "finding": None if view.finding is None else row(view),
        "unconfirmed": None if view.unconfirmed is None else lost_row(view.unconfirmed),
        "steps": step_rows(view.steps),
        "probed": None if view.probed is None else asdict(view.probed),
    }


def missed_row(view: InspectedView) -> dict[str, Any]:
    """Return the direction of a view that could not be searched, and why."""
    advance, roll = view.place
    return {
        "view": view.picture.name,
        "verdict": view.picture.verdict,
        **_degrees(view.angles),
        "advance [mm]": round(1e3 * advance, 4),
        "roll [deg]": round(math.degrees(roll), 4),
    }


def step_rows(steps: Sequence[LogEntry]) -> list[dict[str, Any]]:
    """Return the steps of a visit as rows."""
    return [
        {"step": each.what, "outcome": each.outcome, "succeeded": each.succeeded} for each in steps
    ]


def steps_of(rows: Sequence[dict[str, Any]], t: float) -> tuple[LogEntry, ...]:
    """Return the steps of rows, all at a time in seconds."""
    from minorloop_head.procedures.rig import LogEntry

    return tuple(LogEntry(t, each["step"], each["outcome"], each["succeeded"]) for each in rows)


def outcomes(view: InspectedView) -> dict[str, bool | None]:
    """Return how far the visit of a finding came: None for what was not tried.

    Without an echo of the wall a place is not scanned, and whether it is within reach not known.
    """
    last = {each.what: each.succeeded for each in view.steps}
    if last.get("modality") is False:
        last["scan"] = False
    return {
        "found": view.finding is not None,
        "centred": last.get("centre"),
        "reached": last.get("reach", last.get("scan") or None),
        "touched": last.get("touch"),
        "scanned": last.get("scan"),
    }


def kept_views(
    folder: Path, lines: Sequence[dict[str, Any]], view: HeadCalibration
) -> list[InspectedView]:
    """Return the views of a journal that need not be taken again, in the order of their taking.

    Of each name it is the newest. Taken again is what has no picture in the folder, and what has
    frames that cannot be used, unless the candidate that it visits was confirmed by another view.

    Parameters
    ----------
    folder : path
        Of the inspection.
    lines : sequence of dict
        Of its journal.
    view : HeadCalibration
        Of the head, as it was.

    Raises
    ------
    RecordError
        If a line of a view lacks something, or has an impossible value.
    """
    import numpy as np

    from minorloop_head.vision.imaging import opencv

    cv2 = opencv()
    found: dict[str, InspectedView] = {}
    for number, line in enumerate(lines, 1):
        where = f"line {number} of {folder / NAME}"
        check(where, "t", line.get("t"), ((0.0, LATEST),))
        if line["what"] == "view":
            try:
                check_view(where, line, view)
                file = folder / "pictures" / line["picture"]
                data = np.frombuffer(file.read_bytes() if file.is_file() else b"", np.uint8)
                image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
                found.pop(line["picture"], None)
                if image is not None:
                    found[line["picture"]] = _view_of(line, image, view)
            except RecordError:
                raise
            except (KeyError, TypeError, ValueError, AttributeError):
                raise RecordError(f"{where} is not the whole line of a view; {AGAIN}") from None
    return _usable(list(found.values()))


def _usable(views: Sequence[InspectedView]) -> list[InspectedView]:
    """Return views without those to take again; a second visit follows its first."""
    from minorloop_head.procedures.inspected_view import first_visit
    from minorloop_head.vision.frame_checks import GOOD

    names = [(view.picture.name, first_visit(view.picture.name)) for view in views]
    each = list(zip(views, names, strict=True))
    confirmed = {first for view, (_, first) in each if view.finding is not None}
    again = {
        name
        for view, (name, first) in each
        if view.picture.verdict != GOOD and first not in confirmed
    }
    return [view for view, both in each if again.isdisjoint(both)]


def _view_of(line: dict[str, Any], image: Any, view: HeadCalibration) -> InspectedView:
    """Return the view of a line."""
    from minorloop_head.procedures.inspected_view import InspectedView, view_with, with_finding
    from minorloop_head.procedures.pictures import InspectedPicture

    pose, sight, lost = line["pose"], line["sight"], line["unconfirmed"]
    place = 1e-3 * pose["advance [mm]"], math.radians(pose["roll [deg]"])
    found = InspectedView(
        picture=InspectedPicture(
            name=Path(line["picture"]).stem, t=line["taken"], verdict=line["verdict"]
        ),
        image=image,
        angles=_radians(sight),
        joints=_radians(pose),
        place=place,
        unconfirmed=None if lost is None else _lost(lost),
        steps=steps_of(line.get("steps", ()), line["taken"]),  # earlier versions wrote none
        probed=_probed_of(line.get("probed")),
    )
    found = view_with(found, [_restored(one) for one in line["seen"]], view.camera_at(place))
    return found if line["finding"] is None else with_finding(found, view.radius)


def _probed_of(noted: dict[str, Any] | None) -> PitDepth | CrackDepth | None:
    """Return what the echoes say of a finding."""
    from minorloop_head.ultrasound.crack_depth import CrackDepth
    from minorloop_head.ultrasound.pits import PitDepth

    if noted is None:
        return None
    return PitDepth(**noted) if "phi" in noted else CrackDepth(**noted)


def _noted(shown: Hole | TracedCrack) -> dict[str, Any]:
    """Return all numbers of a hole or a crack; null is an infinite one."""
    import numpy as np

    values = {name: np.asarray(value).tolist() for name, value in asdict(shown).items()}
    return {name: None if value == math.inf else value for name, value in values.items()}


def _restored(noted: dict[str, Any]) -> Hole | TracedCrack:
    import numpy as np

    from minorloop_head.vision.cracks import TracedCrack
    from minorloop_head.vision.defects import Hole

    values: dict[str, Any] = {
        name: np.array(value) if isinstance(value, list) else math.inf if value is None else value
        for name, value in noted.items()
    }
    return Hole(**values) if "rim" in values else TracedCrack(**values)


def _degrees(pair: tuple[float, float], digits: int = 4) -> dict[str, float]:
    """Return pan and tilt in degrees."""
    return {
        f"{name} [deg]": round(math.degrees(angle), digits)
        for name, angle in zip(("pan", "tilt"), pair, strict=True)
    }


def _radians(noted: dict[str, float]) -> tuple[float, float]:
    return math.radians(noted["pan [deg]"]), math.radians(noted["tilt [deg]"])


def row(view: InspectedView) -> dict[str, Any]:
    """Return the finding of a view in degrees and millimetres, null where unknown."""
    assert view.finding is not None
    found: dict[str, Any] = {}
    for name, value in asdict(view.finding).items():
        if isinstance(value, str):
            found[name] = value
            continue
        angle = name.startswith("phi")
        shown = math.degrees(value) if angle else 1e3 * value
        found[f"{name} [{'deg' if angle else 'mm'}]"] = (
            round(shown, 4) if math.isfinite(value) else None
        )
    found["evidence"] = None if math.isnan(view.evidence) else round(view.evidence, 1)
    found["picture"] = f"{view.picture.name}.png"
    found["course"] = None if view.course is None else view.course.round(6).tolist()
    return found


def lost_row(lost: Unconfirmed) -> dict[str, Any]:
    """Return a candidate that was not confirmed in degrees and millimetres."""
    from minorloop_head.geometry import wrapped

    return {
        "kind": lost.kind,
        "phi [deg]": round(math.degrees(float(wrapped(lost.phi))), 4),
        "z [mm]": round(1e3 * lost.z, 4),
        "evidence": None if math.isnan(lost.evidence) else round(lost.evidence, 1),
        "seen in": list(lost.seen_in),
        "why": lost.why,
    }


def _lost(noted: dict[str, Any]) -> Unconfirmed:
    """Return what a row of `lost_row` says."""
    from minorloop_head.procedures.inspected_view import Unconfirmed

    return Unconfirmed(
        kind=noted["kind"],
        phi=math.radians(noted["phi [deg]"]),
        z=1e-3 * noted["z [mm]"],
        evidence=math.nan if noted["evidence"] is None else noted["evidence"],
        seen_in=tuple(noted["seen in"]),
        why=noted["why"],
    )
