"""``python -m fuzz [CASES]``: run cases and print the counts; status 1 if one fails."""

from __future__ import annotations

import faulthandler
import sys
import tempfile
from pathlib import Path

from fuzz.counts import LONGEST, run_cases, table
from fuzz.readers import readers

SHARES = {"model files": 5, "records": 5, "plans": 2, "manifests": 2, "serial line": 3, "SCPI": 3}
SHARES |= {"texts": 4, "floods": 1}


def main(cases: int) -> int:
    faulthandler.enable()
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        for reader in readers(Path(scratch)):
            # A loop that no signal interrupts ends the program, with a traceback.
            faulthandler.dump_traceback_later(6 * LONGEST + cases / 100, exit=True)
            share = cases * SHARES[reader.name] // sum(SHARES.values())
            found.append(run_cases(reader, range(share)))
    faulthandler.cancel_dump_traceback_later()
    for one in found:
        print(*one.notes, sep="\n", end="\n" if one.notes else "")
    print(table(found))
    return 0 if all(one.sound for one in found) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000))
