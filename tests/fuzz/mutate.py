"""Damage: to bytes, to JSON, to tables. Everything follows from the random source given."""

from __future__ import annotations

import copy
import json
from random import Random
from typing import Any

TOKENS = [
    *("NaN", "nan", "-nan", "Infinity", "-inf", "1e999", "-1e999", "1e308", "-1e308", "5e-324"),
    *("0", "-0", "0.0", "1_000", "0x10", "1e", "--1", "1,5", "٣", "1", "𝟙", "1e+-3", "9" * 400),
    *("true", "null", "[]", "{}", '""', '"', "'", "\\", "\\u0000", "\\ud800", "\0", "\x1a", "\r"),
    *("\n", "\r\n", "\t", ";", ",", "\ufeff", "\u2028", "\xa0", "é", "日本", "\U0001f600"),
    *("[" * 300, "{" * 300, "]" * 9, "}" * 9, '{"a":' * 200, " " * 50, "*" * 9, "%s%n", "OK"),
    *("ERR", "../../x", "=1+1", "+1", "-x", "@a", "'=1", "'@a", "\x1b[31m", "\x7f", "\x85"),
    *("\x9b", "\u202e", "\u2029"),
    *("9.9e37", "-9.9e37", "+9.90000000E+37", "9.91E37", "-9999", "9.99999999e9", "OVLD", "OL"),
    *("," * 3_000, ";" * 3_000, "," * 20_000, "[" * 6_000),
]
ODD: list[Any] = [
    *(None, True, False, 0, 1, -1, 2**31, 2**63, 10**400, -0.0, 0.5, 1e300, 1e308, -1e308, 5e-324),
    *(float("nan"), float("inf"), float("-inf"), "", "1", "preisach", "bipolar", "\0", "\ud83d"),
    "é",
    *([], {}, [[]], [1.0], [1.0, 0.0], [[1.0]], [None], ["1"], {"a": 1}, [[[[]]]], [1, [2, [3]]]),
]


def damaged(random: Random, data: bytes, others: list[bytes]) -> bytes:
    """Bytes with one to four things done to them."""
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        data = random.choice((_flip, _cut, _drop, _double, _token, _token, _splice))(
            random, data, others
        )
    return data


def odd_json(random: Random, data: bytes) -> bytes:
    """A JSON document with one to three of its parts replaced, removed, moved or said twice."""
    content = json.loads(data)
    for _ in range(random.choice((1, 1, 2, 3))):
        holder = _somewhere(random, content)
        if holder is None:
            break
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        key = random.choice(keys)
        what = random.randrange(6)
        if what == 0:
            del holder[key]
        elif what == 1 and isinstance(holder, dict):
            holder[random.choice(("extra", "", "model", "kind", "levels", "é"))] = holder[key]
        elif what == 1:
            holder.insert(key, copy.deepcopy(holder[random.randrange(len(holder))]))
        elif what == 2:
            holder[key] = _nested(random, holder[key])
        elif what == 3 and isinstance(holder[key], float):
            holder[key] = holder[key] * random.choice((-1, 0, 2, 1e-300, 1e155, 1e300, 1e308))
        else:
            holder[key] = copy.deepcopy(random.choice(ODD))
    text = json.dumps(content, ensure_ascii=random.random() < 0.5)
    if random.random() < 0.15:
        text = _said_twice(random, text)
    return text.encode(errors="surrogatepass")


def odd_table(random: Random, text: str) -> str:
    """A table with one to three of its cells, rows or separators changed."""
    rows = [line.split(",") for line in text.split("\n")]
    for _ in range(random.choice((1, 1, 2, 3))):
        row = random.randrange(len(rows))
        what = random.randrange(8)
        if what == 0:
            rows.insert(row, list(rows[random.randrange(len(rows))]))
        elif what == 1 and len(rows) > 1:
            del rows[row]
        elif what == 2 and rows[row]:
            rows[row].pop()
        elif what == 3:
            rows[row].append(random.choice(TOKENS))
        elif rows[row]:
            cell = random.randrange(len(rows[row]))
            token = random.choice(TOKENS)
            rows[row][cell] = random.choice(
                (token, f'"{token}"', rows[row][cell] + token, f" {rows[row][cell]} ", "")
            )
    comma = random.choices((",", ";", "\t", ", "), (12, 1, 1, 1))[0]
    return random.choices(("\n", "\r\n", "\r"), (10, 2, 1))[0].join(map(comma.join, rows))


def _flip(random: Random, data: bytes, others: list[bytes]) -> bytes:
    changed = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 8))):
        if changed:
            changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def _cut(random: Random, data: bytes, others: list[bytes]) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _drop(random: Random, data: bytes, others: list[bytes]) -> bytes:
    start = random.randrange(len(data) + 1)
    return data[:start] + data[start + random.choice((1, 2, 5, 30)) :]


def _double(random: Random, data: bytes, others: list[bytes]) -> bytes:
    start = random.randrange(len(data) + 1)
    piece = data[start : start + random.choice((1, 3, 20, 200))]
    return data[:start] + piece * random.choice((2, 2, 50)) + data[start:]


def _token(random: Random, data: bytes, others: list[bytes]) -> bytes:
    start = random.randrange(len(data) + 1)
    gone = random.choice((0, 0, 1, 4))
    token = random.choice(TOKENS).encode(errors="surrogatepass")
    return data[:start] + token + data[start + gone :]


def _splice(random: Random, data: bytes, others: list[bytes]) -> bytes:
    other = random.choice(others)
    return data[: random.randrange(len(data) + 1)] + other[random.randrange(len(other) + 1) :]


def _somewhere(random: Random, content: Any) -> Any:
    """A list or object inside a document that is not empty, the deeper ones too."""
    found = None
    while isinstance(content, dict | list) and content:
        found = content
        children = list(content.values()) if isinstance(content, dict) else content
        if random.random() < 0.25:
            break
        content = random.choice(children)
    return found


def _nested(random: Random, value: Any) -> Any:
    for _ in range(random.choice((1, 2, 300))):
        value = [value] if random.random() < 0.5 else {"a": value}
    return value


def _said_twice(random: Random, text: str) -> str:
    """A key of some object once more, with the same value or another, which a parser may miss."""
    marks = [k for k, letter in enumerate(text) if letter == "{"]
    if not marks:
        return text
    start = random.choice(marks) + 1
    end = text.find(":", start)
    if end < 0:
        return text
    value = random.choice(("1", "null", "[0.0, 1.0]", '"x"', "{}"))
    return f"{text[:start]}{text[start:end]}: {value}, {text[start:]}"
