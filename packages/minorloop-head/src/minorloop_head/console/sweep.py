"""A sweep of the wall from the console: the procedure, and the bursts of it.

It is begun about the place in the middle of the picture, and ends where the head was before. SCAN
is its mode: leaving it cuts the sweep, and what was fired until then is mapped. The camera process
has the probe.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.console.camera_protocol import CameraCommand
from minorloop_head.console.messages import Pair
from minorloop_head.console.plant import reading_at
from minorloop_head.console.scan import ScanRequest
from minorloop_head.console.units import Position, pair_of
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import Go, GoState
from minorloop_head.procedures.sweep import ProbeSweep, SweepState
from minorloop_head.procedures.values import Tip
from minorloop_head.ultrasound.wall_echoes import SweptBurst

AROUND, ALONG = math.radians(20.0), 1.5e-3
"""Largest distance around the pipe, in radians, and along it, in metres, from the place in the
middle: twice a pit of 1.5 mm, in a minute of the head."""
FARTHEST = 40e-3
"""Distance in metres from head to place beyond which the picture looks along the pipe."""
LOOK_AT_THE_WALL = (
    "a sweep maps the wall in the middle of the picture; look at a place of it that is at least "
    f"{1e3 * ALONG:g} mm from the start of the catheter and at most {1e3 * FARTHEST:g} mm ahead"
)


_HOMING = Go(patience=8.0)
"""Of the way back; at the end of its travel friction holds the catheter off."""
CUT = "it was stopped"
STOPPED = (
    "the sweep was stopped; what was fired is mapped; press Head or Track, and the head first goes "
    "back to where it was"
)


@dataclass(frozen=True, kw_only=True)
class ConsoleSweep:
    """A sweep in progress."""

    state: SweepState
    """Without bursts, which the camera process has."""
    home: Position
    """Where the head goes back to in the end: pan, tilt, advance and roll, in rad and m."""
    back: GoState | None = None
    """Of the way back, once it has begun."""
    waited: float = 0.0
    """Seconds since it began."""

    number = 0
    """Of no finding."""

    @property
    def stage(self) -> str:
        """Of the procedure, then ``back`` and ``done``."""
        if self.back is None:
            return "back" if self.state.done else self.state.stage
        return "done" if self.back.done else "back"

    @property
    def ending(self) -> CameraCommand:
        """The command that ends it: with 1 if the whole area was swept, with 0 otherwise."""
        return "end_sweep", [float(self.state.done and not self.state.trouble)]


def begin_sweep(
    view: HeadCalibration, position: Position, home: Position, control: HeadControl | None = None
) -> ConsoleSweep | None:
    """Return a sweep about the place in the middle of the picture; None if that is not the wall.

    In the end the head returns to ``home``. With the control of the head, a sweep that is out of
    reach in the water is done at once.

    Raises
    ------
    ParameterError
        If the area is not in the pipe.
    """
    camera = view.camera_at(position[2:])
    phi, z = np.asarray(camera.place(view.lens.centre, *position[:2])).tolist()
    if not ALONG <= z <= position[2] + FARTHEST:  # or it is not known
        return None
    area = (phi - AROUND, phi + AROUND), (z - ALONG, z + ALONG)
    state = ProbeSweep(calibration=view).begin(*area, control=control)
    return ConsoleSweep(state=state, home=home)


def cut(sweep: ConsoleSweep) -> ConsoleSweep:
    """Return a sweep that fires no longer and goes back; one that has ended as it is."""
    if sweep.state.done:
        return sweep
    return replace(sweep, state=replace(sweep.state, trouble=CUT, done=True))


def swept(
    sweep: ConsoleSweep, view: HeadCalibration, position: Position, command: Pair, interval: float
) -> tuple[ConsoleSweep, ScanRequest]:
    """Return the sweep after a tick and its request; ``command`` is the present one, in rad."""
    now, commands = reading_at(position, t=sweep.waited), list[CameraCommand]()
    sweep = replace(sweep, waited=sweep.waited + interval)
    if sweep.state.done:
        back = sweep.back
        if back is None:
            commands.append(sweep.ending)
            back = _HOMING.begin(place=sweep.home[2:], angles=sweep.home[:2])
        back, request = _HOMING.step(back, now)
        sweep = replace(sweep, back=back)
    else:
        state, request = ProbeSweep(calibration=view, tick=interval).step(sweep.state, now)
        sweep = replace(sweep, state=state)
        if request.water:
            commands.append(("begin_sweep", [*state.phi, *state.z]))
        if request.shots:
            commands.append(("fire_on", []))
    angles = command if request.angles is None else pair_of(request.angles)
    return sweep, ScanRequest(angles, pair_of(request.rates), tuple(commands))


class SweepEchoes:
    """Bursts of a sweep in progress.

    Parameters
    ----------
    view : HeadCalibration
    phi, z : (float, float)
        Ends of the area around and along the pipe, in radians and metres.
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
        """Fire a burst where they are now."""
        t, position = self._now
        shots = tuple(tip.shots(self._sweep.shots))
        reading = reading_at(position, t=t, shots=shots, fired=True)
        self.bursts.append(self._sweep.burst(self._last, reading))

    def job(self, *, whole: bool) -> dict[str, Any]:
        """Return the arguments of `minorloop_head.console.depth_work.sweep`.

        Parameters
        ----------
        whole : bool
            Whether the sweep was not cut.
        """
        return {
            "bursts": self.bursts,
            "probe": self._view.probe_at((0.0, 0.0)),
            "phi": self._phi,
            "z": self._z,
            "radius": self._view.radius,
            "whole": whole,
        }
