"""From an address to an actuator."""

from __future__ import annotations

from importlib import import_module

from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator

TWINS = ("ipmc", "fibre", "wire", "head", "catheter")


def connect(
    address: str, *, specimen: int | None = None, noise: float = 0.0, seed: int = 0
) -> Actuator:
    """Connect to the actuator at an address.

    Parameters
    ----------
    address : str
        A simulated actuator: ``twin:ipmc``, ``twin:fibre``, ``twin:wire``, ``twin:head`` or
        ``twin:catheter``. Or real instruments: ``visa:FILE``, a file that describes them as
        `minorloop.lab.drivers.visa` says.
    specimen : int, optional
        Seed of the specimen; nominal parameters without it.
    noise : float
        Standard deviation of the sensor, in the unit of each output.
    seed : int
        Seed of the noise.

    Returns
    -------
    Actuator

    Raises
    ------
    ParameterError
        If there is nothing at the address, or an option is out of its range.
    MissingExtraError
        If instruments are asked for and PyVISA is not installed.
    InstrumentError
        If an instrument does not answer.
    """
    room, _, name = address.partition(":")
    if room == "twin" and name in TWINS:
        kind = getattr(import_module(f"minorloop.twins.{name}"), name.capitalize())
        twin: Actuator = kind(specimen, noise, seed)
        return twin
    if room == "visa" and name:
        if specimen is not None or noise != 0:
            raise ParameterError("instruments are real; leave specimen and noise out")
        from minorloop.lab.drivers.visa import open_bench

        return open_bench(name)
    known = ", ".join(f"'twin:{name}'" for name in TWINS)
    raise ParameterError(
        f"there is nothing at address {address!r}; what exists is {known}, and 'visa:FILE' for "
        "instruments that a file describes"
    )
