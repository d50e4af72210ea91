"""The ionic polymer strip as a laboratory sees it: through a laser displacement sensor.

A laser measures the distance to the strip at some height above the clamp; a converter of 16 bits
samples its voltage. The curvature follows from the geometry, which is known with an uncertainty.
"""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop.lab.curvature import displacement_from_curvature
from minorloop.twins.ipmc import Ipmc

HEIGHT, HEIGHT_SD = 0.015, 1e-4
"""Nominal height of the laser above the clamp and its standard deviation, in metres. The height is
a choice: three quarters of the strip of 20 mm. A calliper places the sensor to 0.1 mm."""
VOLTS_PER_METRE = 1000.0
"""Sensitivity: 10 V for 10 mm, as common triangulation sensors have."""
NOISE = 2.8e-3
"""Typical standard deviation of the voltage, in V: 2.8 um, or 0.025 1/m."""
CODE = 20.0 / 2**16
"""Step of the converter, in V: 16 bits for plus and minus 10 V, as those of the paper's DS1104."""


class IpmcLaser(Ipmc):
    """A strip measured by a laser: voltage in, voltage of the laser sensor out.

    The sensor gives 1 V for each millimetre that the strip moves towards it; 0 V is the straight
    strip. The true height of a specimen's laser is drawn around the nominal 15 mm with a standard
    deviation of 0.1 mm.

    Parameters
    ----------
    specimen, seed, tick, drift, substeps
        As in ``Ipmc``.
    noise : float
        Standard deviation of the measured voltage, in V; 0.0028 is typical.

    Raises
    ------
    ParameterError
        If an option is out of range.
    """

    kind = "ipmc-laser"
    outputs = (Channel("laser", "V"),)

    def _sensed(self, y: FloatArray) -> FloatArray:
        height = HEIGHT
        if self.specimen is not None:
            height += HEIGHT_SD * float(np.random.default_rng([self.specimen, 1]).normal())
        towards = -displacement_from_curvature(y, 0.0, height)
        return CODE * np.round(super()._sensed(VOLTS_PER_METRE * towards) / CODE)
