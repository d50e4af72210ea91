"""Read the file that describes a bench, TOML or JSON."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from minorloop.errors import MinorloopError, ParameterError
from minorloop.files import kind_of_file

__all__ = ["UNRELATED", "Section", "parsed", "read_description", "relevant"]

LARGEST = 1_000_000
"""Bytes of the largest file."""
UNRELATED = "timeout", "baud", "safe_within", "safe_query", "safe_answer", "done"
"""Keys on which no reading depends; they may change before a run is resumed."""

Parsed = TypeVar("Parsed", bound="Section")


class Section(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Part of the file; unknown keys are refused."""


def read_description(path: Path) -> dict[str, Any]:
    """Return the content of a file, TOML if its name ends in ``.toml``, JSON otherwise.

    Raises a `ParameterError` if it cannot be read, or is not a table.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise ParameterError(f"{path} is larger than {LARGEST} bytes; give a bench file")
        content = path.read_bytes()
        kind = kind_of_file(path, content)
        if kind not in ("", "a JSON file", "a TOML file"):
            raise ParameterError(f"{path} is {kind}, not a bench file; give the file of a bench")
        if path.suffix.lower() == ".toml":
            return tomllib.loads(content.decode())
        found = msgspec.json.decode(content)
    except MinorloopError:
        raise
    except OSError as error:
        raise ParameterError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise ParameterError(f"{path} does not describe a bench: {error}") from None
    if not isinstance(found, dict):
        kind = type(found).__name__
        raise ParameterError(f"{path} does not describe a bench: it has {kind}, not a table")
    return found


def parsed(
    kind: type[Parsed],
    values: Mapping[str, Any],
    where: object,
    what: str = "bench",
    also: Sequence[str] = (),
) -> Parsed:
    """Return part of a file as its structure.

    Raises a `ParameterError` if a key is missing, unknown, or of another type.

    Parameters
    ----------
    kind : type
        The structure.
    values : mapping
        Keys and values of the part.
    where : object
        Name of the part, for a message.
    what : str
        What the part describes, for a message.
    also : sequence of str
        Keys of the part that are read elsewhere, for a message.
    """
    try:
        return msgspec.convert(values, kind)
    except ValueError as error:
        allowed = _allowed(kind, error, also)
        raise ParameterError(f"{where} does not describe a {what}: {error}{allowed}") from None


def relevant(values: Any) -> Any:
    """Return all values on which a reading depends; timeouts are not among them."""
    if isinstance(values, Mapping):
        kept = {key: value for key, value in values.items() if key not in UNRELATED}
        return {key: relevant(value) for key, value in kept.items()}
    return [relevant(value) for value in values] if isinstance(values, list) else values


def _allowed(kind: Any, error: Exception, also: Sequence[str]) -> str:
    """Say which fields there are, where one is not known."""
    found = re.search(r"unknown field `.*?`(?: - at `\$\.(\w+)`)?", str(error))
    if not found:
        return ""
    if found[1]:
        (part,) = [each.type for each in msgspec.structs.fields(kind) if each.name == found[1]]
        kinds = [part, *getattr(part, "__args__", ())]
        kind = next((each for each in kinds if hasattr(each, "__struct_fields__")), kind)
        also = ()
    fields = msgspec.structs.fields(kind)
    required = sorted(each.name for each in fields if each.required)
    others = [each.name for each in fields if not each.required]
    return f"; the fields there are {', '.join([*also, *required, *others])}"
