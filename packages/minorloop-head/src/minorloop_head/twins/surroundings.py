"""Surroundings of a wire over time, and the filling of a pipe, from which they follow.

The operator of the head does not know them; a study sets them as disturbances.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields, replace

import numpy as np

from minorloop.arrays import FloatArray, as_finite, check_option
from minorloop.errors import ParameterError

ATMOSPHERE = 101_325.0
"""Pressure at which the convection of a gas is given, in Pa."""

# Film coefficient in W/(m^2 K) of a 0.2 mm wire, and how it grows with the pressure. The
# exponents are those of Morgan, The overall convective heat transfer from smooth circular
# cylinders, 1975: Nu ~ Ra^0.148 in still gas (Ra ~ p^2), Nu ~ Re^0.384 in a stream. Other still
# gases differ from air by their conductivity k, and by their density, heat capacity and viscosity
# in Ra: k and density at 300 K are 0.0259, 0.0177, 0.152 W/(m K) and 1.12, 1.60, 0.163 kg/m^3, for
# air 0.0263 and 1.16. Liquids do not get thinner; a sleeve keeps them off.
_MEDIA = {
    "air": (75.0, 0.296),
    "nitrogen": (74.0, 0.296),
    "argon": (52.0, 0.296),
    "helium": (235.0, 0.296),
    "forced gas": (150.0, 0.384),
    "flooded": (2000.0, 0.0),
    "flooded, sleeved": (100.0, 0.0),
}
GASES = ("air", "nitrogen", "argon", "helium", "forced gas")
"""Media of `convection` that may fill a pipe above the water."""
_GIVEN_RISE = 50.0
"""Rise of the temperature of a wire, in K, for which its convection is stated: it moves then."""
_MOST_LOAD = 4e-3
"""Largest torque on a joint, in N m: the preload of the weakest spring still holds it."""
_MOST_SWAY = math.radians(10.0)
FULL = -0.9999
"""Height of the water in a full pipe, in radii; y points down."""


@dataclass(frozen=True)
class Course:
    """A quantity over the clock of the twin: it may change once, and oscillate from then on.

    Raises
    ------
    ParameterError
        If a number is not finite, the duration is negative or the period not positive.

    Examples
    --------
    >>> Course(20.0, 30.0, at=60.0, duration=10.0)(65.0)
    25.0
    """

    start: float
    """Value before the time ``at``."""
    end: float | None = None
    """Value after the change; ``start`` without it."""
    at: float = 0.0
    """Beginning of the change, in seconds."""
    duration: float = 0.0
    """Duration of the linear change from ``start`` to ``end``, in seconds; 0 is a step."""
    amplitude: float = 0.0
    """Amplitude of a sine added from ``at`` on."""
    period: float = 1.0
    """Period of that sine, in seconds."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            value = self.start if value is None else as_finite(field.name, value)
            object.__setattr__(self, field.name, value)
        if self.duration < 0:
            raise ParameterError(f"duration is {self.duration}; give at least 0 s")
        if self.period <= 0:
            raise ParameterError(f"period is {self.period}; give a positive number of seconds")

    def __call__(self, t: float) -> float:
        """Return the value at a time in seconds."""
        from minorloop_head.twins._kernels import course

        return float(course(self.numbers, float(t)))

    @property
    def numbers(self) -> FloatArray:
        """The six parameters, for the compiled loops."""
        return np.array([getattr(self, field.name) for field in fields(self)], dtype=np.float64)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and greatest value."""
        _, end, *_ = self.numbers.tolist()
        swing = abs(self.amplitude)
        swung = (self.start, end) if self.duration > 0 else (end,)
        low = min(self.start, *(value - swing for value in swung))
        return low, max(self.start, *(value + swing for value in swung))


@dataclass(frozen=True)
class Cooling:
    """Variation of the cooling of a wire in a head, and the body of the head that the wire warms.

    Raises a `ParameterError` if a value is out of its range.
    """

    exponent: float = 0.148
    """Exponent of the film coefficient over the rise of the wire's temperature: 0.148, by Morgan
    (1975) for still gas and Rayleigh numbers of 0.01 to 100; that of a wire of 0.2 mm is 0.03."""
    bend: float = 0.1
    """Growth of the film coefficient with the angle, in 1/rad. A wire of diameter d at a distance D
    from a wall loses heat as 1 / acosh(2 D / d) (Incropera, shape factors of conduction); a bent
    head brings it from 3 to 2 mm, which is 11 % at 60 degrees."""
    share: float = 0.5
    """Share of the surroundings of a wire that is the body of the head, the rest is ambient: a
    choice, for a wire along the outside of the body."""
    capacity: float = 6.0
    """Heat capacity of the body, in J/K: half of a cylinder of 12 by 30 mm of steel."""
    conductance: float = 0.0137
    """From the body to the ambient, in W/K: the surface of that cylinder times 11 W/(m^2 K) of
    natural convection and radiation."""

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("exponent", 0.0, 0.4, ""),
            ("bend", 0.0, 1.0, "1/rad"),
            ("share", 0.0, 1.0, ""),
            ("capacity", 0.1, 1e3, "J/K"),
            ("conductance", 1e-3, 10.0, "W/K"),
        ):
            _check(name, getattr(self, name), low, high, unit)


@dataclass(frozen=True)
class Surroundings:
    """Ambient, convection and load around a wire or a head.

    Raises
    ------
    ParameterError
        If a value is out of its range at any time.
    """

    ambient: float | Course = 20.0
    """Temperature far from the wire, in degrees Celsius, from -50 to 100."""
    convection: float | Course = 75.0
    """Film coefficient in W/(m^2 K), positive; ``convection`` gives it for a medium."""
    load: float | Course | tuple[float | Course, ...] = 0.0
    """Torque of the flow against the wire, in N m, up to 4 mN m in either direction; a single one
    acts on every axis."""
    cooling: Cooling | None = None
    """Variation of the cooling of the wires. Without it the film coefficient is constant over
    temperature and angle, and the body of the head stays at the ambient temperature."""

    def __post_init__(self) -> None:
        _check("ambient", self.ambient, -50.0, 100.0, "degrees Celsius")
        _check("convection", self.convection, 1.0, 20_000.0, "W/(m^2 K)")
        for load in self.load if isinstance(self.load, tuple) else (self.load,):
            _check("load", load, -_MOST_LOAD, _MOST_LOAD, "N m")

    def courses(self) -> FloatArray:
        """Return ambient and convection for the compiled loops, (2, 6)."""
        return np.array([_as_course(each).numbers for each in (self.ambient, self.convection)])

    def cooling_numbers(self) -> FloatArray:
        """Return the rise for which convection is stated, and the cooling, (6,)."""
        cooling = self.cooling or Cooling(exponent=0.0, bend=0.0, share=0.0)
        return np.array([_GIVEN_RISE, *astuple(cooling)])

    def loads(self, axes: int) -> FloatArray:
        """Return the load of each axis for the compiled loops, (axes, 6).

        Raises a `ParameterError` if the number of loads is neither one nor that of the axes.

        ``axes``: number of wires.
        """
        each = self.load if isinstance(self.load, tuple) else (self.load,) * axes
        if len(each) != axes:
            raise ParameterError(f"there are {len(each)} loads; give one, or {axes}, one an axis")
        return np.array([_as_course(load).numbers for load in each])


@dataclass(frozen=True)
class Sway:
    """Motion of the base of the head in a flow, one sine for each axis.

    Raises a `ParameterError` if the amplitude is out of its range.
    """

    amplitude: float = math.radians(1.0)
    """Amplitude in radians, up to 10 degrees."""
    pan: float = 0.3
    tilt: float = 0.23
    """Frequencies in Hz."""

    def __post_init__(self) -> None:
        if not 0 <= self.amplitude <= _MOST_SWAY:
            raise ParameterError(f"a sway of {self.amplitude} rad; give 0 to {_MOST_SWAY:.3f}")

    def at(self, t: float) -> FloatArray:
        """Return pan and tilt (2,) at a time in seconds."""
        phases = 2 * math.pi * t * np.array([self.pan, self.tilt])
        return np.asarray(self.amplitude * np.sin(phases))


@dataclass(frozen=True, kw_only=True)
class Filling:
    """Filling of a pipe: gas, and water below a level.

    Ambient and convection of the wires, speed of sound and sway follow from it.

    Raises a `ParameterError` if a value is out of its range.
    """

    level: float | None = None
    """Height of the water's surface in metres, with y pointing down from the axis; a pipe without
    it is dry."""
    temperature: float = 20.0
    """Temperature of water and gas, in degrees Celsius, from 0 to 95."""
    gas: str = "air"
    """One of `GASES`: still, but for ``forced gas``."""
    pressure: float = ATMOSPHERE
    """Pressure of gas and water, in Pa, as in `convection`."""
    sleeve: float = 1.0
    """Convection of this head's wires in their sleeves under water, over that of `convection`: 0.5
    to 2."""
    sway: Sway | None = None
    """Motion of the base of the head in the flow; none without it."""

    def __post_init__(self) -> None:
        _check("temperature of the filling", self.temperature, 0.0, 95.0, "degrees Celsius")
        _check("convection of the sleeve", self.sleeve, 0.5, 2.0, "")
        check_option("gas", self.gas, GASES)
        convection(self.gas, pressure=self.pressure)
        if self.level is not None:
            as_finite("level of the water", self.level)

    def around(self, other: Surroundings) -> Surroundings:
        """Return other surroundings of wires with ambient and convection of this filling.

        The wires lie about the axis of the pipe, sleeved: they are in water where the axis is.
        """
        wet = self.level is not None and self.level < 0
        film = (
            self.sleeve * convection("flooded, sleeved")
            if wet
            else convection(self.gas, pressure=self.pressure)
        )
        return replace(other, ambient=self.temperature, convection=film)


def convection(medium: str, *, pressure: float = ATMOSPHERE) -> float:
    """Return the film coefficient of a 0.2 mm wire in a medium.

    Parameters
    ----------
    medium : str
        One of `GASES`, ``flooded``, or ``flooded, sleeved``: a wire in a sleeve that keeps the
        liquid off.
    pressure : float
        Of the medium, in Pa, from 1 kPa to 10 MPa; gases cool better when they are dense.

    Returns
    -------
    float
        In W/(m^2 K).

    Raises
    ------
    ParameterError
        If there is no such medium, or the pressure is out of its range.
    """
    check_option("medium", medium, tuple(_MEDIA))
    if not 1e3 <= as_finite("pressure", pressure) <= 1e7:
        raise ParameterError(f"pressure is {pressure} Pa; give 1e3 to 1e7 Pa")
    film, power = _MEDIA[medium]
    return float(film * math.pow(pressure / ATMOSPHERE, power))


def _as_course(value: float | Course) -> Course:
    return value if isinstance(value, Course) else Course(value)


def _check(name: str, value: float | Course, low: float, high: float, unit: str) -> None:
    if not isinstance(value, Course):
        as_finite(name, value)
    least, most = _as_course(value).bounds
    if least < low or most > high:
        reach = f"{least:g}" if least == most else f"{least:g} to {most:g}"
        found = f"{reach} {unit}".rstrip()
        raise ParameterError(f"{name} is {found}; it must stay in [{low:g}, {high:g}]")
