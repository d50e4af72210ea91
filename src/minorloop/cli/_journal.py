"""The journal of an inspection: a line for each view, from which a cut-off inspection goes on."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.errors import RecordError

if TYPE_CHECKING:
    from minorloop.head.procedures.calibration import HeadCalibration
    from minorloop.head.procedures.inspection import InspectedView, Unconfirmed
    from minorloop.head.vision.cracks import TracedCrack
    from minorloop.head.vision.defects import Hole

NAME = "journal.jsonl"


def journal_of(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal; a last one that was not written to its end is left out.

    Raises
    ------
    RecordError
        If it is no journal.
    """
    try:
        *lines, rest = file.read_text(encoding="utf-8", errors="replace").split("\n")
        found = [json.loads(line) for line in lines]
    except (OSError, ValueError):
        found, rest = [], ""
    with suppress(ValueError):
        found.append(json.loads(rest))
    if not found or not all(isinstance(line, dict) and "what" in line for line in found):
        raise RecordError(f"{file} is not the journal of an inspection; give its {NAME}")
    return found


def view_line(view: InspectedView) -> dict[str, Any]:
    """Return the content of the line of a view."""
    picture, (advance, roll) = view.picture, view.place
    return {
        "picture": f"{picture.name}.png",
        "taken": picture.t,
        "verdict": picture.verdict,
        "pose": {
            **_degrees(view.joints),
            "advance [mm]": round(1e3 * advance, 4),
            "roll [deg]": round(math.degrees(roll), 4),
        },
        "sight": _degrees(view.angles),
        "shown": picture.rows(),
        "seen": [_noted(shown) for shown in view.seen],
        "finding": None if view.finding is None else row(view),
        "unconfirmed": None if view.unconfirmed is None else lost_row(view.unconfirmed),
    }


def kept_views(
    folder: Path, lines: list[dict[str, Any]], view: HeadCalibration
) -> list[InspectedView]:
    """Return the views of a journal whose pictures are in its folder, the newest of each name.

    Parameters
    ----------
    folder : path
        Of the inspection.
    lines : list
        Of its journal.
    view : HeadCalibration
        Of the head, as it was.

    Raises
    ------
    RecordError
        If a line of a view lacks something.
    """
    import numpy as np

    from minorloop.head.vision.imaging import opencv

    cv2 = opencv()
    found = {}
    for line in lines:
        if line["what"] == "view":
            try:
                file = folder / "pictures" / line["picture"]
                data = np.frombuffer(file.read_bytes() if file.is_file() else b"", np.uint8)
                image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
                if image is not None:  # otherwise it is taken again
                    found[line["picture"]] = _view_of(line, image, view)
            except (KeyError, TypeError, ValueError):
                raise RecordError(
                    f"line {1 + lines.index(line)} of {folder / NAME} is not the whole line of a "
                    "view; inspect into a new folder"
                ) from None
    return list(found.values())


def _view_of(line: dict[str, Any], image: Any, view: HeadCalibration) -> InspectedView:
    """Return the view of a line."""
    from minorloop.head.procedures.inspection import InspectedView, view_with, with_finding
    from minorloop.head.procedures.pictures import InspectedPicture

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
    )
    found = view_with(found, [_restored(one) for one in line["seen"]], view.camera_at(place))
    return found if line["finding"] is None else with_finding(found, view.radius)


def _noted(shown: Hole | TracedCrack) -> dict[str, Any]:
    """Return all numbers of a hole or a crack; null is an infinite one."""
    import numpy as np

    values = {name: np.asarray(value).tolist() for name, value in asdict(shown).items()}
    return {name: None if value == math.inf else value for name, value in values.items()}


def _restored(noted: dict[str, Any]) -> Hole | TracedCrack:
    import numpy as np

    from minorloop.head.vision.cracks import TracedCrack
    from minorloop.head.vision.defects import Hole

    values: dict[str, Any] = {
        name: np.array(value) if isinstance(value, list) else math.inf if value is None else value
        for name, value in noted.items()
    }
    return Hole(**values) if "rim" in values else TracedCrack(**values)


def _degrees(pair: tuple[float, float]) -> dict[str, float]:
    """Return pan and tilt in degrees."""
    return {
        f"{name} [deg]": round(math.degrees(angle), 4)
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
    return {
        "kind": lost.kind,
        "phi [deg]": round(math.degrees(lost.phi), 4),
        "z [mm]": round(1e3 * lost.z, 4),
        "evidence": None if math.isnan(lost.evidence) else round(lost.evidence, 1),
        "seen in": list(lost.seen_in),
        "why": lost.why,
    }


def _lost(noted: dict[str, Any]) -> Unconfirmed:
    """Return what a row of `lost_row` says."""
    from minorloop.head.procedures.inspection import Unconfirmed

    return Unconfirmed(
        kind=noted["kind"],
        phi=math.radians(noted["phi [deg]"]),
        z=1e-3 * noted["z [mm]"],
        evidence=math.nan if noted["evidence"] is None else noted["evidence"],
        seen_in=tuple(noted["seen in"]),
        why=noted["why"],
    )
