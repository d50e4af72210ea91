"""The truth about twins of head, camera and probe, for judging a run.

No estimator and no controller may know any of this; only a study reads it, after a run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.geometry import Mount, meet_wall, wall_point
from minorloop.head.twins.camera import Camera
from minorloop.head.twins.pipe import Bore
from minorloop.head.twins.rig import Rig
from minorloop.head.twins.ultrasound import Ultrasound
from minorloop.head.twins.wire import HeatedWires


@dataclass(frozen=True, eq=False)
class Truth:
    """What really happened.

    Parameters
    ----------
    angle : (T, axes) array
        Angles without noise and delay, in degrees, at the end of every tick.
    hottest : (axes,) array
        Highest temperature of each wire, in degrees Celsius.
    stress : (axes,) array
        Highest stress of each wire, in Pa.
    """

    angle: FloatArray
    hottest: FloatArray
    stress: FloatArray


def truth(twin: HeatedWires) -> Truth:
    """Read the log of a twin that was made with ``log_truth=True``, after its run."""
    hottest, stress = twin._peaks()
    return Truth(twin._truth()["angle"], hottest, stress)


def line_of_sight(plant: Rig) -> FloatArray:
    """(2,) true pan and tilt of the optical axis, in radians."""
    return np.array(plant.stance()[:2])


def apart(place: npt.ArrayLike, bore: Bore, radius: float) -> float:
    """Metres straight from a place (2,), phi and z, of the wall to the middle of a bore."""
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    ends = wall_point(phi, z, radius), wall_point(bore.phi, bore.z, radius)
    return float(np.linalg.norm(ends[0] - ends[1]))


def off_bore(plant: Rig, offset: tuple[float, float], bore: Bore, radius: float) -> float:
    """Metres from where the optical axis meets the wall to the middle of a bore.

    Parameters
    ----------
    plant : Rig
        Head and catheter.
    offset : (float, float)
        Of the pivot off the axis of the pipe, in metres.
    bore : Bore
    radius : float
        Of the pipe, in metres.
    """
    pan, tilt, _, _, advance, roll = plant.stance()
    pose = Mount(offset=offset, roll=roll, advance=advance).pose(pan, tilt)
    return apart(meet_wall(pose.position, pose.rotation[:, 2], radius)[:2], bore, radius)


def middle_of(mount: Mount, plant: Rig, place: npt.ArrayLike, radius: float) -> FloatArray:
    """(3,) a place (2,) of the wall as the camera on a plant has it, in its coordinates.

    Parameters
    ----------
    mount : Mount
        As it truly is, the catheter at 0.
    plant : Rig
    place : (2,) array_like
        Phi and z.
    radius : float
        Of the pipe, in metres.
    """
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    pose = mount.pose(*line_of_sight(plant).tolist())
    return np.asarray(pose.to_camera(wall_point(phi, z, radius)))


def true_pixel(camera: Camera, phi: npt.ArrayLike, z: npt.ArrayLike) -> FloatArray:
    """(..., 2) pixels at which a camera shows places of the wall."""
    return camera._pixel(phi, z)


def floor_level(probe: Ultrasound) -> float:
    """Peak of the echo of the floor of a pit, over that of a plain wall."""
    return probe._floor_level()
