"""``python -m expected write|compare [--quick] [CASE ...]``: write figures, or compare them."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

from expected import figures
from expected.case import TIMES, Case, within
from expected.cases import CASES


def computed(case: Case) -> figures.Figures:
    """Return the figures of a case as the code gives them now."""
    left_out = (*case.left_out, *TIMES)
    with tempfile.TemporaryDirectory() as folder, within(Path(folder)):
        return figures.lines(case.run(), left_out)


def compared(case: Case) -> list[str]:
    """Return a line for each figure of a case that is not what was expected."""
    try:
        after = computed(case)
    except Exception as error:
        return [f"{case.name}: {type(error).__name__}: {error}"]
    if not case.file.is_file():
        return [f"{case.name}: no expected figures; write them with: make expected"]
    found = figures.differences(figures.read(case.file), after, case.bands)
    return [f"{case.name}: {line}" for line in found]


def main(arguments: Sequence[str] | None = None) -> int:
    """Go through the cases; 1 if a figure differs."""
    parser = argparse.ArgumentParser(prog="expected", description=__doc__)
    parser.add_argument("action", choices=("write", "compare"))
    parser.add_argument("--quick", action="store_true", help="only cases that take seconds")
    parser.add_argument("cases", nargs="*", help="names of cases, all of them if none is given")
    given = parser.parse_args(arguments)
    unknown = set(given.cases) - {case.name for case in CASES}
    if unknown:
        parser.error(f"no case {sorted(unknown)}; there are {[case.name for case in CASES]}")
    chosen = [
        case
        for case in CASES
        if (case.name in given.cases or not given.cases) and (case.quick or not given.quick)
    ]
    different = 0
    for case in chosen:
        if case.missing:
            print(f"{case.name}: SKIPPED, {', '.join(case.missing)} is not there", flush=True)
            continue
        began = time.monotonic()
        if given.action == "write":
            try:
                figures.write(case.file, computed(case))
            except Exception:
                traceback.print_exc()
                different += 1
        else:
            told = compared(case)
            different += len(told)
            print("".join(f"{line}\n" for line in told), end="")
        print(f"{case.name}: {time.monotonic() - began:.1f} s", file=sys.stderr, flush=True)
    if given.action == "compare":
        print(f"{len(chosen)} cases, {different} differences")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
