"""Entry points of this and other installed packages, by group and name."""

import sys
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from minorloop.errors import ParameterError


def registered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group, by name."""
    return {point.name: point for point in _read(tuple(sys.path)).select(group=group)}


@lru_cache(maxsize=8)
def _read(path: tuple[str, ...]) -> Any:
    """Return the entry points of all groups of the packages on a path, in 10 ms."""
    return entry_points()


def loaded(point: EntryPoint, name: str) -> Any:
    """Return the object of an entry point.

    Raises a `ParameterError` if it cannot be imported.

    ``name``: the name of its purpose in messages, such as an address.
    """
    try:
        return point.load()
    except ModuleNotFoundError as error:
        raise ParameterError(f"{name} needs {error.name}, which is not installed") from None
    except (ImportError, AttributeError) as error:
        raise ParameterError(f"the driver of {name} cannot be loaded: {error}") from None
