"""Heads in water: the angles that their wires truly reach, and whether these do for a raster."""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Probe
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import FULL, Filling, Surroundings
from minorloop_head.ultrasound.pits import raster
from papers.catheter import scoring

TEMPERATURES = (10.0, 20.0, 30.0, 40.0)
"""Of the water, in degrees Celsius."""


def water(temperature: float) -> Surroundings:
    """Return the surroundings of sleeved wires in a flooded pipe at a temperature."""
    view = _calibration(Probe())
    return Filling(level=FULL * view.radius, temperature=temperature).around(Surroundings())


def needed(probe: Probe | None = None) -> FloatArray:
    """Return the least and largest reading (2, 2) of the joints in a raster, in degrees.

    The raster of a probe that is given is bent alone, from a catheter that stays, square to the
    wall at a tilt of 0; otherwise it is that of the default probe, whose rows are rolled.
    """
    view = _calibration(probe or Probe())
    if probe is None:
        pairs = RasterScan(calibration=view).needs.T
    else:
        square = probe.perpendicular(view.mount_at(np.zeros(2)), 0.0)
        phi, z = view.probe_at(np.zeros(2)).spots([[square, 0.0]])[0, :2].tolist()
        pairs = raster(view.probe_at(np.zeros(2)), (phi, z))
    joints = np.array([view.joints(pair) for pair in pairs])
    return np.stack([joints.min(axis=0), joints.max(axis=0)], axis=1)


def reach_figures(seed: int) -> dict[str, float]:
    """Return, for each temperature of the water, whether a head reaches its raster (1 or 0).

    A raster that is reached is reached everywhere in the pipe: the catheter rolls and advances.
    """
    needs = needed()
    return {
        f"at_{temperature:.0f}_c": float(scoring.reaches(Head(seed), water(temperature), needs))
        for temperature in TEMPERATURES
    }


def _calibration(probe: Probe) -> HeadCalibration:
    """Return the calibration of a nominal head with a probe."""
    return HeadCalibration(lens=LENS, leds=np.empty((0, 3)), probe=probe)
