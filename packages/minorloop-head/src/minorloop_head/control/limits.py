"""Limits of a wire, and the highest temperature that it may have by its model.

The wire's temperature is not measured. It is estimated in two ways: from the heating power and the
identified lag, and from the effective power that explains the angle. The higher estimate counts,
with a margin for differences between wires.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from minorloop_head.control.controller import within
from minorloop_head.heated_wire import HeatedWire


@dataclass(frozen=True, kw_only=True)
class WireLimits:
    """Limits of a wire, and the values of its data sheet that they need.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    Notes
    -----
    The rise is that of a wire of 0.2 mm and 1.0e-6 ohm m in still air, 75 W/(m^2 K): 108 K at
    0.4 A.
    """

    hottest: float = 150.0
    """Temperature of the wire that is never exceeded, in degrees Celsius."""
    ambient: float = 20.0
    """Ambient temperature at the identification, in degrees Celsius."""
    rise: float = 676.0
    """Steady rise of the temperature for a heating power, in K per A^2: resistance over convection,
    both per metre."""
    margin: float = 1.15
    """Factor of at least 1 by which the rise of a wire may be higher."""
    preload: float = 2.2
    spring: float = 2500.0
    pulley: float = 2.87e-3
    diameter: float = 0.2e-3
    """Preload and rate of the spring in N and N/m, radius of pulley and diameter of wire in m."""
    stress: float = 172e6
    """Highest stress that the maker advises for a long life, in Pa; it is reported, not limited."""

    def __post_init__(self) -> None:
        within("hottest", self.hottest, -50.0, 150.0, "degrees Celsius")
        within("ambient", self.ambient, -50.0, self.hottest, "degrees Celsius")
        within("rise", self.rise, 1e-3, 1e6, "K/A^2")
        within("margin", self.margin, 1.0, 10.0)
        within("preload", self.preload, 0.0, 1e3, "N")
        within("spring", self.spring, 0.0, 1e6, "N/m")
        within("pulley", self.pulley, 1e-6, 1.0, "m")
        within("diameter", self.diameter, 1e-6, 0.1, "m")
        within("stress", self.stress, 0.0, 1e12, "Pa")

    @property
    def highest_power(self) -> float:
        """Effective power at the highest temperature, in A^2."""
        return (self.hottest - self.ambient) / (self.margin * self.rise)

    def temperature(self, effective: float) -> float:
        """Return the highest temperature of a wire with an effective power, in degrees Celsius.

        ``effective``: effective power, in A^2.
        """
        return self.ambient + self.margin * self.rise * max(effective, 0.0)

    def allowed(self, wire: HeatedWire, effective: float, bias: float, interval: float) -> float:
        """Return the highest power in A^2 that keeps the temperature limit for an interval.

        Latent heat is neglected: it would make the wire colder.

        ``effective``: its effective power now, in A^2; ``bias``: power that the surroundings add,
        in A^2; ``interval``: in seconds.
        """
        reserve = (self.highest_power - effective) * (wire.lag + interval) / interval
        return max(effective + reserve - bias, 0.0)

    def stressed(self, angle: float) -> bool:
        """Whether the spring loads the wire beyond the stress that its maker advises.

        ``angle``: in degrees.
        """
        compression = self.pulley * math.radians(max(angle, 0.0))
        area = 0.25 * math.pi * self.diameter**2
        return self.preload + self.spring * compression > self.stress * area
