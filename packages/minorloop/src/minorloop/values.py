"""Values as text, on command lines and in addresses: ``KIND:WHAT,KEY=VALUE,...``.

The text before the first ``KEY=`` may have commas, and so may a value: a part between commas that
does not begin with ``KEY=`` belongs to the value before it.
"""

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from minorloop.errors import ParameterError

T = TypeVar("T")
_KEY = re.compile(r"([A-Za-z][\w-]*)=(.*)", re.DOTALL)
_KIND = re.compile(r"([A-Za-z][\w-]*)(?::|$|,(?=[A-Za-z][\w-]*=))")
_WORDS = {"yes": True, "no": False, "none": None}


@dataclass(frozen=True)
class TextValue:
    """A value split into its parts."""

    kind: str
    """The text before the colon; empty without one."""
    what: str
    """The text before the first ``KEY=VALUE``, without the kind."""
    options: Mapping[str, str]
    """The values as texts by key; in keys, ``-`` is replaced by ``_``."""


def parsed(text: str) -> TextValue:
    """Return the parts of a text.

    Raises a `ParameterError` if a key is given twice.
    """
    kind = ""
    if found := _KIND.match(text):
        kind, text = found[1], text[found.end() :]
    parts: list[tuple[str, str]] = [("", "")]
    for part in text.split(","):
        if pair := _KEY.fullmatch(part):
            parts.append((pair[1].replace("-", "_"), pair[2]))
        else:
            key, before = parts[-1]
            parts[-1] = key, f"{before},{part}" if before else part
    options = dict(parts)
    if len(options) < len(parts):
        raise ParameterError(f"{text!r} has a key twice; give each once")
    return TextValue(kind, options.pop(""), options)


def merged(texts: Sequence[str], kind: str) -> TextValue:
    """Return the parts of several texts together; the last kind and the last of each key count."""
    what, options = "", dict[str, str]()
    for value in map(parsed, texts):
        kind, what = value.kind or kind, value.what or what
        options |= value.options
    return TextValue(kind, what, options)


def called(make: Callable[..., T], where: str, options: Mapping[str, Any], **others: Any) -> T:
    """Call a function or a class with texts, or values, by the names of its parameters.

    Raises a `ParameterError` if a name is not a parameter, or a required one is missing; ``where``
    names the option or address in messages.
    """
    parameters = inspect.signature(make).parameters
    known = [name for name in parameters if name not in others]
    for name in options:
        if name not in known:
            raise ParameterError(f"{where} has no {name!r}; it has {', '.join(known)}")
    for name in known:
        if parameters[name].default is inspect.Parameter.empty and name not in options:
            raise ParameterError(f"{where} needs {name}; give {name}=VALUE")
    values = {
        name: plain(text)
        if isinstance(text, str) and not _is_text(parameters[name].annotation)
        else text
        for name, text in options.items()
    }
    return make(**values, **others)


def _is_text(annotation: Any) -> bool:
    return getattr(annotation, "__name__", str(annotation)) in ("str", "str | None")


def plain(text: str) -> Any:
    """Return a text as a number, a bool (``yes``, ``no``) or None (``none``) if it is one."""
    if text in _WORDS:
        return _WORDS[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def numbers(text: str, counts: Any, where: str, form: str) -> list[float]:
    """Return numbers that are separated by commas.

    Raises a `ParameterError` if their count is not in ``counts``, or a part is not a number.
    """
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) not in counts:
        raise ParameterError(f"{where} is {text!r}; give {form}, numbers separated by commas")
    return found


def ends(text: str, what: str, kind: Callable[[str], T], form: str) -> tuple[T, T]:
    """Return the two ends of a range ``A:B``, each converted by ``kind``.

    Raises a `ParameterError` if there are not two, or ``kind`` raises a `ValueError`; ``what`` is
    the key, and ``form`` the required form, for the message.
    """
    try:
        first, last = map(kind, text.split(":"))
    except ValueError:
        raise ParameterError(f"{what} is {text!r}; give {form}") from None
    return first, last


def as_duration(seconds: float) -> str:
    """Return a duration as text, in seconds, minutes or hours depending on its length."""
    if seconds < 90:
        return f"{seconds:.3g} s"
    if seconds < 3600:
        return f"{round(seconds / 60, 1):g} min"
    return f"{round(seconds / 3600, 1):g} h"
