"""Convert bending curvature to laser displacement, the inverse of `conversion.LaserCurvature`.

A strip is clamped at one end. At height ``h0`` above the clamp a laser measures the distance
``d`` to it; ``d0`` is the distance to the plane in which the strip stands when it is straight.
A strip of constant curvature is an arc of a circle of radius 1/kappa that leaves the clamp
along that plane, so with x = d0 - d the point (x, h0) is on it: (x - 1/kappa)^2 + h0^2 =
1/kappa^2, which gives kappa = 2 x / (x^2 + h0^2), positive towards the sensor.

References
----------
Chen, Tan and Shahinpoor, Quasi-static positioning of ionic polymer-metal composite actuators,
2005, figure 3. The expression printed there is the radius of curvature, not the curvature.
"""

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError


def displacement_from_curvature(
    kappa: npt.ArrayLike, d0: float, h0: float, *, length: float = 0.02
) -> FloatArray:
    """Distance that a laser measures to a strip of given curvature.

    Raises a `SignalError` if a curvature is not finite, or so large that the laser spot misses the
    strip; a `ParameterError` if ``d0``, ``h0`` or ``length`` is not a length.

    The distance has the shape of ``kappa``, in metres.

    ``kappa``: curvature in 1/m; ``d0`` and ``h0``: distance to the straight strip, and height of
    the laser above the clamp, in metres; ``length``: free length of the strip, in metres.
    """
    if not np.isfinite(d0):
        raise ParameterError(f"d0 is {d0}; give a finite distance in m")
    for name, value in (("h0", h0), ("length", length)):
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(f"{name} is {value}; give a positive length in m")
    curvature = np.asarray(kappa, dtype=np.float64)
    _refuse(~np.isfinite(curvature), curvature, "kappa is {}; every sample must be finite")
    _refuse(
        np.abs(curvature) * h0 > 1,
        curvature,
        f"curvature {{}} 1/m is beyond 1/h0 = {1 / h0:g} 1/m: the strip ends below the laser",
    )
    # sinc form: the arc up to the laser, asin(|kappa| h0) / |kappa|, without 0/0 when straight.
    angle = np.arcsin(np.abs(curvature) * h0)
    arc = h0 / np.sinc(angle / np.pi)
    _refuse(
        arc > length,
        curvature,
        f"at curvature {{}} 1/m a strip of {length:g} m does not reach the laser at {h0:g} m",
    )
    # (1 - sqrt(1 - (kappa h0)^2)) / kappa without cancellation at small curvature.
    x = curvature * h0**2 / (1 + np.sqrt(1 - (curvature * h0) ** 2))
    return np.asarray(d0 - x)[()]


def _refuse(bad: npt.NDArray[np.bool_], values: FloatArray, message: str) -> None:
    """Raise an error for the first bad value."""
    if np.any(bad):
        index = int(np.argmax(np.ravel(bad)))
        where = f" (index {index})" if np.ndim(values) else ""
        raise SignalError(message.format(f"{np.ravel(values)[index]:g}") + where)
