"""From an address to an actuator."""

from __future__ import annotations

import inspect
from importlib import import_module
from typing import Any

from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator

TWINS = ("ipmc", "fibre", "wire", "head", "catheter")


def connect(
    address: str,
    *,
    specimen: int | None = None,
    noise: float = 0.0,
    seed: int = 0,
    **options: Any,
) -> Actuator:
    """Connect to the actuator at an address.

    Parameters
    ----------
    address : str
        A simulated actuator: ``twin:ipmc``, ``twin:fibre``, ``twin:wire``, ``twin:head`` or
        ``twin:catheter``.
    specimen : int, optional
        Seed of the specimen; nominal parameters without it.
    noise : float
        Standard deviation of the sensor, in the unit of each output.
    seed : int
        Seed of the noise.
    **options
        What else the simulated actuator takes: ``tick`` and ``substeps`` all of them;
        ``drift`` all but the catheter; ``delay``, ``faults`` and ``log_truth`` the wire, the
        head and the catheter; ``surroundings`` and ``ageing`` the wire and the head.

    Returns
    -------
    Actuator

    Raises
    ------
    ParameterError
        If there is nothing at the address, or an option is unknown there or out of its range.
    """
    room, _, name = address.partition(":") if isinstance(address, str) else ("", "", "")
    if room == "twin" and name in TWINS:
        kind = getattr(import_module(f"minorloop.twins.{name}"), name.capitalize())
        _check_options(address, kind, options)
        twin: Actuator = kind(specimen, noise, seed, **options)
        return twin
    known = ", ".join(f"'twin:{name}'" for name in TWINS)
    raise ParameterError(f"there is nothing at address {address!r}; what exists is {known}")


def _check_options(address: str, kind: type, options: dict[str, Any]) -> None:
    """Refuse options that a twin does not take, naming those that it does."""
    parameters = inspect.signature(kind).parameters.values()
    allowed = [each.name for each in parameters if each.kind is each.KEYWORD_ONLY]
    for name in options:
        if name not in allowed:
            raise ParameterError(
                f"{address} has no option {name!r}; it takes specimen, noise, seed, "
                f"{', '.join(allowed)}"
            )
