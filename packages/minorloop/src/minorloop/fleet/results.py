"""Folder of the results of a fleet.

It holds ``fleet.json`` (the options), ``models/NAME.json`` and ``results/NAME.json`` for each
specimen, and ``summary.json`` and ``summary.csv`` at the end. Each file is written atomically as
soon as its content is known, so that a fleet that was stopped continues where it stopped.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from minorloop import modelfile
from minorloop.errors import OutputError, ParameterError
from minorloop.files import first_difference, table_text, write_atomically
from minorloop.fleet._reading import read_within
from minorloop.fleet.manifest import Specimen
from minorloop.fleet.summary import Outcome, Summary

VERSION = 2
"""Format of the folder; another one has models of other defaults."""
_LONGEST = 400
"""Characters of a reason or a warning."""
_READING = 5.0
"""Seconds after which a record that was identified before is read like a new one."""


def write_result(place: Path, one: Specimen, found: Mapping[str, Any]) -> Outcome:
    """Write the result of a worker, and return the outcome."""
    digest = found.get("sha256")
    if "error" in found:
        return fail(place, one, found["error"], digest)
    model = found["model"]
    low, high = map(float, model.range)
    outcome = Outcome(
        one.name,
        nrmse=found["nrmse"],
        nrmse_holdout=found["nrmse_holdout"],
        excited=found["excited"],
        low=low,
        high=high,
        opening=found["opening"],
        samples=found["samples"],
        seconds=found["seconds"],
        sha256=digest,
        warning=one_line("; ".join(found["warnings"])) or None,
        advice=one_line("; ".join(found["advice"])) or None,
        chosen=one_line("; ".join(found["chosen"])) or None,
        **_origin(one),
    )
    path = _model(place, one)
    try:
        modelfile.save(
            model,
            path,
            input=found["input"],
            output=found["output"],
            lag=found["lag"],
            lag_seconds=found["lag_seconds"],
            provenance={
                "data": one.file.name,
                "sha256": digest,
                "scores": _scores(found),
            },
            warnings=found["warnings"],
            force=True,
        )
    except ParameterError as error:
        return fail(place, one, str(error), digest)
    outcome = replace(outcome, model=_digest(path))
    _write_outcome(place, one, outcome)
    return outcome


def _scores(found: Mapping[str, Any]) -> dict[str, Any]:
    scores = {name: found[name] for name in ("nrmse", "nrmse_holdout", "excited")}
    return {name: value for name, value in scores.items() if value is not None}


def fail(place: Path, one: Specimen, reason: str, digest: str | None = None) -> Outcome:
    """Write why a specimen has no model, and remove the model of an earlier start."""
    outcome = Outcome(one.name, error=one_line(reason), sha256=digest, **_origin(one))
    _write_outcome(place, one, outcome)
    try:
        _model(place, one).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            f"{_model(place, one)}, which is out of date, cannot be removed: "
            f"{error.strerror or error}"
        ) from None
    return outcome


def _model(place: Path, one: Specimen) -> Path:
    return place / "models" / f"{one.key}.json"


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _origin(one: Specimen) -> dict[str, Any]:
    return {"file": one.listed or str(one.file), **one.columns}


def _write_outcome(place: Path, one: Specimen, outcome: Outcome) -> None:
    text = json.dumps(outcome.plain(), indent=1)
    write_atomically(place / "results" / f"{one.key}.json", text + "\n")


def earlier_outcomes(
    place: Path, specimens: Sequence[Specimen], *, failed: bool
) -> dict[str, Outcome]:
    """Load outcomes of an earlier start whose record, columns and model are unchanged.

    Parameters
    ----------
    place : Path
        The folder.
    specimens : sequence of Specimen
        Specimens whose outcomes are wanted.
    failed : bool
        Whether failures are kept too, if their records could be read.
    """
    found = {}
    for one in specimens:
        try:
            outcome = Outcome(**json.loads((place / "results" / f"{one.key}.json").read_text()))
            digest = hashlib.sha256(read_within(one, _READING)).hexdigest()
            model = None if outcome.error else _digest(_model(place, one))
        except (OSError, ValueError, TypeError):
            continue
        now = {"specimen": one.name, "sha256": digest, "model": model, **_origin(one)}
        if (failed or outcome.error is None) and replace(outcome, **now) == outcome:
            found[one.name] = outcome
    return found


def strays(place: Path, specimens: Sequence[Specimen]) -> list[str]:
    """Return files of specimens that are not in the manifest, such as ``models/old.json``."""
    known = {f"{one.key}.json" for one in specimens}
    found = (place / folder for folder in ("models", "results"))
    files = (file for folder in found for file in folder.glob("*.json"))
    return sorted(f"{file.parent.name}/{file.name}" for file in files if file.name not in known)


def open_folder(place: Path, specimens: Sequence[Specimen], options: Mapping[str, Any]) -> Path:
    """Make the folder, or continue one with the same options; return its path."""
    content = {
        "format": "minorloop fleet",
        "version": VERSION,
        "specimens": len(specimens),
        "options": dict(options),
    }
    header = place / "fleet.json"
    try:
        if header.exists():
            try:
                found = json.loads(header.read_text())
            except ValueError:
                found = None
            if not isinstance(found, dict) or found.get("format") != content["format"]:
                raise OutputError(f"{header} does not belong to a fleet; give another folder")
            if found.get("version") != VERSION:
                raise OutputError(
                    f"{place} holds a fleet identified with the defaults of another version; give "
                    "another folder"
                )
            before, now = found.get("options"), json.loads(json.dumps(content["options"]))
            difference = first_difference({"options": before}, {"options": now})
            if difference:
                raise OutputError(
                    f"{place} holds a fleet identified with other options: "
                    f"{difference.removeprefix('options.')}; give the same options, or another "
                    "folder"
                )
        elif place.exists() and any(place.iterdir()):
            raise OutputError(f"the folder {place} is not empty; give a new or an empty one")
        for folder in (place / "models", place / "results"):
            folder.mkdir(parents=True, exist_ok=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{place} cannot be used: {error.strerror or error}") from None
    write_atomically(header, json.dumps(content, indent=1) + "\n")
    return place


def write_summary(place: Path, summary: Summary) -> None:
    """Write the results of all specimens as JSON and as a table."""
    write_atomically(place / "summary.json", json.dumps(summary.plain(), indent=1) + "\n")
    columns = list(Outcome("").plain())
    rows = (outcome.plain() for outcome in summary.outcomes)
    table = ([row[name] for name in columns] for row in rows)
    write_atomically(place / "summary.csv", table_text(columns, table))


def one_line(text: str) -> str:
    """Return a text on one line, shortened to 400 characters."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else f"{line[: _LONGEST - 4]} ..."
