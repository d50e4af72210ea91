"""The readers under test, their damaged input, and an independent check of what they accept."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from board_process import OneChannelBoard
from fuzz.mutate import TOKENS, damaged, odd_json, odd_table
from minorloop import PrandtlIshlinskii, Preisach, modelfile
from minorloop.errors import InstrumentError, LimitError, MinorloopError
from minorloop.fleet.manifest import read_manifest
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.logs import read_log
from minorloop.lab.plan import Plan
from minorloop.operators.polynomial import Polynomial

NUMBER = re.compile(r"[ \t]*[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?[ \t]*", re.ASCII)
RECORDS = [
    "time [s],voltage [V],tip [mm]\n0,0.5,1\n1,-0.5,2.25\n2,1e-3,-3\n3,0,nan\n",
    'time,voltage,tip,"a, note"\n1,2,3,"x"\n2,3,4,"y, z"\n',
    "\ufefftip [mm];voltage [V];time [ms]\n1;2;3\n1.5;2.5;4\n",
]
PLANS = ["voltage [V],hold [s],shortest hold [s]\n0,10,2\n1,20,3\n-1,5,1\n", "u,hold [min]\n0,1\n"]
MANIFESTS = [
    "specimen,file,input,output\na,a.csv,u,y\nb,b.csv,,tip [mm]\n",
    'specimen,file\n"one, two",x.csv\nthree,"y ""z"".csv"\n',
]


class WrongAcceptance(Exception):
    """A reader accepted invalid input, or read it as something else."""


def expect(true: bool, what: str) -> None:
    if not true:
        raise WrongAcceptance(what)


@dataclass(frozen=True)
class Reader:
    """A reader under test: its name, what makes a case, and whether a case is accepted.

    ``accepts`` raises `WrongAcceptance` if that is wrong; any other error is a defect.
    """

    name: str
    make: Callable[[Random], Any]
    accepts: Callable[[Any], bool]


def readers(scratch: Path) -> list[Reader]:
    """Return all readers; files are written into a folder."""
    models, file = _model_files(scratch), scratch / "case"

    def make_model(random: Random) -> bytes:
        data = random.choice(models)
        return odd_json(random, data) if random.random() < 0.6 else damaged(random, data, models)

    def table(texts: list[str]) -> Callable[[Random], bytes]:
        encoded = [text.encode() for text in texts]

        def make(random: Random) -> bytes:
            k = random.randrange(len(texts))
            if random.random() < 0.65:
                return odd_table(random, texts[k])
            return damaged(random, encoded[k], encoded)

        return make

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
        Reader("records", table(RECORDS), through(_read_table)),
        Reader("plans", table(PLANS), through(_read_plan)),
        Reader("manifests", table(MANIFESTS), through(_read_manifest)),
        Reader("serial line", _make_lines, _converse),
    ]


def _model_files(scratch: Path) -> list[bytes]:
    data, path = [], scratch / "model.json"
    for model in (
        Preisach([-1.0, 0.0, 0.5, 1.0], np.tril(np.ones((3, 3))), 0.5, slope=0.1),
        PrandtlIshlinskii([0.0, 0.2, 0.7], [1.0, 0.5, 0.25], 0.1),
        Polynomial([0.0, 1.0, 0.2], -1.0, 1.0),
    ):
        said = ["the output is clipped"] if data else []
        modelfile.save(model, path, input="voltage [V]", lag=1, warnings=said, force=True)
        data.append(path.read_bytes())
    return data


def _read_model(path: Path, data: bytes) -> None:
    found = modelfile.read(path)
    try:
        content = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise WrongAcceptance(f"another parser says: {error}") from None
    keys = {"format", "version", "input", "output", "lag", "model", "provenance"}
    expect(set(content) - {"warnings"} == keys, f"keys {set(content) ^ keys}")
    expect(type(content["lag"]) is int and found.lag == content["lag"] >= 0, "lag")
    expect(list(found.warnings) == content.get("warnings", []), "warnings")
    expect({"name": found.input.name, "unit": found.input.unit} == content["input"], "input")
    said = dict(content["model"])
    expect(said.pop("kind") == found.kind, "kind")
    for name, value in said.items():
        held = getattr(found.model, name)
        if isinstance(value, str):
            expect(held == value, name)
            continue
        if isinstance(value, list) and value and isinstance(value[0], list):
            value = [[*row, *[0.0] * (len(value) - len(row))] for row in value]
        numbers = np.ravel(np.array(value, dtype=object))
        expect(all(type(one) in (int, float) for one in numbers), f"{name} is {value!r}")
        expect(bool(np.isfinite(held).all()), f"{name} is not finite")
        expect(np.array_equal(held, np.array(value, dtype=np.float64)), f"{name} differs")


def _read_table(path: Path, data: bytes) -> None:
    record = read_log(path, input="voltage", output="tip", time=None)
    expect(bool(np.isfinite(record.u).all()), "a gap among inputs")
    cells = re.split('[,;\\t\\r\\n"]', data.decode("utf-8", errors="replace"))
    numbers = {float(cell) for cell in cells if NUMBER.fullmatch(cell)}
    read = {*record.u, *record.y[np.isfinite(record.y)]}
    expect(read <= numbers, f"numbers that are not in the file: {read - numbers}")
    timed = read_log(path, input="voltage", output="tip", time="time")
    expect(bool((np.diff(timed.t) >= 0).all()), "time runs backwards")


def _read_plan(path: Path, data: bytes) -> None:
    plan = Plan.from_csv(path)
    expect(bool((plan.longest > 0).all()), "a hold that is not positive")
    expect(bool(np.isfinite(plan.longest).all()), "a hold without end")


def _read_manifest(path: Path, data: bytes) -> None:
    specimens = read_manifest(path, input="u", output="y")
    expect(len({one.key for one in specimens}) == len(specimens), "results that coincide")
    for one in specimens:
        expect(one.key not in ("", ".", "..") and not {"/", "\0"} & set(one.key), "key")


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


class Still:
    """A clock for which nothing takes time."""

    def now(self) -> float:
        return 0.0

    def sleep(self, seconds: float) -> None:
        pass


def sealed(sequence: int, body: str) -> str:
    """An answer with its sum."""
    text = f"{sequence} {body} "
    return f"{text}*{zlib.crc32(text.encode(errors='surrogatepass')):08X}"


def _word(random: Random) -> str:
    number, token = f"{random.uniform(-2, 2):.9g}", random.choice(TOKENS)
    return random.choices((number, token, number + token), (3, 2, 1))[0]


def _damaged_line(random: Random, line: str) -> str:
    return damaged(random, line.encode(), [line.encode()]).decode("utf-8", errors="replace")


def _make_lines(random: Random) -> list[str]:
    """What a board says to HELLO, SET 0.25 and GET; some of it damaged, late or twice."""
    lines = [sealed(1, "OK minorloop 2 -1 1 1000")]
    for sequence, word in ((2, "0.25"), (3, _word(random))):
        right = sealed(sequence, f"OK {word}")
        for _ in range(random.choice((0, 0, 1, 3))):
            late = sealed(random.choice((1, 2, 3, 65535)), f"OK {_word(random)}")
            wrong = sealed(sequence, f"{random.choice(('ERR', 'ok', ''))} 1 {_word(random)}")
            lines.append(random.choice((late, wrong, _damaged_line(random, right), lines[-1])))
        lines.append(right if random.random() < 0.7 else _damaged_line(random, right))
    return lines


def _converse(lines: list[str]) -> bool:
    wire = Wire(lines)
    try:
        board = OneChannelBoard(wire)
        channels = Channel("voltage", "V", -1.0, 1.0), Channel("tip", "mm", -5.0, 5.0)
        y = Bench(board, board, *channels, clock=Still()).exchange(0.25)
    except (InstrumentError, LimitError):
        if any(" SET " in line for line in wire.sent):
            expect(" SAFE " in wire.sent[-1], f"not made safe: {wire.sent}")
        return False
    given = [line.split(" ") for line in lines if re.match(r"3 OK [^ ]+ \*\w{8}$", line, re.ASCII)]
    right = [words for words in given if sealed(3, " ".join(words[1:-1])).endswith(words[-1])]
    expect(any(NUMBER.fullmatch(w[2]) and float(w[2]) == y for w in right), f"{given} gave {y}")
    expect(-5 <= y <= 5, f"{y} is beyond the limits")
    return True
