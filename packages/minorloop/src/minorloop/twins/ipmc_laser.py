"""The ionic polymer strip as a laboratory sees it: through a laser displacement sensor.

A laser measures the distance to the strip at some height above the clamp. The curvature follows
from the geometry, which is known with an uncertainty.
"""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop.lab.curvature import displacement_from_curvature
from minorloop.twins.ipmc import Ipmc

DISTANCE = 30.0
"""Distance from the laser to the straight strip, in mm: a choice, the middle of its range."""
HEIGHT, HEIGHT_SD = 15.0, 0.1
"""Nominal height of the laser above the clamp and its standard deviation, in mm. The height is a
choice: three quarters of the strip of 20 mm. A calliper places the sensor to 0.1 mm."""
NOISE = 2.8e-3
"""Typical standard deviation of the distance, in mm: 2.8 mV of a sensor that gives 1 V for a
millimetre, or 0.025 1/m of curvature."""
CODE = 20.0 / 2**16
"""Step of the distance, in mm: that of a converter of 16 bits for 10 V to either side, as those of
the paper's DS1104, at 1 V for a millimetre."""


class IpmcLaser(Ipmc):
    """A strip measured by a laser: voltage in, distance to the strip in mm out.

    The strip bends towards the laser for positive voltages, which shortens the distance. The true
    height of a specimen's laser is drawn around the nominal 15 mm with a standard deviation of
    0.1 mm.

    ``specimen``, ``seed``, ``tick``, ``drift`` and ``substeps``: as in ``Ipmc``, with its errors;
    ``noise``: standard deviation of the measured distance, in mm; 0.0028 is typical.
    """

    kind = "ipmc-laser"
    outputs = (Channel("distance", "mm"),)

    def _sensed(self, y: FloatArray) -> FloatArray:
        height = HEIGHT
        if self.specimen is not None:
            height += HEIGHT_SD * float(np.random.default_rng([self.specimen, 1]).normal())
        metres = displacement_from_curvature(y, DISTANCE * 1e-3, height * 1e-3)
        return CODE * np.round(super()._sensed(metres * 1e3) / CODE)
