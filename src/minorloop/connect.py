"""Connect to the actuator at an address.

An address is ``SCHEME:NAME``. Schemes are the entry points of the group ``minorloop.actuators``.
The names after ``twin:`` are the entry points of the group ``minorloop.twins``. Any installed
package can add to both.
"""

from __future__ import annotations

import inspect
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from minorloop.errors import ParameterError
from minorloop.lab.actuator import Actuator

SCHEMES, TWINS = "minorloop.actuators", "minorloop.twins"


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
        ``twin:catheter``. Or real instruments: ``visa:FILE``, a file that describes them as
        `minorloop.lab.drivers.visa` says. Installed packages can add schemes and simulated
        actuators; the entry point of a scheme is called with ``NAME`` and the options.
    specimen : int, optional
        Seed of the specimen; nominal parameters without it.
    noise : float
        Standard deviation of the sensor, in the unit of each output.
    seed : int
        Seed of the noise.
    **options
        Further options of what is at the address. All simulated actuators have ``tick`` and
        ``substeps``; all but the catheter have ``drift``; wire, head and catheter have ``delay``,
        ``faults`` and ``log_truth``; wire and head have ``surroundings`` and ``ageing``.

    Returns
    -------
    Actuator

    Raises
    ------
    ParameterError
        If there is nothing at the address, its driver cannot be loaded, or an option is unknown
        there or out of its range.
    MissingExtraError
        If what is asked for needs an extra that is not installed.
    InstrumentError
        If an instrument does not answer.
    """
    scheme, _, name = address.partition(":") if isinstance(address, str) else ("", "", "")
    schemes = _registered(SCHEMES)
    if scheme not in schemes or not name:
        raise ParameterError(_nothing_at(address))
    if scheme == "twin":
        return open_twin(name, specimen=specimen, noise=noise, seed=seed, **options)
    if specimen is not None or noise != 0 or seed != 0:
        raise ParameterError(f"{address} is no simulation; leave specimen, noise and seed out")
    opener = _loaded(schemes[scheme], address)
    _check_options(address, opener, options)
    opened: Actuator = opener(name, **options)
    return opened


def open_twin(
    name: str, *, specimen: int | None = None, noise: float = 0.0, seed: int = 0, **options: Any
) -> Actuator:
    """Make a simulated actuator.

    Parameters
    ----------
    name : str
        Name of an entry point of the group ``minorloop.twins``.
    specimen, noise, seed, **options
        As in `connect`.

    Returns
    -------
    Actuator

    Raises
    ------
    ParameterError
        If there is no such actuator, or it has no such option.
    """
    twins = _registered(TWINS)
    if name not in twins:
        raise ParameterError(_nothing_at(f"twin:{name}"))
    kind = _loaded(twins[name], f"twin:{name}")
    _check_options(f"twin:{name}", kind, options, ("specimen", "noise", "seed"))
    twin: Actuator = kind(specimen, noise, seed, **options)
    return twin


def addresses() -> list[str]:
    """Return the known addresses: each simulated actuator, and ``SCHEME:NAME`` for instruments.

    Those of installed packages are among them.
    """
    twins = [f"twin:{name}" for name in _registered(TWINS)]
    return [*twins, *(f"{name}:NAME" for name in _registered(SCHEMES) if name != "twin")]


def _registered(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def _loaded(point: EntryPoint, address: str) -> Any:
    try:
        return point.load()
    except ModuleNotFoundError as error:
        raise ParameterError(f"{address} needs {error.name}, which is not installed") from None
    except (ImportError, AttributeError) as error:
        raise ParameterError(f"the driver of {address} cannot be loaded: {error}") from None


def _nothing_at(address: object) -> str:
    known = ", ".join(f"'{each}'" for each in addresses())
    return f"there is nothing at address {address!r}; give one of {known}"


def _check_options(
    address: str, opener: Any, options: dict[str, Any], always: tuple[str, ...] = ()
) -> None:
    """Refuse options that are unknown at an address; the message names those that it takes."""
    parameters = inspect.signature(opener).parameters.values()
    allowed = [*always, *(each.name for each in parameters if each.kind is each.KEYWORD_ONLY)]
    for name in options:
        if name not in allowed:
            takes = f"it takes {', '.join(allowed)}" if allowed else "it takes none"
            raise ParameterError(f"{address} has no option {name!r}; {takes}")
