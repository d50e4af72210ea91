"""The report of a study from its template: prose, tables and pictures with figures in braces.

A template begins with the summary; ``## heading`` begins a section. Its blocks, apart by empty
lines, are paragraphs, tables of Markdown, ``[call]`` for a table that a function returns, and
``![caption](call)`` for a picture. ``{fig8.ratio:.1f}`` is a figure, ``{study.seed}`` of the
specimen that is drawn, ``{HOLD}`` a constant and ``{limits outcomes}`` a call, of the module of the
template or as ``module:function``; its function ``names`` may give more names. ``:.0p`` is in
percent with a space. ``@for crack in study.cracks`` repeats a section. Paragraphs without words and
sections without blocks are left out.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from string import Formatter
from typing import Any, TypeAlias

from minorloop.report import Picture, Report, Table
from papers.claims import cell, claim_table, paper_table
from papers.drawing import every_specimen

Names: TypeAlias = ChainMap[str, Any]
_SHARED = {
    "claim_table": claim_table,
    "paper_table": paper_table,
    "every_specimen": every_specimen,
    "len": len,
    "/": "/",
}


def study_report(
    study: Any, first: Any, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """Return the report of a `Study`.

    Its page is a module with the functions of the template; the template is beside it, with the
    ending ``.md``. The first specimen is drawn, ``study`` in the template; ``figures`` are over all
    specimens, ``runs`` of each.
    """
    page = import_module(study.page)
    assert page.__file__ is not None
    text = Path(page.__file__).with_suffix(".md").read_text("utf-8")
    many = len(runs) > 1
    own = {
        "study": first,
        "figures": figures,
        "runs": runs,
        "claims": study.claims,
        "count": len(runs),
        "specimens": f"{len(runs)} simulated specimen{'s' if many else ''}",
    }
    computed = page.names(first, figures, runs) if hasattr(page, "names") else {}
    names = ChainMap(own, computed, dict(figures), vars(page), _SHARED)
    summary, *sections = re.split(r"^## ", text, flags=re.MULTILINE)
    report = Report(study.title, filled(summary, names))
    for section in sections:
        heading, *blocks = re.split(r"\n\s*\n", section.strip())
        for known in _repeated(blocks, names):
            _add(report, filled(heading, known), blocks, known)
    return report


def _repeated(blocks: list[str], names: Names) -> Iterator[Names]:
    """Yield the names of each repetition of a section, and remove the line with ``@for``."""
    said = re.fullmatch(r"@for (\w+) in (.+)", blocks[0]) if blocks else None
    if said is None:
        yield names
        return
    del blocks[0]
    for each in value_of(said[2], names):
        yield names.new_child({said[1]: each})


def _add(report: Report, heading: str, blocks: Sequence[str], names: Names) -> None:
    text: list[str] = []
    table: Table | None = None
    pictures: list[Picture] = []
    for block in blocks:
        if picture := re.fullmatch(r"!\[(.*)\]\((.*)\)", block, re.DOTALL):
            found = value_of(picture[2], names)
            caption = filled(picture[1], names)
            if isinstance(found, list):
                pictures += found
            elif found is not None:
                pictures.append(Picture(found, caption))
        elif call := re.fullmatch(r"\[(.*)\]", block, re.DOTALL):
            table = value_of(call[1], names)
        elif block.startswith("|"):
            table = table_of(block, names)
        elif paragraph := filled(block, names):
            text.append(paragraph)
    if text or table is not None or pictures:
        report.add(heading, text=text, table=table, pictures=pictures)


def table_of(block: str, names: Names) -> Table:
    """Return a table of Markdown with its cells filled."""
    columns, _, *rows = (
        [filled(part, names) for part in re.split(r"(?<!\\)\|", line.strip("| "))]
        for line in block.splitlines()
    )
    return Table(columns, rows)


def filled(text: str, names: Names) -> str:
    """Return a text in one line, with names replaced by figures."""
    return _Fields().vformat(" ".join(text.split()), (), names)


class _Fields(Formatter):
    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        return value_of(field_name, kwargs), field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        if not isinstance(value, float | int) or not format_spec:
            return format(value, format_spec)
        if format_spec.endswith("p"):
            return f"{cell(100 * value, f'{format_spec[:-1]}f')} %"
        return cell(value, format_spec)


def value_of(words: str, names: Names) -> Any:
    """Return the value of a dotted name, or of a function for the names behind it."""
    first, *others = (_named(word, names) for word in words.split())
    return first(*others) if callable(first) else first


def _named(word: str, names: Names) -> Any:
    """Return a number, or the value by keys, attributes and calls without arguments."""
    if re.fullmatch(r"[\d.]+", word):
        return float(word)
    module, _, dotted = word.rpartition(":")
    root, *path = dotted.split(".")
    found = vars(import_module(module))[root] if module else names[root]
    for part in path:
        found = found() if callable(found) else found
        if isinstance(found, Mapping):
            found = found[part]
        else:
            found = found[int(part)] if part.isdigit() else getattr(found, part)
    return found
