"""Connect to the actuator at an address.

An address is ``SCHEME:NAME``. Schemes are the entry points of the group ``minorloop.actuators``.
The names after ``twin:`` are the entry points of the group ``minorloop.twins``. Any installed
package can add to both.
"""

import inspect
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from minorloop.errors import InstrumentError, MinorloopError, ParameterError
from minorloop.lab.actuator import Actuator
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.signals import Deferred, ended_by_signals
from minorloop.lab.wrapped_actuator import LimitedActuator
from minorloop.registry import loaded, registered
from minorloop.values import parsed, plain

_SCHEMES, _TWINS = "minorloop.actuators", "minorloop.twins"


def connect(
    address: str, *, specimen: int | None = None, noise: float = 0.0, seed: int = 0, **options: Any
) -> Actuator:
    """Connect to the actuator at an address.

    Raises a `ParameterError` if there is nothing at the address, its driver cannot be loaded, or an
    option is unknown there or out of its range; a `MissingExtraError` if the actuator needs an
    extra that is not installed; an `InstrumentError` if an instrument does not answer.

    Parameters
    ----------
    address : str
        A simulated actuator, such as ``twin:ipmc`` or ``twin:fibre``; `addresses` names those of
        installed packages too. Or real instruments: ``bench:FILE``, a file that describes them as
        `minorloop.lab.drivers.bench_file` says (``visa:FILE`` for one channel), or
        ``module:package.factory``, see `open_module`. Installed packages can add schemes and
        simulated actuators; the entry point of a scheme is called with ``NAME`` and the options.
        If it has an option ``specimen``, it is a simulation and gets specimen, noise and seed
        too. Options may be in the address, such as ``twin:ipmc,specimen=3,noise=0.05``, and are
        used instead of those that are parameters.
    specimen : int, optional
        Seed of the specimen; nominal parameters without it.
    noise : float
        Standard deviation of the sensor, in the unit of each output.
    seed : int
        Seed of the noise.
    **options
        Further options of the actuator. Strip and fibre have ``tick``, ``substeps`` and
        ``drift``.

    Examples
    --------
    >>> [str(one) for one in ml.connect("twin:ipmc,specimen=3").inputs]
    ['voltage [V]']
    """
    given = {"specimen": specimen, "noise": noise, "seed": seed, **options}
    if not isinstance(address, str):
        raise ParameterError(_nothing_at(address))
    address, written = split_address(address)
    given |= written
    scheme, _, name = address.partition(":")
    schemes = registered(_SCHEMES)
    if scheme not in schemes or not name:
        raise ParameterError(_nothing_at(address))
    opener = loaded(schemes[scheme], address)
    if not _simulates(opener):
        simulated = [given.pop(name) for name in ("specimen", "noise", "seed")]
        if any(value not in (None, 0) for value in simulated):
            raise ParameterError(f"{address} is not simulated; leave specimen, noise and seed out")
    _check_options(address, opener, given)
    actuator: Actuator = opener(name, **given)
    return actuator


@contextmanager
def opened(
    address: str, *, say: Callable[[str], object] = lambda warning: None, **options: Any
) -> Iterator[Actuator]:
    """Yield the actuator at an address; close its instruments at the end.

    A signal that ends the process raises an exception inside, never within a line to an
    instrument. ``say`` is called with each warning; other arguments and errors are as in `connect`.
    """
    with ended_by_signals(exiting=True):
        actuator = connect(address, **options)
        try:
            for warning in getattr(actuator, "warnings", ()):
                say(f"! {warning}")
            yield actuator
        finally:
            with Deferred():
                getattr(actuator, "close", lambda: None)()


def split_address(text: str) -> tuple[str, dict[str, Any]]:
    """Return an address without its options, and the options by name."""
    value = parsed(text)
    address = ":".join(filter(None, (value.kind, value.what)))
    return address, {name: plain(option) for name, option in value.options.items()}


def is_simulated(address: str) -> bool:
    """Return whether the actuator at an address takes a specimen, noise and seed."""
    schemes, scheme = registered(_SCHEMES), address.partition(":")[0]
    return scheme in schemes and _simulates(loaded(schemes[scheme], address))


def _simulates(opener: Callable[..., Actuator]) -> bool:
    return "specimen" in inspect.signature(opener).parameters


def open_twin(
    name: str, *, specimen: int | None = None, noise: float = 0.0, seed: int = 0, **options: Any
) -> Actuator:
    """Make a simulated actuator.

    Raises a `ParameterError` if there is no such actuator, or it has no such option.

    ``name``: name of an entry point of the group ``minorloop.twins``; ``specimen``, ``noise``,
    ``seed``, ``**options`` are as in `connect`.
    """
    twins = registered(_TWINS)
    if name not in twins:
        raise ParameterError(_nothing_at(f"twin:{name}"))
    kind = loaded(twins[name], f"twin:{name}")
    _check_options(f"twin:{name}", kind, options, ("specimen", "noise", "seed"))
    twin: Actuator = kind(specimen, noise, seed, **options)
    return twin


def open_module(name: str) -> Actuator:
    """Return the actuator that a function of a Python module makes.

    A `Bench` is first made safe and read; any other actuator is restricted to the limits of its
    channels. Raises a `ParameterError` if there is no such function, or it does not return an
    actuator; an `InstrumentError` if it fails.

    ``name``: ``package.factory``, or ``package.factory:ARGUMENT`` for a factory with an argument.
    The package is installed, or in the current folder.
    """
    path, colon, argument = name.partition(":")
    made = _made(factory(path), path, [argument] if colon else [])
    if isinstance(made, Bench):
        try:
            made.check()
        except BaseException:
            made.close()
            raise
        return made
    try:
        return LimitedActuator(made)
    except ParameterError as error:
        raise ParameterError(f"module:{name}: {error}") from None


def factory(path: str) -> Callable[..., Any]:
    """Return a function by its module and name, such as ``package.function``.

    The current folder is searched last, also in other processes of a program.

    Raises a `ParameterError` if there is no such function; an `InstrumentError` if its module
    fails.
    """
    module, _, function = path.rpartition(".")
    remedy = "give module:PACKAGE.FUNCTION of an installed package or a file in this folder"
    if not module:
        raise ParameterError(f"module:{path} has no function of a module; {remedy}")
    folder = os.getcwd()
    if folder not in sys.path:
        sys.path.append(folder)
    try:
        found = getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError, SyntaxError) as error:
        if isinstance(error, ModuleNotFoundError) and not f"{module}.".startswith(f"{error.name}."):
            remedy = f"install {error.name}, which it imports"
        raise ParameterError(f"module:{path} cannot be loaded: {error}; {remedy}") from None
    except (Exception, SystemExit) as error:
        raise InstrumentError(f"module:{path} cannot be loaded: {_said(error)}") from error
    if not callable(found):
        raise ParameterError(f"module:{path} is no function")
    made: Callable[..., Any] = found
    return made


def _made(make: Callable[..., Any], path: str, given: list[str]) -> Any:
    try:
        return make(*given)
    except MinorloopError:
        raise
    except (Exception, SystemExit) as error:
        raise InstrumentError(f"module:{path} failed: {_said(error)}") from error


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


def addresses() -> list[str]:
    """Return the known addresses: each simulated actuator, and ``SCHEME:NAME`` for instruments.

    Those of installed packages are among them.
    """
    twins = [f"twin:{name}" for name in registered(_TWINS)]
    return [*twins, *(f"{name}:NAME" for name in registered(_SCHEMES) if name != "twin")]


def _nothing_at(address: object) -> str:
    known = ", ".join(f"'{each}'" for each in addresses())
    return f"there is nothing at address {address!r}; give one of {known}"


def _check_options(
    address: str, opener: Any, options: dict[str, Any], always: tuple[str, ...] = ()
) -> None:
    """Refuse unknown options, unless the opener has ``**options`` and checks them itself."""
    parameters = inspect.signature(opener).parameters.values()
    if any(each.kind is each.VAR_KEYWORD for each in parameters):
        return
    allowed = [*always, *(each.name for each in parameters if each.kind is each.KEYWORD_ONLY)]
    for name in options:
        if name not in allowed:
            takes = f"it takes {', '.join(allowed)}" if allowed else "it takes none"
            raise ParameterError(f"{address} has no option {name!r}; {takes}")
