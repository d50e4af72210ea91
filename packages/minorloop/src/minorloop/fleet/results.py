"""Folder of the results of a fleet.

It contains ``fleet.json`` (the options), ``models/NAME.json`` and ``results/NAME.json`` for each
specimen, and ``summary.json`` and ``summary.csv`` at the end. Each file is written atomically as
soon as its content is known, so that a stopped fleet continues where it stopped.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from minorloop.errors import OutputError
from minorloop.files import first_difference, make_folder, refusal, table_text, write_atomically
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.summary import Outcome, Summary

VERSION = 2
"""Format of the folder; another format has models of other defaults."""


def write_result(
    place: Path, one: Specimen, outcome: Outcome, model: bytes | None = None
) -> Outcome:
    """Write the result of a specimen and the content of its model file into the folder.

    Without a model, an earlier model is removed. Returns the result.
    """
    path = _model(place, one)
    if model is not None:
        write_atomically(path, model)
    write_atomically(_result(place, one), json.dumps(asdict(outcome), indent=1) + "\n")
    if model is None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"{path}, which is out of date, cannot be removed: {error.strerror or error}"
            ) from None
    return outcome


def has_result(place: Path, one: Specimen) -> bool:
    """Whether an earlier start wrote a result of a specimen."""
    return _result(place, one).exists()


def earlier_outcome(place: Path, one: Specimen, sha256: str) -> Outcome | None:
    """Return an earlier outcome if the digest of the record, columns and model are the same."""
    with suppress(OSError, ValueError, TypeError):
        found = Outcome(**json.loads(_result(place, one).read_text()))
        model = None
        if found.error is None:
            model = hashlib.sha256(_model(place, one).read_bytes()).hexdigest()
        now = {"specimen": one.name, "sha256": sha256, "model": model, **one.origin}
        return found if replace(found, **now) == found else None
    return None


def strays(place: Path, specimens: Sequence[Specimen]) -> list[str]:
    """Return files of specimens that are not in the manifest, such as ``models/old.json``."""
    known = {f"{one.key}.json" for one in specimens}
    found = (place / folder for folder in ("models", "results"))
    files = (file for folder in found for file in folder.glob("*.json"))
    return sorted(f"{file.parent.name}/{file.name}" for file in files if file.name not in known)


def open_folder(place: Path, specimens: Sequence[Specimen], options: Mapping[str, Any]) -> Path:
    """Make the folder, or continue a folder with the same options; return its path."""
    header = place / "fleet.json"
    make_folder(place, force=header.exists())
    content = {
        "format": "minorloop fleet",
        "version": VERSION,
        "specimens": len(specimens),
        "options": json.loads(json.dumps(options)),
    }
    if header.exists():
        _check_header(header, content)
    try:
        for folder in (place / "models", place / "results"):
            folder.mkdir(exist_ok=True)
    except OSError as error:
        raise refusal(place, error) from None
    write_atomically(header, json.dumps(content, indent=1) + "\n")
    return place


def _check_header(header: Path, content: Mapping[str, Any]) -> None:
    found = None
    with suppress(OSError, ValueError):
        found = json.loads(header.read_text())
    if not isinstance(found, dict) or found.get("format") != content["format"]:
        raise OutputError(f"{header} does not belong to a fleet; give another folder")
    if found.get("version") != VERSION:
        raise OutputError(
            f"{header.parent} holds a fleet identified with the defaults of another version; give "
            "another folder"
        )
    difference = first_difference(found.get("options") or {}, content["options"])
    if difference:
        raise OutputError(
            f"{header.parent} holds a fleet identified with other options: {difference}; give the "
            "same options, or another folder"
        )


def write_summary(place: Path, summary: Summary) -> None:
    """Write the results of all specimens as JSON and as a table."""
    write_atomically(place / "summary.json", json.dumps(summary.plain(), indent=1) + "\n")
    rows = [asdict(outcome) for outcome in summary.outcomes]
    write_atomically(place / "summary.csv", table_text(rows[0], (row.values() for row in rows)))


def _model(place: Path, one: Specimen) -> Path:
    return place / "models" / f"{one.key}.json"


def _result(place: Path, one: Specimen) -> Path:
    return place / "results" / f"{one.key}.json"
