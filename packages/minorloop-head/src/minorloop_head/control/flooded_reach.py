"""Angles that the wires of a head reach in water, predicted from their identification in air.

Under a current i, a wire that was identified at an ambient T_0 with a convection h_0 settles in
water of T with a convection c h_0 at the effective power i^2 / c + (T - T_0) / (rise resistance),
see `minorloop_head.control.hypotheses`. The resistance, over that of a hot wire, falls as it turns.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.control.guard import Guard
from minorloop_head.control.head import HeadControl
from minorloop_head.control.reach import STROKE_SHARE, ReachWatch

SLEEVED = 4.0 / 3.0
"""Convection of a wire in its sleeve under water over that at identification in still air: 100 and
75 W/(m^2 K)."""
SLEEVE_BAND = 0.04
"""Largest share by which the convection of a sleeve differs: its bore is 10 % wider or narrower."""
WATER_BAND = 0.6
"""Half of the 95 % band of the temperature of the water, in K: that of a thermometer."""
_ITERATIONS = 30
"""Of the fixed point for the resistance, whose error is halved by each."""


def flooded_reach(
    control: HeadControl, wanted: npt.ArrayLike, temperature: float, *, cooling: float = SLEEVED
) -> FloatArray:
    """Return the least and largest reading (axes, 2) of the joints in water, in degrees.

    Parameters
    ----------
    control : HeadControl
    wanted : (axes,) array_like
        Readings that are wanted, in degrees, which say where the other wires are.
    temperature : float
        Of the water, in degrees Celsius.
    cooling : float
        Convection over that at identification.
    """
    ends = np.array([_ends(axis, temperature, cooling) for axis in control.axes])
    return control.reach(wanted, ends)


def _ends(guard: Guard, temperature: float, cooling: float) -> tuple[float, float]:
    """Return the least and largest angle of a wire in degrees."""
    wire, limits = guard.observer.wire, guard.limits
    low, top = wire.operator.range
    strongest = min(guard.observer.highest**2 / cooling, limits.highest_power)
    least = float(wire.operator.levels[0])
    most = float(wire.operator.levels[-1])
    found = []
    for power, begin in ((0.0, wire.begin(most)), (strongest, wire.begin(least))):
        angle = begin.angle
        for _ in range(_ITERATIONS):
            cold = (top - angle) / (top - low)
            resistance = 1.0 - cold * (1.0 - ReachWatch.cold_resistance)
            bias = (temperature - limits.ambient) / (limits.rise * resistance)
            settled = wire.moved(begin, float(np.clip(power + bias, least, most)))
            angle = 0.5 * (angle + settled.angle)
        found.append(angle)
    return found[0], min(found[1], STROKE_SHARE * top)
