"""The speed of sound in water."""

from __future__ import annotations

import numpy as np

from minorloop.arrays import as_finite
from minorloop.errors import ParameterError


def sound_speed(temperature: float) -> float:
    """Return the speed of sound in pure water, in m/s.

    Parameters
    ----------
    temperature : float
        In degrees Celsius, from 0 to 95.

    Raises
    ------
    ParameterError
        If the temperature is out of that range.

    References
    ----------
    Marczak, Water as a standard in the measurements of speed of sound in liquids,
    J. Acoust. Soc. Am. 102, 2776, 1997, equation 1.
    """
    if not 0 <= as_finite("temperature of the water", temperature) <= 95:
        raise ParameterError(
            f"water at {temperature} degrees; give a temperature from 0 to 95 degrees Celsius"
        )
    terms = (2.787860e-9, -1.398845e-6, 3.287156e-4, -5.799136e-2, 5.038813, 1402.385)
    return float(np.polyval(terms, temperature))
