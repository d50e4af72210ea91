"""Public modules of packages: ``.. modules:: operators`` makes a section for each module.

Those of other packages have their whole name, ``.. modules:: minorloop_head.control``.

Modules listed below the directive come first, in that order; the others follow by name. A new
module of a package is thus in the reference without being listed.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any, ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def public_modules(package: str) -> list[str]:
    """Return the names of the public modules of a package, or its own if it is one module."""
    whole = package if package.startswith("minorloop") else f"minorloop.{package}"
    found = importlib.import_module(whole)
    if not hasattr(found, "__path__"):
        return [found.__name__]
    inside = pkgutil.walk_packages(found.__path__, f"{found.__name__}.")
    names = [module.name for module in inside if not module.ispkg]
    return sorted(n for n in names if not any(part.startswith("_") for part in n.split(".")))


class Modules(SphinxDirective):
    """A section with the docstrings of each public module."""

    optional_arguments: ClassVar[int] = 20
    has_content: ClassVar[bool] = True

    def run(self) -> list[nodes.Node]:
        first = " ".join(self.content).split()
        found = [(package, name) for package in self.arguments for name in public_modules(package)]
        shown = {name: self.title(package, name) for package, name in found}
        order = [name for title in first for name in shown if shown[name] == title]
        order += [name for name in shown if name not in order]
        return [self.section(shown[name], name) for name in order]

    def title(self, package: str, name: str) -> str:
        whole = name.removeprefix("minorloop.")
        return whole.removeprefix(f"{package}.") if len(self.arguments) == 1 else whole

    def section(self, title: str, name: str) -> nodes.section:
        found = nodes.section(ids=[nodes.make_id(name)], names=[name])
        found += nodes.title("", "", nodes.literal("", title))
        found += self.parse_text_to_nodes(f".. automodule:: {name}\n")
        return found


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_directive("modules", Modules)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
