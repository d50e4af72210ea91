"""Laws of the source as a whole, read from its text: what imports what, and what is called how."""

import ast
import importlib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = {
    "minorloop": ROOT / "packages/minorloop/src",
    "minorloop_head": ROOT / "packages/minorloop-head/src",
    "papers": ROOT,
}
FILES = {
    ".".join(path.relative_to(source).with_suffix("").parts).removesuffix(".__init__"): path
    for package, source in SOURCES.items()
    for path in (source / package).rglob("*.py")
    if "tests" not in path.relative_to(source).parts
}


def imported(name):
    """Modules that a file imports: inside functions, for types and by their names as well.

    The name of a package is no import of it: others are called so as well.
    """
    found = set()
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {one if one in FILES else node.module for one in inner}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.Constant) and node.value not in SOURCES:
            found.add(node.value)
    return (found & FILES.keys()) - {name}


def reached(start, arrows):
    """All that can be reached from a file."""
    todo, seen = [start], set()
    while todo:
        for following in arrows[todo.pop()] - seen:
            seen.add(following)
            todo.append(following)
    return seen


def test_no_files_import_each_other_in_a_circle():
    arrows = {name: imported(name) for name in FILES}
    assert [name for name in FILES if name in reached(name, arrows)] == []


def test_no_class_name_is_used_in_two_modules():
    names = Counter(
        node.name
        for path in FILES.values()
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    )
    assert {name: count for name, count in names.items() if count > 1} == {}


def test_benchmarks_and_examples_import_names_that_exist():
    missing = [
        f"{path.relative_to(ROOT)}: {node.module}.{alias.name}"
        for folder in ("benchmarks", "examples")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in SOURCES
        for alias in node.names
        if f"{node.module}.{alias.name}" not in FILES
        and not hasattr(importlib.import_module(node.module), alias.name)
    ]
    assert missing == []
