"""Render C, its self-test and its descriptions from templates."""

from functools import cache
from typing import Any


@cache
def _environment(package: str) -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader(package),
        undefined=StrictUndefined,
        autoescape=False,
        keep_trailing_newline=True,
    )


def render(template: str, context: dict[str, Any], package: str = "minorloop.export") -> str:
    """Return the text of a file from a template in the package's folder ``templates``."""
    return str(_environment(package).get_template(template).render(context))
