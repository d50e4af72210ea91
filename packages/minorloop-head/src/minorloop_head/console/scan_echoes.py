"""The echoes of a scan of a finding, point by point, and of a sweep, burst by burst."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.console.messages import Pair
from minorloop_head.console.plant import reading_at
from minorloop_head.console.units import Position
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.scan import SHOTS, RasterScan, has_coupling
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.procedures.sweep import SHOTS as SWEEP_SHOTS
from minorloop_head.procedures.sweep import ProbeSweep
from minorloop_head.procedures.values import Tip
from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.wall_echoes import SweptBurst
from minorloop_head.vision.calibrated_camera import Image

_PATIENCE = 0.5
"""Longest wait in seconds for a picture of the pose of a burst: more than the latency of a usual
camera."""


@dataclass(frozen=True, eq=False)
class _Fired:
    """A burst with its time, the position of joints and catheter, and their wanted position."""

    t: float
    shots: list[Shot]
    position: Position
    wanted: Pair


class ScanEchoes:
    """Bursts of a scan in progress, each with the pose that the pictures show.

    ``finding``: its number; ``centre``: phi in radians and z in metres by the camera; ``diameter``:
    by the camera, in metres.
    """

    def __init__(self, view: HeadCalibration, finding: int, centre: Pair, diameter: float) -> None:
        self._view, self._finding = view, finding
        self._centre, self._diameter = centre, diameter
        self._scan = RasterScan(calibration=view)
        self._base = SeenBase(view)
        self._fired: _Fired | None = None
        self._reference: FloatArray | None = None
        self.bursts: list[Burst] = []

    @property
    def begun(self) -> bool:
        """Whether there is a picture of the drained pipe, in which nothing sways the head."""
        return self._base.begun

    @property
    def why(self) -> str:
        """Reason why the last picture did not show the turn of the head; empty if it did."""
        return self._base.why

    @property
    def waiting(self) -> bool:
        """Whether a picture is needed now."""
        return not self.begun or self._fired is not None

    def read(self, t: float, position: Position) -> None:
        """Store the position of joints and catheter at a time in seconds."""
        self._base.read(t, position[:2], position[2:])

    def see(self, image: Image, t: float) -> None:
        """Use a picture under all lights that was taken at a time; the first is of a drained pipe.

        ``image`` (height, width); ``t``: in seconds.
        """
        if self.begun:
            self._base.see(image, t)
        else:
            self._base.begin(image, t)

    def fire(self, tip: Tip, t: float, position: Position, wanted: Pair) -> None:
        """Fire a burst at a time in seconds, at a position, for a wanted pan and tilt."""
        self._fired = _Fired(t, tip.shots(SHOTS), position, wanted)

    def arrived(self, t: float) -> str | None:
        """Return the verdict of the last burst; None until pictures show its pose.

        A burst whose pose is not seen in time is dropped.

        ``t``: now, in seconds.
        """
        fired = self._fired
        if fired is None:
            return None
        base = self._base.at(fired.t)
        if np.isfinite(base).all():
            self._fired = None
            return self._kept(fired, np.add(fired.position[:2], base))
        if t - fired.t < _PATIENCE:
            return None
        self._fired = None
        return f"pose not seen: {self.why}"

    def _kept(self, fired: _Fired, angles: FloatArray) -> str:
        """Keep a burst with its line of sight, and return why it is unusable, or empty."""
        place, coupled = fired.position[2:], has_coupling(self.bursts)
        if self._reference is None:
            self._reference = self._scan.rolled(self._centre[0], place)
        about = fired.wanted, place, self._reference
        burst = self._scan.burst(fired.shots, angles, *about, coupled=coupled)
        self.bursts.append(burst)
        return burst.verdict

    def job(self) -> dict[str, Any]:
        """Return the arguments of `minorloop_head.console.depth_work.depth`."""
        return {
            "finding": self._finding,
            "bursts": self.bursts,
            "probe": self._view.probe_at(
                (0.0, 0.0) if self._reference is None else self._reference
            ),
            "centre": self._centre,
            "diameter": self._diameter,
        }


class SweepEchoes:
    """Bursts of a sweep in progress.

    ``phi`` and ``z``: ends of the area around and along the pipe, in radians and metres.
    """

    def __init__(self, view: HeadCalibration, phi: Pair, z: Pair) -> None:
        self._view, self._phi, self._z = view, phi, z
        self._sweep = ProbeSweep(calibration=view)
        self._last: tuple[float, FloatArray] = (0.0, np.full(2, np.nan))
        self._now: tuple[float, Position] = (0.0, (0.0, 0.0, 0.0, 0.0))
        self.bursts: list[SweptBurst] = []

    def read(self, t: float, position: Position) -> None:
        """Note where joints and catheter are at a time in seconds."""
        before, place = self._now
        self._last = before, np.array(place[2:])
        self._now = t, position

    def fire(self, tip: Tip) -> None:
        """Fire a burst at the present position."""
        t, position = self._now
        shots = tuple(tip.shots(SWEEP_SHOTS))
        reading = reading_at(position, t=t, shots=shots, fired=True)
        self.bursts.append(self._sweep.burst(self._last, reading))

    def job(self, *, whole: bool) -> dict[str, Any]:
        """Return the arguments of `minorloop_head.console.depth_work.sweep`.

        ``whole``: whether the sweep was complete.
        """
        return {
            "bursts": self.bursts,
            "probe": self._view.probe_at((0.0, 0.0)),
            "phi": self._phi,
            "z": self._z,
            "radius": self._view.radius,
            "whole": whole,
        }
