"""Largest circle on the wall of a pipe that the optical axis of a head can go round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.geometry import Mount, wall_point
from minorloop.head.twins.pipe import Bore, Pipe
from minorloop.head.twins.rig import STRAIGHT

LEAST = 5.0
"""Least angle of a joint on a circle, in degrees. A wire pulls in one direction only: nearer to its
cold end it returns too slowly to follow a circle."""
_PLACES, _HALVINGS = 72, 10
"""Places of a circle that are checked, and steps of the search: to 0.02 mm."""


@dataclass(frozen=True)
class WallReach:
    """The largest circle about one place of the wall.

    Parameters
    ----------
    z : float
        Distance of the place from the pivot of the head along the pipe, in metres.
    across : float
        Diameter of the largest circle whose whole path is within reach, in metres.
    per_degree : float
        How far the optical axis moves along the wall for 1 degree at the far end of that circle, in
        metres.
    """

    z: float
    across: float
    per_degree: float


def wall_reach(place: Bore, highest: float) -> WallReach:
    """Return the largest circle about a place of the wall, for a head of nominal size.

    Parameters
    ----------
    place : Bore
        In the middle of the circle.
    highest : float
        Largest angle of both joints, in degrees; the least is `LEAST`.
    """
    largest, beyond = 0.0, place.z
    for _ in range(_HALVINGS):
        radius = 0.5 * (largest + beyond)
        joints = joints_round(place, radius)
        if joints.min() >= LEAST and joints.max() <= highest:
            largest = radius
        else:
            beyond = radius
    far = place.z + largest
    slope = (far**2 + Pipe.radius**2) / Pipe.radius
    return WallReach(place.z, 2 * largest, slope * float(np.radians(1.0)))


def joints_round(place: Bore, radius: float) -> FloatArray:
    """Return the joints (n, 2) in degrees that aim the optical axis at places of a circle."""
    mount, phases = Mount(), 2 * np.pi * np.arange(_PLACES) / _PLACES
    phi = place.phi + radius / Pipe.radius * np.cos(phases)
    z = place.z + radius * np.sin(phases)
    ways = [mount.aim(wall_point(*each, Pipe.radius)) for each in zip(phi, z, strict=True)]
    return np.asarray(np.degrees(np.array(ways) + STRAIGHT))
