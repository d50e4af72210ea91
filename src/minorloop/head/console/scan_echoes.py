"""The echoes of one finding, point by point, until they are fitted."""

from __future__ import annotations

from typing import Any

from minorloop.head.console.plant import PlantView, Where, angles_of
from minorloop.head.procedures.measure import burst_of
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.procedures.values import Tip
from minorloop.head.ultrasound.echoes import Burst


class ScanEchoes:
    """A scan that is going on.

    Parameters
    ----------
    view : PlantView
    finding : int
        Its number.
    centre : (float, float)
        Phi in radians and z in metres by the camera.
    diameter : float
        By the camera, in metres.
    """

    def __init__(
        self, view: PlantView, finding: int, centre: tuple[float, float], diameter: float
    ) -> None:
        self._view, self._finding = view, finding
        self._centre, self._diameter = centre, diameter
        self.bursts: list[Burst] = []

    def add(self, tip: Tip, where: Where, wanted: tuple[float, float]) -> str:
        """Fire a burst; gives why it cannot be used, or nothing."""
        shots, ear = tip.shots(RasterScan.shots), self._view.ear(where)
        burst = burst_of(shots, angles_of(where), wanted, ear, first=not self.bursts)
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
