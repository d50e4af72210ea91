"""A sweep of the wall from the console: the procedure, and the bursts of it.

It is begun about the place in the middle of the picture. SCAN is its mode: leaving it ends the
sweep, and what was fired until then is mapped. The camera process has the probe.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.console.camera_protocol import CameraCommand
from minorloop.head.console.messages import Pair
from minorloop.head.console.plant import reading_at
from minorloop.head.console.scan import ScanRequest
from minorloop.head.console.units import Position
from minorloop.head.control.head import HeadControl
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.sweep import ProbeSweep, SweepState
from minorloop.head.procedures.values import Tip
from minorloop.head.ultrasound.c_scan import SweptBurst

AROUND, ALONG = math.radians(20.0), 1.5e-3
"""Largest distance around the pipe, in radians, and along it, in metres, from the place in the
middle: twice a pit of 1.5 mm, in a minute of the head."""
FARTHEST = 40e-3
"""Distance in metres from head to place beyond which the picture looks along the pipe."""
LOOK_AT_THE_WALL = (
    "a sweep maps the wall in the middle of the picture; look at a place of it that is at least "
    f"{1e3 * ALONG:g} mm from the start of the catheter and at most {1e3 * FARTHEST:g} mm ahead"
)


@dataclass(frozen=True, kw_only=True)
class ConsoleSweep:
    """A sweep in progress.

    Parameters
    ----------
    state : SweepState
        Without bursts, which the camera process has.
    waited : float
        Seconds since it began.
    """

    state: SweepState
    waited: float = 0.0

    number = 0
    """Of no finding."""

    @property
    def stage(self) -> str:
        """Of the procedure, or ``done``."""
        return "done" if self.state.done else self.state.stage


def begin_sweep(
    view: HeadCalibration, position: Position, control: HeadControl | None = None
) -> ConsoleSweep | None:
    """Return a sweep about the place in the middle of the picture; None if that is not the wall.

    With the control of the head, a sweep that is out of reach in the water is done at once.
    """
    camera = view.camera_at(position[2:])
    phi, z = np.asarray(camera.place(view.lens.centre, *position[:2])).tolist()
    if not ALONG <= z <= position[2] + FARTHEST:  # or it is not known
        return None
    area = (phi - AROUND, phi + AROUND), (z - ALONG, z + ALONG)
    return ConsoleSweep(state=ProbeSweep(calibration=view).begin(*area, control=control))


def swept(
    sweep: ConsoleSweep, view: HeadCalibration, position: Position, command: Pair, interval: float
) -> tuple[ConsoleSweep, ScanRequest]:
    """Return the sweep after a tick and its request; ``command`` is the present one, in rad."""
    procedure = ProbeSweep(calibration=view, tick=interval)
    state, request = procedure.step(sweep.state, reading_at(position, t=sweep.waited))
    commands: list[CameraCommand] = []
    if request.water:
        commands.append(("begin_sweep", list(state.z)))
    if request.shots:
        commands.append(("fire_on", []))
    angles = command if request.angles is None else _pair(request.angles)
    after = replace(sweep, state=state, waited=sweep.waited + interval)
    return after, ScanRequest(angles, _pair(request.rates), tuple(commands))


class SweepEchoes:
    """Bursts of a sweep in progress.

    Parameters
    ----------
    view : HeadCalibration
    z : (float, float)
        Ends of the area along the pipe, in metres.
    """

    def __init__(self, view: HeadCalibration, z: Pair) -> None:
        self._view, self._z = view, z
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
        """Fire a burst where they are now."""
        t, position = self._now
        shots = tuple(tip.shots(self._sweep.shots))
        reading = reading_at(position, t=t, shots=shots, fired=True)
        self.bursts.append(self._sweep.burst(self._last, reading))

    def job(self) -> dict[str, Any]:
        """Return the arguments of `minorloop.head.console.depth_work.sweep`."""
        probe = self._view.probe_at((0.0, 0.0))
        return {"bursts": self.bursts, "probe": probe, "z": self._z, "radius": self._view.radius}


def _pair(values: FloatArray) -> Pair:
    return float(values[0]), float(values[1])
