"""Average a burst of shots to one trace, and map the wall from the bursts of a raster."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_distance
from minorloop_head.reconstruction.depth_map import DepthMap, Patch
from minorloop_head.reconstruction.fusion import fuse, mean_depths, outline_of
from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import Burst, average, has_wall_echo
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import PitDepth

MOST_OFF = 0.8e-3
"""Farthest distance in metres of a burst from its point of the raster. Each is fitted where it was
measured, so that only bursts outside the raster are refused: two and a half steps."""
PATCH = 2.4e-3
"""Side of the map about a finding in metres: the raster and a footprint of the beam around it."""
NO_COUPLING = "no coupling"


def burst_of(
    shots: Sequence[Shot],
    angles: npt.ArrayLike,
    wanted: npt.ArrayLike,
    probe: CalibratedProbe,
    *,
    coupled: bool,
) -> Burst:
    """Average a burst to one trace with a verdict.

    Parameters
    ----------
    shots : sequence of Shot
        Of the burst.
    angles, wanted : (2,) array_like
        Line of sight as measured and as wanted, in radians.
    probe : CalibratedProbe
        At the place of the catheter.
    coupled : bool
        Whether one before it in the raster has an echo of the wall. Until then the verdict is ``no
        coupling`` if there is none: a single burst may meet the flank of a dent, which sends none
        back.
    """
    spot, aimed = probe.spots(np.array([angles, wanted]))[:, :2]
    off = float(wall_distance(spot, aimed, probe.radius))
    count = len(shots)
    burst = average(shots, np.tile(angles, (count, 1)), np.full(count, off), most_off=MOST_OFF)
    wall = probe.radius - probe.transducer.face
    if not coupled and not burst.verdict and not has_wall_echo(shots, wall, probe.speed):
        return replace(burst, trace=np.empty(0), used=0, verdict=NO_COUPLING)
    return burst


def has_coupling(bursts: Sequence[Burst]) -> bool:
    """Return whether one of the bursts of a raster has an echo of the wall."""
    return any(burst.verdict != NO_COUPLING for burst in bursts)


def wall_about(
    pit: PitDepth,
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    seen: Callable[[Patch], FloatArray] | None = None,
) -> DepthMap:
    """Map the depth of the wall about a pit.

    Parameters
    ----------
    pit : PitDepth
        As measured.
    bursts : sequence of Burst
    probe : CalibratedProbe
    centre : (float, float)
        Phi and z of the mouth by the camera.
    diameter : float
        Of the mouth by the camera, in metres.
    seen : callable, optional
        Returns the logarithm (rows, columns) of the image of a patch.
    """
    patch = Patch.around(pit.phi, pit.z, size=PATCH, radius=probe.radius)
    image = None if seen is None else seen(patch)
    outline = None if image is None else outline_of(image, patch, centre, diameter)
    echoes = mean_depths(bursts, probe, patch, pit) if np.isfinite(pit.depth) else None
    return fuse(pit, echoes, patch, image=image, outline=outline)
