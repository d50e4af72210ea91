"""``python tests/packaging/licences.py``: the licence of each dependency of both packages.

A dependency that is not installed here, such as one of another system, is left out.
"""

from __future__ import annotations

import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution

PACKAGES = ("minorloop", "minorloop-head")


def licence(found: Distribution) -> str:
    """The licence in the metadata: an expression, classifiers, or the first line of a text."""
    expression = found.metadata.get("License-Expression")
    classifiers = found.metadata.get_all("Classifier") or []
    named = [each.split(" :: ")[-1] for each in classifiers if each.startswith("License ::")]
    text = (found.metadata.get("License") or "").strip().split("\n")[0]
    return expression or ", ".join(named) or text or "not given"


def dependencies(names: tuple[str, ...]) -> dict[str, Distribution]:
    """The installed distributions that these need, with those of their extras, by name."""
    found, waiting = dict[str, Distribution](), [*names]
    while waiting:
        name = re.sub(r"[-_.]+", "-", waiting.pop()).lower()
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            continue
        for need in found[name].requires or []:
            if name in PACKAGES or "extra ==" not in need:
                waiting.append(re.match(r"[\w.-]+", need)[0])
    return found


if __name__ == "__main__":
    for name, each in sorted(dependencies(PACKAGES).items()):
        print(f"{name:30} {each.version:14} {licence(each)}")
