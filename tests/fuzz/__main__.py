"""``python -m fuzz [CASES]``: run cases and print the counts; status 1 if one fails."""

from __future__ import annotations

import faulthandler
import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from random import Random

from fuzz.readers import Reader, WrongAcceptance, readers

SHOWN = 5
LONGEST = 60.0
"""Seconds after which the cases of a reader are thought to hang, beside 10 ms for each."""


def run_cases(reader: Reader, count: int) -> tuple[int, list[str]]:
    """Number of accepted cases of a reader, each made from its number, and notes on failures."""
    accepted, failures = 0, []
    for number in range(count):
        case = reader.make(Random(f"{reader.name} {number}"))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                accepted += reader.accepts(case)
        except Exception as error:
            wrong = isinstance(error, WrongAcceptance)
            said = f"wrongly accepted: {error}" if wrong else traceback.format_exc(limit=-4)
            failures.append(f"{reader.name}, case {number}: {said}\n    {case!r:.2000}")
    return accepted, failures


def main(cases: int) -> int:
    sound = True
    with tempfile.TemporaryDirectory() as scratch:
        every = readers(Path(scratch))
        for reader in every:
            # A case that hangs ends the program, with a traceback.
            faulthandler.dump_traceback_later(LONGEST + cases / 100, exit=True)
            count = cases // len(every)
            accepted, failures = run_cases(reader, count)
            print(f"{reader.name:<12} {count:>7} cases {accepted:>7} accepted", end="")
            print(f" {len(failures):>5} failures", *failures[:SHOWN], sep="\n", flush=True)
            sound &= not failures
    faulthandler.cancel_dump_traceback_later()
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000))
