"""The head by its camera alone: identification, steps and a circle on the wall, as in the paper.

The paper's head has no sensor at its joints. Here too everything is read from pictures, with the
errors that a calibration leaves; only the scores use the true angles.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, Levels
from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.head.control.heating import (
    HeatedIdentification,
    identify_coupling,
    identify_heating,
    moving_levels,
)
from minorloop.head.control.head import HeadControl, head_control
from minorloop.head.control.sensing import SensorWatch
from minorloop.head.studies.head_loop import TICK, HeadRun, constant, run_loop
from minorloop.head.studies.head_static import BANDS, COMMAND, CURRENT, FIRST_LOOP, HOLD, STEP
from minorloop.head.studies.picture_sensor import AGE, PictureSensor
from minorloop.head.studies.scoring import truth
from minorloop.head.twins.head import Head
from minorloop.identification import excitation

STEPS = (20.0, 30.0, 40.0)
STEP_SECONDS = 30.0
PICTURES = 3
"""Pictures at the end of a hold: their mean has half the noise of one, at little cost."""


@dataclass(frozen=True, eq=False)
class SeenWires:
    """Wires that were identified by the camera alone.

    Parameters
    ----------
    found : tuple of HeatedIdentification
        Of pan and tilt.
    coupling : (2, 2) array
    lost : int
        Holds at whose end no picture showed the angles.
    """

    found: tuple[HeatedIdentification, HeatedIdentification]
    coupling: FloatArray
    lost: int

    @property
    def wires(self) -> tuple[HeatedWire, HeatedWire]:
        return self.found[0].model, self.found[1].model


def identify_seen(seed: int) -> SeenWires:
    """Identify both wires of one specimen from pictures."""
    sensor = PictureSensor(Head(seed), seed)
    found, moves, lost = [], [], 0
    for axis in range(2):
        up = np.linspace(0.0, CURRENT, FIRST_LOOP)
        loop = np.concatenate([up, up[-2::-1]])
        seen = _settled(sensor, axis, loop, follow=True)
        good = np.isfinite(seen[:, axis])
        levels: Levels = moving_levels(loop[good], seen[good, axis], BANDS)
        holds = excitation.reversal_curves(levels)
        readings = _settled(sensor, axis, holds)
        step = _step(sensor, axis)
        found.append(identify_heating(holds, readings[:, axis], step=step, levels=levels))
        lost += int(np.isnan(readings[:, axis]).sum() + (~good).sum())
        moves.append(readings[np.isfinite(readings).all(axis=1)].T)
    return SeenWires((found[0], found[1]), identify_coupling(moves), lost)


def _settled(
    sensor: PictureSensor, axis: int, currents: FloatArray, *, follow: bool = False
) -> FloatArray:
    """Return the angles (n, 2) in degrees at the ends of holds of one axis, the other one cold."""
    inputs = np.zeros((currents.size, 2))
    inputs[:, axis] = currents
    return np.array([sensor.hold(u, HOLD, PICTURES, follow=follow) for u in inputs])


def _step(sensor: PictureSensor, axis: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, currents and angles of a step to full current and back, at the video rate."""
    on, off, end = STEP
    t = np.arange(0.0, end, TICK)
    current = np.where((t >= on) & (t < off), CURRENT, 0.0)
    u, seen = np.zeros(2), [sensor.look()[axis]]
    for now in current[:-1]:
        u[axis] = now
        sensor.exchange(u)
        seen.append(sensor.latest[axis])
    angle = np.array(seen)
    known = np.isfinite(angle)
    return t[known], current[known], angle[known]
