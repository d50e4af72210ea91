"""More readers: of texts that are written for spreadsheets, and of huge files."""

from __future__ import annotations

import json
import re
import unicodedata
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from fuzz.readers import Reader, _expect, cells_of, printable
from minorloop import Channel, MinorloopError, Preisach, Record, modelfile
from minorloop.fleet.manifest import read_manifest
from minorloop.lab.logs import read_log
from minorloop_head.console import messages
from minorloop_head.reconstruction.findings import Finding, finding_table

PIECES = [
    *("=", "+", "-", "@", "'", "''", "\t", "\r", "\n", '"', ",", ";", " ", "\uff1d", "\0", "\x07"),
    *("\x1b[31m", "\x7f", "\x85", "\x9b", "\u2028", "\u2029", "\u202e", "\u2066", "\u200f"),
    *("1+1", "cmd|' /C calc'!A0", "HYPERLINK(1)", "u", "tip", "1e5", "\xb5", "\u65e5", "e\u0301"),
]
WIDTHS = (2, 3, 50, 999, 1_000, 1_001, 9_999, 10_000, 10_001, 60_000, 1_800_000)
DEPTHS = (1, 30, 300, 5_001, 100_000, 2_000_000)
NESTS = ("[", '{"a":', "[[],", "[1,", '{"a":[', "[{},", '"')


def text_readers(scratch: Path) -> list[Reader]:
    """Names that go out and come back, and files of one mark again and again."""
    return [
        Reader("texts", _make_text, lambda case: _there_and_back(scratch, case)),
        Reader("floods", _make_flood, lambda case: _flooded(scratch, *case)),
    ]


def _make_text(random: Random) -> str:
    return "".join(random.choice(PIECES) for _ in range(random.choice((1, 2, 3, 5))))


def _there_and_back(scratch: Path, name: str) -> bool:
    """Whether a name is let in as that of a channel; then every table has to give it back."""
    finding = Finding(name, name, *(-1.0,) * 10)
    for row in cells_of(finding_table([finding]).encode())[1:]:
        _expect(not any(map(_formula, row)), f"the row {row}")
    try:
        record = Record([-1.0, 2.0], [0.5, -3.0], [0.0, 1.0], _named(name), "answer")
    except MinorloopError:
        _expect(not printable(name), "a name that can be printed is refused")
        return False
    _expect(printable(str(record.input)), "a name that cannot be printed is let in")
    Channel(record.input.name, record.input.unit)
    path = scratch / "texts.csv"
    record.to_csv(path, force=True)
    header, *rows = cells_of(path.read_bytes())
    _expect(not any(map(_formula, header)), f"the header {header}")
    _expect([float(row[1]) for row in rows] == [-1.0, 2.0], "numbers")
    again = read_log(path, input=str(record.input), output="answer", time=None)
    _expect(again.input == record.input and np.array_equal(again.u, record.u), "another name")
    modelfile.save(_model(), scratch / "texts.json", input=record.input, force=True)
    _expect(modelfile.read(scratch / "texts.json").input == record.input, "another name")
    return True


def _named(name: str) -> str:
    """The name as a header that is neither empty nor that of another column."""
    return f"{name}x"


def _formula(cell: str) -> bool:
    """Whether a spreadsheet would compute a cell; numbers it may."""
    text = unicodedata.normalize("NFKC", cell)
    if re.fullmatch(r"[-+]?[0-9.]+(e[-+]?[0-9]+)?", text):
        return False
    return text.lstrip(" \n\xa0").startswith(("=", "+", "-", "@", "\t", "\r"))


def _model() -> Preisach:
    return Preisach([0.0, 1.0], [[1.0]])


WIDEST = {"record": 10_000, "row": 2}
"""Cells of a line; those of a manifest are bounded by the size of its file."""


def _make_flood(random: Random) -> tuple[str, Any]:
    kind = random.choice(("record", "manifest", "row", "model", "message"))
    if kind in ("model", "message"):
        return kind, (random.choice(NESTS), random.choice(DEPTHS))
    return kind, random.choice(WIDTHS)


def _flooded(scratch: Path, kind: str, size: Any) -> bool:
    path = scratch / "flood"
    if kind in ("model", "message"):
        return _nested(path, kind, *size)
    wide = "," * (size - 2)
    path.write_text(
        {
            "record": f"u,y{wide}\n1,2{wide}\n",
            "manifest": f"specimen,file{wide}\na,b{wide}\n",
            "row": f"u,y\n1,2{wide}\n",
        }[kind]
    )
    try:
        if kind == "manifest":
            found = len(read_manifest(path, input="u", output="y"))
        else:
            found = len(read_log(path, input="u", output="y", time=None))
    except MinorloopError:
        _expect(kind != "manifest" and size > WIDEST[kind], "refused")
        return False
    _expect(found == 1 and (kind == "manifest" or size <= WIDEST[kind]), "let in")
    return True


def _nested(path: Path, kind: str, mark: str, depth: int) -> bool:
    text = mark * depth
    try:
        if kind == "message":
            messages.decode('{"type":"ping","seq":1,"t":' + text)
        else:
            modelfile.save(_model(), path, force=True)
            content = json.loads(path.read_text())
            path.write_text(json.dumps({**content, "x": 0})[:-2] + text)
            modelfile.read(path)
    except MinorloopError:
        return False
    _expect(False, "let in")
    return True
