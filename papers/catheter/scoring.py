"""Truth of twins of head, camera and probe, for scoring a run.

No estimator and no controller uses it; only a study reads it, after a run.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Mount, Pinhole, meet_wall, wall_point, wrapped
from minorloop_head.twins.camera import Camera
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore
from minorloop_head.twins.rig import STRAIGHT, Rig
from minorloop_head.twins.surroundings import Surroundings
from minorloop_head.twins.wire import HIGHEST_CURRENT, HeatedWires


@dataclass(frozen=True, eq=False)
class Truth:
    """True course of a run."""

    angle: FloatArray
    """Shape (T, axes). Angles without noise and delay, in degrees, at the end of every tick."""
    hottest: FloatArray
    """Shape (axes,). Highest temperature of each wire, in degrees Celsius."""
    stress: FloatArray
    """Shape (axes,). Highest stress of each wire, in Pa."""


def truth(twin: HeatedWires) -> Truth:
    """Return the truth of a twin with ``log_truth=True``, after its run."""
    hottest, stress = twin._peaks()
    return Truth(twin._truth()["angle"], hottest, stress)


def body_temperature(twin: HeatedWires) -> FloatArray:
    """Return the temperature (T,) of the body of a head with ``log_truth=True``, in Celsius."""
    return twin._truth()["body"][:, 0]


def line_of_sight(plant: Rig) -> FloatArray:
    """Return the true pan and tilt (2,) of the optical axis, in radians."""
    return np.array(plant.stance()[:2])


def catheter_place(catheter: Catheter) -> FloatArray:
    """Return the true advance in metres and roll in radians (2,) of the tip of a catheter."""
    return np.asarray(catheter._output_now() * (1e-3, math.radians(1.0)))


def apart(place: npt.ArrayLike, bore: Bore, radius: float) -> float:
    """Return the straight distance from a place (2,) of the wall to a bore, in metres."""
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    ends = wall_point(phi, z, radius), wall_point(bore.phi, bore.z, radius)
    return float(np.linalg.norm(ends[0] - ends[1]))


def ends(head: Head, surroundings: Surroundings) -> FloatArray:
    """Return the least and largest settled angle (axes, 2) of the wires in degrees.

    The head is a fresh twin, which is heated; a wire has settled after 15 of its lags, 60 s.
    """
    head.surround(surroundings)
    found = []
    for current in (HIGHEST_CURRENT, 0.0):
        head._hold(np.full(2, current), np.array([60.0]))
        found.append(np.degrees(head._state[:, 3] / head._axes[:, 17]))
    return np.stack(found[::-1], axis=1)


def reaches(head: Head, surroundings: Surroundings, needs: FloatArray) -> bool:
    """Return whether the wires of a fresh head reach all readings between two.

    ``needs`` (2, 2) are the least and largest reading of each joint, in degrees.
    """
    couple = np.array([[1.0, head._cross[0]], [head._cross[1], 1.0]])
    least, largest = ends(head, surroundings).T
    return all(
        bool(((own >= least) & (own <= largest)).all())
        for pair in itertools.product(*needs)
        for own in (np.linalg.solve(couple, np.array(pair)),)
    )


def places_seen(mount: Mount, joints: FloatArray, bore: Bore, radius: float) -> FloatArray:
    """Return the places (T, 2) where the true optical axis meets the wall, relative to a bore.

    ``joints`` (T, 2) are true pan and tilt in degrees, on the true mount; places are in metres.
    """
    places = np.empty((len(joints), 2))
    for n, (pan, tilt) in enumerate(np.radians(joints) - STRAIGHT):
        pose = mount.pose(float(pan), float(tilt))
        phi, z, _ = meet_wall(pose.position, pose.rotation[:, 2], radius)
        places[n] = radius * float(wrapped(phi - bore.phi)), z - bore.z
    return places


def middle_of(mount: Mount, plant: Rig, place: npt.ArrayLike, radius: float) -> FloatArray:
    """Return a place (2,) of the wall in true camera coordinates (3,).

    The true mount is that for the catheter at 0.
    """
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    pose = mount.pose(*line_of_sight(plant).tolist())
    return np.asarray(pose.to_camera(wall_point(phi, z, radius)))


def true_lens(camera: Camera) -> Pinhole:
    """Return the lens of a camera."""
    return camera._optics


def true_pixel(camera: Camera, phi: npt.ArrayLike, z: npt.ArrayLike) -> FloatArray:
    """Return the true pixels (..., 2) of places of the wall."""
    return camera._pixel(phi, z)
