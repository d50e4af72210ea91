"""Hysteresis of smart actuators: from measured data to precise positioning.

Every public name stands in ``__init__.pyi`` with its home and is imported when it is first asked
for, so that ``import minorloop`` costs next to nothing.
"""

import re
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from minorloop.version import __version__ as __version__

_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_HOMES = {name: home for home, name in re.findall(r"from (\S+) import \(?\s*(\w+) as", _STUB)}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'minorloop' has no attribute {name!r}")
    home = import_module(_HOMES[name])
    found = getattr(home, name, None)
    return import_module(f"{home.__name__}.{name}") if found is None else found


def __dir__() -> list[str]:
    return __all__


class _Package(ModuleType):
    """A package in which ``connect`` is the function, not the module of the same name.

    Importing a submodule binds its name in the package; without this class, the meaning of
    ``minorloop.connect`` would depend on previous imports.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name == "connect" and isinstance(value, ModuleType):
            value = value.connect
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
