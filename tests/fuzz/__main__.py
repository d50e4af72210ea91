"""``python -m fuzz [CASES]``: that many cases, and the counts; status 1 if one went wrong."""

from __future__ import annotations

import faulthandler
import sys
import tempfile
from pathlib import Path

from fuzz.counts import LONGEST, knock, table
from fuzz.doors import doors

SHARES = {"model files": 5, "records": 5, "plans": 2, "manifests": 2, "serial line": 3, "SCPI": 3}
SHARES |= {"texts": 4, "floods": 1}


def main(cases: int) -> int:
    faulthandler.enable()
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        for door in doors(Path(scratch)):
            # A loop that no signal interrupts ends the program, with a traceback.
            faulthandler.dump_traceback_later(6 * LONGEST + cases / 100, exit=True)
            found.append(knock(door, range(cases * SHARES[door.name] // sum(SHARES.values()))))
    faulthandler.cancel_dump_traceback_later()
    for one in found:
        print(*one.told, sep="\n", end="\n" if one.told else "")
    print(table(found))
    return 0 if all(one.sound for one in found) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000))
