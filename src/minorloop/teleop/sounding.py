"""The echoes of one finding, point by point, until they are fitted."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.geometry import wrapped
from minorloop.inspection.echoes import Burst, average, choose_modality
from minorloop.inspection.pits import raster
from minorloop.teleop.plant import Tip, View, Where, angles_of

SHOTS = 16
POINTS, PITCH = 5, 0.36e-3
"""Points in a row of the raster, and metres between them."""
_MOST_OFF = 0.6e-3


def scan_targets(
    view: View, where: Where, centre: tuple[float, float]
) -> list[tuple[float, float]]:
    """Pan and tilt in degrees at which the probe hears each point of a raster about a place.

    Raises
    ------
    ParameterError
        If the probe cannot be aimed there from where the catheter is.
    """
    aims = raster(view.ear(where), centre, points=POINTS, pitch=PITCH)
    return [(float(pan), float(tilt)) for pan, tilt in np.degrees(aims)]


class Sounding:
    """A scan that is going on.

    Parameters
    ----------
    view : View
    finding : int
        Its number.
    centre : (float, float)
        Phi in radians and z in metres by the camera.
    diameter : float
        By the camera, in metres.
    """

    def __init__(
        self, view: View, finding: int, centre: tuple[float, float], diameter: float
    ) -> None:
        self._view, self._finding = view, finding
        self._centre, self._diameter = centre, diameter
        self.bursts: list[Burst] = []

    def add(self, tip: Tip, where: Where, wanted: tuple[float, float]) -> str:
        """Fire a burst; gives why it cannot be used, or nothing."""
        ear = self._view.ear(where)
        shots = tip.shots(SHOTS)
        angles = np.tile(angles_of(where), (SHOTS, 1))
        spot, aimed = ear.spots(np.array([angles[0], wanted]))
        around = ear.radius * float(wrapped(spot[0] - aimed[0]))
        off = np.full(SHOTS, np.hypot(around, spot[1] - aimed[1]))
        burst = average(shots, angles, off, most_off=_MOST_OFF)
        if not self.bursts and not burst.verdict:
            heard = choose_modality(shots, ear.radius - ear.probe.face, ear.speed)
            if heard != "sonar":
                burst = Burst(np.empty(0), 0.0, burst.angles, 0, SHOTS, float("nan"), "no coupling")
        self.bursts.append(burst)
        return burst.verdict

    def job(self, where: Where) -> dict[str, Any]:
        """What a worker has to know to fit it."""
        return {
            "finding": self._finding,
            "bursts": self.bursts,
            "ear": self._view.ear(where),
            "centre": self._centre,
            "diameter": self._diameter,
        }
