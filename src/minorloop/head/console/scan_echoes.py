"""The echoes of a scan of a finding, collected point by point."""

from __future__ import annotations

from typing import Any

from minorloop.arrays import FloatArray
from minorloop.head.console.messages import Pair
from minorloop.head.console.units import Position
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.procedures.values import Tip
from minorloop.head.ultrasound.echoes import Burst


class ScanEchoes:
    """Bursts of a scan in progress.

    Parameters
    ----------
    view : HeadCalibration
    finding : int
        Its number.
    centre : (float, float)
        Phi in radians and z in metres by the camera.
    diameter : float
        By the camera, in metres.
    """

    def __init__(self, view: HeadCalibration, finding: int, centre: Pair, diameter: float) -> None:
        self._view, self._finding = view, finding
        self._centre, self._diameter = centre, diameter
        self._scan = RasterScan(calibration=view)
        self._reference: FloatArray | None = None
        self.bursts: list[Burst] = []

    def fire(self, tip: Tip, position: Position, wanted: Pair) -> str:
        """Fire and keep a burst, and return why it is unusable, or an empty text.

        ``wanted`` is the pan and tilt that the scan requested, in rad.
        """
        shots, place, first = tip.shots(self._scan.shots), position[2:], not self.bursts
        if self._reference is None:
            self._reference = self._scan.rolled(self._centre[0], place)
        burst = self._scan.burst(shots, position[:2], wanted, place, self._reference, first=first)
        self.bursts.append(burst)
        return burst.verdict

    def job(self) -> dict[str, Any]:
        """Return the arguments of `minorloop.head.console.depth_work.depth`."""
        return {
            "finding": self._finding,
            "bursts": self.bursts,
            "probe": self._view.probe_at(
                (0.0, 0.0) if self._reference is None else self._reference
            ),
            "centre": self._centre,
            "diameter": self._diameter,
        }
