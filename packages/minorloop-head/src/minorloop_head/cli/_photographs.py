"""Pictures for ``minorloop head calibrate``, taken by ``minorloop head photograph``."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from minorloop.errors import OutputError

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.lab.actuator import Actuator

_LAST = 5
"""Readings at the end of a hold whose mean is the angle."""


def at_angles(
    plant: Actuator, highest: float, steps: int, hold: float
) -> Iterator[tuple[str, FloatArray]]:
    """Hold both currents at all pairs of levels; yield a name with the angles, and these in deg."""
    levels = np.linspace(0.0, highest, steps)
    try:
        for number, currents in enumerate(itertools.product(levels, levels)):
            readings = np.asarray(plant.apply(np.array(currents), hold, hold / (2 * _LAST)).y)
            pan, tilt = angles = readings[:, -_LAST:].mean(axis=1)
            yield f"{number:02d}_pan{pan:.2f}_tilt{tilt:.2f}", angles
    finally:
        plant.safe()


def by_hand(count: int, every: float) -> Iterator[str]:
    """Yield the names of pictures after equal times, in which the target is moved."""
    for number in range(count):
        typer.echo(f"picture {number + 1} of {count} in {every:g} s; hold the target", err=True)
        time.sleep(every)
        yield f"{number:02d}"


def keep(camera: Any, path: Path) -> None:
    """Write the next picture of a camera to a PNG file."""
    from minorloop_head.vision.imaging import opencv

    if not opencv().imwrite(str(path), camera.frame().image):
        raise OutputError(f"{path} cannot be written; check the disk")
