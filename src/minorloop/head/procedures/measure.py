"""Make a burst of shots into one trace, and the bursts of a raster into a depth and a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.geometry import wall_distance
from minorloop.head.reconstruction.depth_map import DepthMap, Patch
from minorloop.head.reconstruction.fusion import fuse, mean_depths, outline_of
from minorloop.head.ultrasound.echoes import Burst, average, choose_modality
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.ultrasound.pits import PitDepth
from minorloop.lab.actuator import Shot

MOST_OFF = 0.8e-3
"""How far off its point of the raster a burst may be, in metres. Each is fitted where it was, so
that only what leaves the raster is refused: two and a half steps."""
PATCH = 2.4e-3
"""Side of the map about a finding, in metres: the raster, and a footprint of the beam beyond."""
NO_COUPLING = "no coupling"


def hears_wall(shots: Sequence[Shot], ear: CalibratedProbe) -> bool:
    """Whether the wall answers at all, as it does in water only."""
    return choose_modality(shots, ear.radius - ear.transducer.face, ear.speed) == "sonar"


def burst_of(
    shots: Sequence[Shot],
    angles: npt.ArrayLike,
    wanted: npt.ArrayLike,
    ear: CalibratedProbe,
    *,
    first: bool,
) -> Burst:
    """One trace of a burst, with its verdict.

    Parameters
    ----------
    shots : sequence of Shot
        Of the burst.
    angles, wanted : (2,) array_like
        Line of sight in radians as measured, and as it was wanted.
    ear : CalibratedProbe
        The probe where the catheter is.
    first : bool
        Whether it is the first of a raster: the verdict is then ``no coupling`` where the wall
        does not answer.
    """
    spot, aimed = ear.spots(np.array([angles, wanted]))[:, :2]
    off = float(wall_distance(spot, aimed, ear.radius))
    count = len(shots)
    burst = average(shots, np.tile(angles, (count, 1)), np.full(count, off), most_off=MOST_OFF)
    if first and not burst.verdict and not hears_wall(shots, ear):
        return replace(burst, trace=np.empty(0), used=0, verdict=NO_COUPLING)
    return burst


def wall_about(
    pit: PitDepth,
    bursts: Sequence[Burst],
    ear: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    seen: Callable[[Patch], FloatArray] | None = None,
) -> DepthMap:
    """The map of depth about a pit.

    Parameters
    ----------
    pit : PitDepth
        As measured.
    bursts : sequence of Burst
    ear : CalibratedProbe
    centre : (float, float)
        Phi and z of the mouth as the camera saw it.
    diameter : float
        Of the mouth as the camera saw it, in metres.
    seen : callable, optional
        Gives the logarithm (rows, columns) of what a camera saw on a patch.
    """
    patch = Patch.around(pit.phi, pit.z, size=PATCH, radius=ear.radius)
    image = None if seen is None else seen(patch)
    outline = None if image is None else outline_of(image, patch, centre, diameter)
    heard = mean_depths(bursts, ear, patch, pit) if np.isfinite(pit.depth) else None
    return fuse(pit, heard, patch, image=image, outline=outline)
