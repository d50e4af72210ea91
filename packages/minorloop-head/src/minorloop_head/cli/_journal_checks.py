"""Ranges of the numbers in a journal: a line with an impossible one is refused, and named."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, TypeAlias

from minorloop.errors import RecordError

if TYPE_CHECKING:
    from minorloop_head.procedures.calibration import HeadCalibration

AGAIN = (
    "delete this line and all lines after it, so that they are measured again, or begin in a new "
    "folder"
)
LATEST = 1e9
"""Of a time, in seconds."""
TURN = 2.0 * math.pi
HALF_TURN = 180.0
FARTHEST = 10.0
"""Of a catheter and of a place along a pipe, in metres."""
_ODDS = 1e3
"""Largest logarithm of odds."""
_LARGEST = 1e9
"""Of a number that is not known, and not used."""

Limits: TypeAlias = tuple[tuple[float, float], ...]
"""Least and largest of a number, or of each number of a list."""


def check(where: str, name: str, value: Any, limits: Limits, *, unknown: bool = False) -> None:
    """Refuse a number, or a list of them, beyond its limits.

    Parameters
    ----------
    where : str
        Line and file, for the message.
    name : str
        Of the value.
    value : number or list of numbers
        As the line has it.
    limits : Limits
    unknown : bool
        Whether numbers may be unknown: NaN, or beyond limits.

    Raises
    ------
    RecordError
        If a number is beyond its limits, or the value is of another kind.
    """
    numbers = value if isinstance(value, list) else [value]
    wide = ((-_LARGEST, _LARGEST),) * len(limits)
    if isinstance(value, list) == (len(limits) > 1) and len(numbers) == len(limits):
        pairs = zip(numbers, wide if unknown else limits, strict=True)
        if all(_within(one, *ends, unknown=unknown) for one, ends in pairs):
            return
    allowed = " and ".join(f"{low:.4g} to {high:.4g}" for low, high in limits)
    raise impossible(where, name, value, allowed)


def check_all(where: str, values: Mapping[str, Any], limits: Mapping[str, Limits]) -> None:
    """Refuse values of a line that are beyond their limits, by their names."""
    for name, allowed in limits.items():
        check(where, name, values[name], allowed)


def check_known(where: str, values: Mapping[str, Any], limits: Mapping[str, Limits]) -> None:
    """Refuse values beyond their limits; NaN is not known, and some may be missing."""
    for name, allowed in limits.items():
        if name in values and values[name] == values[name]:
            check(where, name, values[name], allowed)


def check_points(where: str, name: str, points: Sequence[Any], limits: Limits) -> None:
    """Refuse a list of points of which one is beyond its limits."""
    for point in points:
        check(where, name, point, limits)


def check_view(where: str, line: dict[str, Any], view: HeadCalibration) -> None:
    """Refuse the line of a view of an inspection with an impossible value.

    Parameters
    ----------
    where : str
        Line and file, for messages.
    line : dict
    view : HeadCalibration
        Of the head: no place is beyond its pipe, and no depth beyond the wall.
    """
    name = line["picture"]
    if not isinstance(name, str) or name != PurePath(name).name:
        raise impossible(where, "picture", name, "the name of a file in the folder pictures")
    check(where, "taken", line["taken"], ((0.0, LATEST),))
    angles = dict.fromkeys(("pan [deg]", "tilt [deg]"), ((-HALF_TURN, HALF_TURN),))
    check_all(where, line["sight"], angles)
    check_all(
        where,
        line["pose"],
        {
            **angles,
            "advance [mm]": ((-1e3 * FARTHEST, 1e3 * FARTHEST),),
            "roll [deg]": ((-4 * HALF_TURN, 4 * HALF_TURN),),
        },
    )
    place, size = ((-TURN, TURN), (-FARTHEST, FARTHEST)), ((0.0, 2 * view.radius),)
    for shown in line["seen"]:
        _check_evidence(where, shown)
        if "rim" in shown:
            check_all(where, shown, {"place": place, "diameter": size})
            check_points(where, "rim", shown["rim"], place)
        else:
            check_all(where, shown, {"length": ((0.0, FARTHEST),), "contrast": ((-_ODDS, _ODDS),)})
            check_points(where, "places", shown["places"], place)
            check_points(where, "widths", shown["widths"], size)
    if (lost := line["unconfirmed"]) is not None:
        limits = {
            "phi [deg]": ((-2 * HALF_TURN, 2 * HALF_TURN),),
            "z [mm]": ((-1e3 * FARTHEST, 1e3 * FARTHEST),),
        }
        check_all(where, lost, limits)
        _check_evidence(where, lost)
    if (probed := line.get("probed")) is not None:
        deep = ((0.0, view.thickness),)
        known = {
            "phi": place[:1],
            "z": place[1:],
            "diameter": size,
            "least_width": size,
            "depth": deep,
            "least_depth": deep,
            **dict.fromkeys(("depth_sd", "place_sd", "diameter_sd"), ((0.0, FARTHEST),)),
        }
        check_known(where, probed, known)


def _check_evidence(where: str, values: Mapping[str, Any]) -> None:
    """Refuse evidence beyond its limits; null is none, or infinite."""
    if values["evidence"] is not None:
        check(where, "evidence", values["evidence"], ((-_ODDS, _ODDS),))


def impossible(where: str, name: str, value: Any, allowed: str) -> RecordError:
    """Return the error of a value that cannot be."""
    return RecordError(
        f"{where} has {reprlib.repr(value)} as {name!r}, which must be {allowed}; {AGAIN}"
    )


def _within(value: Any, low: float, high: float, *, unknown: bool) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return low <= value <= high or (unknown and value != value)
