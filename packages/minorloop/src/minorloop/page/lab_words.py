"""Advice in the words of the lab page: its fields in place of options of Python and commands."""

import re

FIELDS = {
    "creep": "Creep and after-effect (creep)",
    "curves": "Curves, each with a new memory",
    "diagonal": "Smallest loops (diagonal)",
    "dynamics": "Dead time, poles and creep (dynamics)",
    "groups": "Groups to leave out, such as specimens",
    "holdout": "Held-out rows at the end",
    "input": "Input (applied)",
    "lag": "Lag",
    "levels": "Levels",
    "output": "Output (measured)",
    "rate": "Thresholds that depend on the rate (rate)",
    "rows": "First row” and “Rows up to",
    "skip": "Rows not fitted at the start",
    "slope": "Linear part (slope)",
    "start": "Memory at the start",
    "start-of-curve": "Memory before each curve",
    "time": "Time",
}
"""Labels of the fields of the page, by the options of the command line."""
ELSEWHERE = frozenset({"flip", "signed"})
"""Options of the command line in advice that the page does not have."""
_VALUES = {"auto": "automatic", "as-left": "as left by the last one"}

_ASSIGNED = r"(?:[a-z_]+=(?:\"[^\"]*\"|[\w.]+)(?: or [a-z_]+=[\w.]+)*|\"[a-z-]+\") "
_OPTION = r"--([a-z-]+)(?: (COLUMN|auto|none|output|as-left|operator|linear|[\d.]+)(?![\w.]*\w))?"
_GROUPED = re.compile(r"--(?:law|record) (\w+)(?:[=:](?:first=)?([\w:-]+))?")
"""A key of an option of the command line that has several keys."""
_PAIR = re.compile(rf"(?:{_ASSIGNED})?\({_OPTION}\)")
_BARE = re.compile(_OPTION)


def on_page(sentence: str) -> str:
    """Return advice, such as ``skip=30 (--record skip=30)``, with the fields of the page."""
    text = sentence.replace("Dynamics() (--time COLUMN --law dynamics)", "--dynamics auto")
    text = _GROUPED.sub(_single, text)
    text = text.replace("(minorloop reduce)", "with the command minorloop reduce LOG")
    return _BARE.sub(_field, _PAIR.sub(_field, text))


def _single(found: re.Match[str]) -> str:
    """Return one of several keys as a separate option."""
    value = found[2] if found[2] not in ("yes", "A:B", "N") else None
    return f"--{found[1].replace('_', '-')}" + (f" {value}" if value else "")


def _field(found: re.Match[str]) -> str:
    """Return a field and its value in words; an option without a field does not change."""
    option, value = found.groups()
    if option not in FIELDS:
        return f"--{option}{f' {value}' if value else ''} of the command minorloop"
    field = f"“{FIELDS[option]}”"
    if value is None or value == "COLUMN":
        return field
    if option == "dynamics":
        value = "auto"
    if option == "holdout":
        value = f"{float(value):.0%}"
    return f"{field}: {_VALUES.get(value, value)}"
