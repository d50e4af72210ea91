"""From an address to an actuator."""

from __future__ import annotations

from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator

TWINS = ("ipmc", "fibre")


def connect(
    address: str, *, specimen: int | None = None, noise: float = 0.0, seed: int = 0
) -> Actuator:
    """Connect to the actuator at an address.

    Parameters
    ----------
    address : str
        ``twin:ipmc`` or ``twin:fibre``, simulated actuators.
    specimen : int, optional
        Seed of the specimen; nominal parameters without it.
    noise : float
        Standard deviation of the sensor, in the unit of the output.
    seed : int
        Seed of the noise.

    Returns
    -------
    Actuator

    Raises
    ------
    ParameterError
        If there is nothing at the address, or an option is out of its range.
    """
    if address == "twin:ipmc":
        from minorloop.twins.ipmc import Ipmc

        return Ipmc(specimen, noise, seed)
    if address == "twin:fibre":
        from minorloop.twins.fibre import Fibre

        return Fibre(specimen, noise, seed)
    known = ", ".join(f"'twin:{name}'" for name in TWINS)
    raise ParameterError(f"there is nothing at address {address!r}; what exists is {known}")
