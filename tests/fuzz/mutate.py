"""Damage: to bytes, to JSON, to tables. Everything follows from the random source given."""

from __future__ import annotations

import copy
import json
from random import Random
from typing import Any

TOKENS = [
    *(
        "nan",
        "-inf",
        "1e999",
        "1e308",
        "5e-324",
        "9.91E37",
        "0",
        "-0",
        "1_000",
        "0x10",
        "1e",
        "--1",
    ),
    *("1,5", "٣", "𝟙", "9" * 400, "true", "null", "[]", "{}", '"', "\\", "\\ud800", "\0", "\r"),
    *("\n", "\t", ";", ",", "\ufeff", "\u2028", "\xa0", "é", "日本", "[" * 300, '{"a":' * 200),
    *("*" * 9, "%s%n", "OK", "ERR", "../../x", "=1+1", "'=1", "\x1b[31m", "\x9b", "\u202e"),
    *("," * 20_000, "[" * 6_000),
]
ODD: list[Any] = [
    *(None, True, 0, -1, 2**63, 10**400, -0.0, 0.5, 1e308, 5e-324, float("nan"), float("-inf")),
    *("", "1", "preisach", "bipolar", "\0", "\ud83d", [], {}, [[]], [1.0, 0.0], [[1.0]], ["1"]),
    *({"a": 1}, [1, [2, [3]]]),
]


def damaged(random: Random, data: bytes, others: list[bytes]) -> bytes:
    """Bytes with one to four things done to them."""
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        start, end = random.randrange(len(data) + 1), random.choice((0, 1, 3, 30))
        before, piece, after = data[:start], data[start : start + end], data[start + end :]
        what = random.randrange(6)
        if what == 0:
            data = before
        elif what == 1:
            data = before + after
        elif what == 2:
            data = before + piece * random.choice((2, 50)) + after
        elif what == 3:
            other = random.choice(others)
            data = before + other[random.randrange(len(other) + 1) :]
        elif what == 4 and piece:
            data = before + bytes([piece[0] ^ 1 << random.randrange(8)]) + data[start + 1 :]
        else:
            data = before + random.choice(TOKENS).encode(errors="surrogatepass") + after
    return data


def odd_json(random: Random, data: bytes) -> bytes:
    """A JSON document with one to three of its parts replaced, removed or moved."""
    content = json.loads(data)
    for _ in range(random.choice((1, 1, 2, 3))):
        holder = _somewhere(random, content)
        if holder is None:
            break
        key = random.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
        what = random.randrange(5)
        if what == 0:
            del holder[key]
        elif what == 1 and isinstance(holder, dict):
            holder[random.choice(("extra", "", "model", "kind", "levels", "é"))] = holder[key]
        elif what == 2 and isinstance(holder[key], float):
            holder[key] *= random.choice((-1, 0, 2, 1e-300, 1e155, 1e300, 1e308))
        elif what == 3:
            for _ in range(random.choice((1, 2, 300))):
                holder[key] = [holder[key]]
        else:
            holder[key] = copy.deepcopy(random.choice(ODD))
    return json.dumps(content, ensure_ascii=False).encode(errors="surrogatepass")


def odd_table(random: Random, text: str) -> bytes:
    """A table with one to three of its cells, rows or separators changed."""
    rows = [line.split(",") for line in text.split("\n")]
    for _ in range(random.choice((1, 1, 2, 3))):
        row, what = random.randrange(len(rows)), random.randrange(8)
        if what == 0:
            rows.insert(row, list(rows[random.randrange(len(rows))]))
        elif what == 1 and len(rows) > 1:
            del rows[row]
        elif what == 2 and rows[row]:
            rows[row].pop()
        elif what == 3:
            rows[row].append(random.choice(TOKENS))
        elif rows[row]:
            cell, token = random.randrange(len(rows[row])), random.choice(TOKENS)
            known = rows[row][cell]
            rows[row][cell] = random.choice((token, f'"{token}"', known + token, f" {known} ", ""))
    comma = random.choices((",", ";", "\t", ", "), (12, 1, 1, 1))[0]
    end = random.choices(("\n", "\r\n", "\r"), (10, 2, 1))[0]
    return end.join(map(comma.join, rows)).encode(errors="surrogatepass")


def _somewhere(random: Random, content: Any) -> Any:
    """A list or object inside a document that is not empty, the deeper ones too."""
    found = None
    while isinstance(content, dict | list) and content:
        found = content
        if random.random() < 0.25:
            break
        content = random.choice(list(content.values()) if isinstance(content, dict) else content)
    return found
