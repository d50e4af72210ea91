"""The readers under test, their damaged input, and an independent check of what they accept."""

from __future__ import annotations

import itertools
import json
import math
import re
import unicodedata
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from fuzz.mutate import TOKENS, damaged, odd_json, odd_table
from minorloop import PrandtlIshlinskii, Preisach, modelfile
from minorloop.errors import InstrumentError, LimitError, MinorloopError, RecordError
from minorloop.fleet.manifest import read_manifest
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.drivers.serial_line import Board
from minorloop.lab.drivers.visa import Commands, ScpiMeter, ScpiSource
from minorloop.lab.logs import read_log
from minorloop.lab.plan import Plan
from minorloop.operators.generalised_prandtl_ishlinskii import (
    DeadZones,
    GeneralisedPrandtlIshlinskii,
)
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.relays import RelayModel

NUMBER = re.compile(r"[ \t]*[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?[ \t]*", re.ASCII)


class WrongAcceptance(Exception):
    """A reader accepted invalid input, or read it as something else."""


@dataclass(frozen=True)
class Reader:
    """A reader under test.

    Parameters
    ----------
    name : str
        Its name in the counts.
    make : callable
        Returns a case from a random source.
    accepts : callable
        Returns whether the case was accepted; raises `WrongAcceptance` if that is wrong. Any other
        error is a defect.
    """

    name: str
    make: Callable[[Random], Any]
    accepts: Callable[[Any], bool]


def readers(scratch: Path) -> list[Reader]:
    """Return all readers; files are written into a folder."""
    from fuzz.texts import text_readers

    models = _model_files(scratch)
    file = scratch / "case"

    def make_model(random: Random) -> bytes:
        data = random.choice(models)
        return odd_json(random, data) if random.random() < 0.6 else damaged(random, data, models)

    def through(read: Callable[[Path, bytes], None]) -> Callable[[bytes], bool]:
        def accepts(data: bytes) -> bool:
            file.write_bytes(data)
            try:
                read(file, data)
            except MinorloopError:
                return False
            return True

        return accepts

    return [
        Reader("model files", make_model, through(_read_model)),
        Reader("records", _table_maker(RECORDS), through(_read_record)),
        Reader("plans", _table_maker(PLANS), through(_read_plan)),
        Reader("manifests", _table_maker(MANIFESTS), through(_read_manifest)),
        Reader("serial line", _make_lines, _converse),
        Reader("SCPI", _make_answers, _measure),
        *text_readers(scratch),
    ]


# Model files


def _model_files(scratch: Path) -> list[bytes]:
    rng = np.random.default_rng(0)
    plays = PrandtlIshlinskii([0.0, 0.2, 0.7], [1.0, 0.5, 0.25], 0.1)
    models = [
        Preisach([-1.0, 0.0, 0.5, 1.0], np.tril(rng.uniform(size=(3, 3))), 0.5, slope=0.1),
        Preisach([0.0, 1.0], [[1.0]], relay="unipolar", diagonal="reversible"),
        RelayModel([0.0, 1.0, 2.0], np.tril(rng.uniform(size=(3, 3)))),
        plays,
        GeneralisedPrandtlIshlinskii(plays, DeadZones([-0.5, 0.0, 0.5], [0.2, 1.0, -0.3]), 0.2),
        Polynomial([0.0, 1.0, 0.2], -1.0, 1.0),
    ]
    data = []
    for k, model in enumerate(models):
        path = scratch / f"model{k}.json"
        modelfile.save(model, path, input="voltage [V]", output="tip [mm]", lag=k)
        data.append(path.read_bytes())
    modelfile.save(models[1], path, warnings=["the output is clipped", "a lag"], force=True)
    return [*data, path.read_bytes()]


def _read_model(path: Path, data: bytes) -> None:
    found = modelfile.read(path)
    try:
        content = json.loads(data.decode("utf-8"), object_pairs_hook=_once)
    except (ValueError, RecursionError) as error:
        raise WrongAcceptance(f"another parser says: {error}") from None
    warned = "warnings" in content
    _expect(content["format"] == "minorloop model", "header")
    _expect(type(content["version"]) is int and content["version"] == 1 + warned, "version")
    _expect(list(found.warnings) == content.get("warnings", []), "warnings")
    _expect(all(text.isprintable() for text in found.warnings), "characters of warnings")
    keys = {"format", "version", "input", "output", "lag", "model", "provenance"}
    keys |= {"warnings"} if warned else set()
    _expect(set(content) == keys, f"keys {set(content) ^ keys}")
    _expect(type(content["lag"]) is int and found.lag == content["lag"] >= 0, "lag")
    for name in ("input", "output"):
        quantity = getattr(found, name)
        _expect({"name": quantity.name, "unit": quantity.unit} == content[name], name)
        _expect(printable(quantity.name + quantity.unit), name)
    said = dict(content["model"])
    _expect(said.pop("kind") == found.kind, "kind")
    _same(found.model, said)
    _usable(found.model)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError("a key is there twice")
    return dict(pairs)


def _same(model: Any, said: dict[str, Any]) -> None:
    """Whether a model is what its file says, number by number."""
    for name, value in said.items():
        held = getattr(model, name)
        if isinstance(value, dict):
            _same(held, value)
        elif isinstance(value, str):
            _expect(held == value, name)
        elif isinstance(value, list) and value and isinstance(value[0], list):
            rows = [[*row, *[0.0] * (len(value) - len(row))] for row in value]
            _expect([len(row) for row in value] == list(range(1, len(value) + 1)), name)
            _equal(held, rows, name)
        else:
            _equal(held, value, name)
    for name in ("levels", "radii", "thresholds"):
        if name in said:
            values = said[name]
            rising = all(b > a for a, b in itertools.pairwise(values))
            _expect(rising and (name != "radii" or values[0] >= 0), name)


def _equal(held: Any, said: Any, name: str) -> None:
    for number in np.ravel(np.array(said, dtype=object)):
        _expect(type(number) in (int, float), f"{name} holds {number!r}")
    _expect(bool(np.isfinite(held).all()), f"{name} is not finite")
    _expect(np.array_equal(held, np.array(said, dtype=np.float64)), f"{name} differs")


def _usable(model: Any) -> None:
    """Whether a model answers with numbers to inputs that are meant for it."""
    axis = getattr(model, "levels", None)
    if axis is None:
        axis = [model.low, model.high] if isinstance(model, Polynomial) else [-1.0, 0.3, 0.0, 1.0]
    y = model.simulate(np.asarray(axis))
    _expect(bool(np.isfinite(y).all()), f"outputs {y}")


# Tables

RECORDS = [
    "time [s],voltage [V],tip [mm]\n0,0.5,1\n1,-0.5,2.25\n2,1e-3,-3\n3,0,nan\n",
    'sample,voltage,tip,"a, note"\n1,2,3,"x"\n2,3,4,"y, z"\n',
    "\ufefftip [mm];voltage [V];time [ms]\n1;2;3\n1.5;2.5;4\n",
]
PLANS = ["voltage [V],hold [s],shortest hold [s]\n0,10,2\n1,20,3\n-1,5,1\n", "u,hold [min]\n0,1\n"]
MANIFESTS = [
    "specimen,file,input,output\na,a.csv,u,y\nb,b.csv,,tip [mm]\n",
    'specimen,file\n"one, two",x.csv\nthree,"y ""z"".csv"\n',
]


def _table_maker(texts: list[str]) -> Callable[[Random], bytes]:
    encoded = [text.encode() for text in texts]

    def make(random: Random) -> bytes:
        k = random.randrange(len(texts))
        if random.random() < 0.65:
            return odd_table(random, texts[k]).encode(errors="surrogatepass")
        return damaged(random, encoded[k], encoded)

    return make


def cells_of(data: bytes, *, indented: bool = False) -> list[list[str]]:
    """A table, read letter by letter; blank lines are left out, and spaces that indent a cell."""
    try:
        text = data.decode("utf-8").removeprefix("\ufeff")
    except UnicodeDecodeError:
        text = data.decode("cp1252")
    first = re.split("\r\n|\r|\n", text, maxsplit=1)[0]
    comma = max(",;\t", key=first.count)
    rows, row, cell, quoted, begun, k = [], [], "", False, False, 0
    while k < len(text):
        letter = text[k]
        if quoted:
            if letter == '"' and text[k + 1 : k + 2] == '"':
                cell += '"'
                k += 1
            elif letter == '"':
                quoted = False
            else:
                cell += letter
        elif letter == '"' and not begun:
            quoted = begun = True
        elif letter == " " and indented and not begun:
            pass
        elif letter == comma:
            row.append(cell)
            cell, begun = "", False
        elif letter in "\r\n":
            if begun or row or cell:
                rows.append([*row, cell])
            row, cell, begun = [], "", False
            k += text[k : k + 2] == "\r\n"
        else:
            cell, begun = cell + letter, True
        k += 1
    if begun or row or cell:
        rows.append([*row, cell])
    return rows


def printable(text: str) -> bool:
    """Whether a text has no character that is obeyed and not shown."""
    obeyed = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
    marks = {"\u061c", "\u200e", "\u200f"}
    return not any(
        unicodedata.category(letter) in ("Cc", "Zl", "Zp")
        or unicodedata.bidirectional(letter) in obeyed
        or letter in marks
        for letter in text
    )


def _unmarked(cell: str) -> str:
    """A cell without the apostrophe that marks it as text where a formula would begin."""
    text = cell.lstrip("'").lstrip()
    formula = text[:1] and text[0] in "=+-@\uff1d\uff0b\uff0d\uff20"
    return cell[1:] if cell.startswith("'") and formula else cell


def _column(rows: list[list[str]], name: str, gaps: bool = False) -> list[float]:
    """A column of strict decimal numbers; blank or nan is a gap where that is legal."""
    headers = [_unmarked(header.strip()) for header in rows[0]]
    _expect(all(map(printable, headers)), f"headers {headers}")
    found = [k for k, header in enumerate(headers) if _bare(header) == name or header == name]
    exact = [k for k, header in enumerate(headers) if header == name]
    _expect(len(exact or found) == 1, f"columns {headers}")
    numbers = []
    for row in rows[1:]:
        _expect(len(row) == len(headers), f"a row of {len(row)} cells")
        cell = row[(exact or found)[0]]
        if gaps and (not cell.strip() or re.fullmatch(r"\s*[-+]?nan\s*", cell, re.IGNORECASE)):
            numbers.append(math.nan)
            continue
        _expect(NUMBER.fullmatch(cell.strip()) is not None, f"the cell {cell!r} is no number")
        numbers.append(float(cell))
    return numbers


def _bare(header: str) -> str:
    return re.sub(r"\s*\[[^\[\]]*\]\s*$", "", header).strip()


def _read_record(path: Path, data: bytes) -> None:
    record = read_log(path, input="voltage", output="tip", time=None)
    rows = cells_of(data)
    _agree(record.u, _column(rows, "voltage"), "inputs")
    _agree(record.y, _column(rows, "tip", gaps=True), "outputs")
    timed = read_log(path, input="voltage", output="tip", time="time")
    _expect(bool((np.diff(timed.t) >= 0).all()), "time runs backwards")
    header = next(h for h in rows[0] if _bare(_unmarked(h.strip())) == "time")
    unit = {"s": 1.0, "ms": 1e-3}.get(header.strip()[4:].strip(" []"))
    if unit is not None:
        _agree(timed.t, np.multiply(_column(rows, "time"), unit), "times")


def _read_plan(path: Path, data: bytes) -> None:
    plan = Plan.from_csv(path)
    rows = cells_of(data)
    headers = [_bare(_unmarked(header.strip())) for header in rows[0]]
    name = next(h for h in headers if h not in ("hold", "shortest hold"))
    _agree(plan.inputs, _column(rows, name, gaps=True), "levels")
    _expect(bool((plan.longest > 0).all()), "a hold that is not positive")
    _expect(bool(np.isfinite(plan.longest).all()), "a hold without end")


def _read_manifest(path: Path, data: bytes) -> None:
    specimens = read_manifest(path, input="u", output="y")
    rows = cells_of(data, indented=True)
    where = {header.strip().lower(): k for k, header in enumerate(rows[0])}
    filled = [row for row in rows[1:] if any(cell.strip() for cell in row)]
    names = [_unmarked(row[where["specimen"]].strip()) for row in filled]
    _expect([one.name for one in specimens] == names, f"specimens {names}")
    _expect(len({one.key for one in specimens}) == len(names), "files of results that coincide")
    for one in specimens:
        _expect(
            "/" not in one.key and "\0" not in one.key and one.key not in ("", ".", ".."), "key"
        )
        _expect(all((one.name, one.file.name, one.input, one.output)), "something is missing")
        words = (one.name, one.file.name, one.input, one.output)
        _expect(all(map(printable, words)), f"what cannot be printed: {words}")


def _agree(found: Any, wanted: Any, what: str) -> None:
    _expect(np.array_equal(found, np.asarray(wanted), equal_nan=True), f"{what} differ")


# Instruments


class Wire:
    """A line on which whatever was prepared comes back."""

    name = "wire"

    def __init__(self, answers: list[str]) -> None:
        self._answers, self.sent = list(answers), []

    def send(self, text: str) -> None:
        self.sent.append(text)

    def ask(self, text: str) -> str:
        self.send(text)
        return self.read()

    def read(self) -> str:
        if not self._answers:
            raise InstrumentError("no answer")
        return self._answers.pop(0)

    def flush(self) -> None:
        self._answers.clear()

    def close(self) -> None:
        pass


def sealed(sequence: int, body: str) -> str:
    """An answer with its sum."""
    text = f"{sequence} {body} "
    return f"{text}*{zlib.crc32(text.encode(errors='surrogatepass')):08X}"


def _word(random: Random) -> str:
    number = f"{random.uniform(-2, 2):.9g}"
    return random.choices(
        (number, random.choice(TOKENS), number + random.choice(TOKENS)), (3, 2, 1)
    )[0]


def _make_lines(random: Random) -> list[str]:
    """What a board says to HELLO, SET 0.25 and GET; some of it damaged, late or twice."""
    lines = [sealed(1, "OK minorloop 2 -1 1 1000")]
    for sequence in (2, 3):
        right = sealed(sequence, f"OK {'0.25' if sequence == 2 else _word(random)}")
        for _ in range(random.choice((0, 0, 1, 3))):
            kind = random.randrange(5)
            if kind == 0:
                lines.append(sealed(random.choice((1, 2, 3, 65535)), f"OK {_word(random)}"))
            elif kind == 1:
                lines.append(
                    sealed(sequence, f"{random.choice(('OK', 'ERR', 'ok', ''))} 1 {_word(random)}")
                )
            elif kind == 2:
                lines.append(_damaged_line(random, right))
            elif kind == 3:
                lines.append(random.choice(TOKENS))
            else:
                lines.append(lines[-1])
        lines.append(right if random.random() < 0.7 else _damaged_line(random, right))
    if random.random() < 0.1:
        lines[0] = _damaged_line(
            random, sealed(1, f"OK minorloop 2 {_word(random)} 1 {_word(random)}")
        )
    return lines


def _damaged_line(random: Random, line: str) -> str:
    return damaged(random, line.encode(), [line.encode()]).decode("utf-8", errors="replace")


def _converse(lines: list[str]) -> bool:
    wire, y = Wire(lines), None
    try:
        board = Board(wire)
        bench = _bench(board, board)
        y = bench.exchange(0.25)
    except (InstrumentError, LimitError):
        if any(" SET " in line for line in wire.sent):
            _expect(" SAFE " in wire.sent[-1], f"not made safe: {wire.sent}")
        return False
    first, rest = None, iter(lines)
    for sequence in (1, 2, 3):  # what comes before its question is not an answer to it
        first = next(filter(None, (_understood(line, sequence) for line in rest)), None)
    _expect(first is not None and first[0] == "OK" and len(first) == 2, "no sound answer")
    _expect(NUMBER.fullmatch(first[1]) is not None and float(first[1]) == y, f"{first} gave {y}")
    _expect(-5 <= y <= 5, f"{y} is beyond the limits")
    return True


def _understood(line: str, sequence: int) -> list[str] | None:
    """Words of an answer with the right number and the right sum, the sum done bit by bit."""
    head, star, tail = line.rpartition("*")
    if not star or not line.isascii() or not head.endswith(" ") or len(tail) != 8:
        return None
    total = 0xFFFFFFFF
    for byte in head.encode():
        total ^= byte
        for _ in range(8):
            total = (total >> 1) ^ (0xEDB88320 if total & 1 else 0)
    words = head.split(" ")[:-1]
    if not all(word.isprintable() and 0 < len(word) <= 40 and "*" not in word for word in words):
        return None
    right = tail == f"{total ^ 0xFFFFFFFF:08X}" and words[0] == str(sequence)
    return words[1:] if right and words[1:2] in (["OK"], ["ERR"]) else None


def _make_answers(random: Random) -> list[str]:
    """What a source says to VOLT? and SYST:ERR?, and a meter to READ?."""
    answers = ["0.25", '0,"No error"', _word(random)]
    for k in range(3):
        if random.random() < 0.3:
            answers[k] = _damaged_line(random, answers[k])
        if random.random() < 0.05:
            answers[k] = random.choice(TOKENS)
    return answers[: random.choice((3, 3, 3, 3, 2, 1, 0))]


def _measure(answers: list[str]) -> bool:
    wire = Wire(answers)
    options = {"confirm": "VOLT?", "errors": "SYST:ERR?", "safe": ["VOLT 0", "OUTP OFF"]}
    bench = _bench(ScpiSource(wire, Commands(tolerance=1e-6, **options)), ScpiMeter(wire))
    try:
        y = bench.exchange(0.25)
    except InstrumentError:
        sent = [line for line in wire.sent if not line.endswith("?")]
        _expect(sent[-2:] == ["VOLT 0", "OUTP OFF"], f"not made safe: {wire.sent}")
        return False
    for k in (0, 2):
        _expect(NUMBER.fullmatch(answers[k].strip()) is not None, f"{answers[k]!r} is no number")
    _expect(abs(float(answers[0]) - 0.25) <= 1e-6 and float(answers[2]) == y, f"{answers}: {y}")
    _expect(re.match(r"[+-]?0+([ ,\t]|$)", answers[1]) is not None, f"the error {answers[1]!r}")
    _expect(-5 <= y <= 5, f"{y} is beyond the limits")
    return True


class Still:
    """A clock for which nothing takes time."""

    def now(self) -> float:
        return 0.0

    def sleep(self, seconds: float) -> None:
        pass


def _bench(source: Any, meter: Any) -> Bench:
    channels = Channel("voltage", "V", -1.0, 1.0), Channel("tip", "mm", -5.0, 5.0)
    return Bench(source, meter, *channels, clock=Still())


def _expect(true: bool, what: str) -> None:
    if not true:
        raise WrongAcceptance(what)


__all__ = ["Reader", "RecordError", "WrongAcceptance", "cells_of", "readers"]
