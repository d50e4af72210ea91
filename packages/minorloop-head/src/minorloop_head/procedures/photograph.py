"""Take the pictures for the calibration of a head, by hand or at several angles of its joints."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from minorloop.arrays import as_finite
from minorloop.errors import OutputError, ParameterError
from minorloop.files import PathLike, new_folder
from minorloop.lab.actuator import Actuator
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.video import LiveCamera

_PATIENCE = 3.0
"""Longest time in seconds for a picture."""
_LAST = 5
"""Readings at the end of a hold whose mean is the angle."""


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
                        "camera, and leave --exposure out"
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
    if not least <= as_finite(f"{name} of --plan", value) <= most:
        raise ParameterError(f"{name} of --plan is {value}; give {least:g} to {most:g}")
