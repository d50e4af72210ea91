"""``python -m faults [INSTANTS]``: faults at every line and at random instants, and the counts."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from faults.instruments import KINDS, SIGNALS, TROUBLES, build_firmware, use_firmware
from faults.runs import FAILURES, Case, Outcome, at_every_line, at_random, carry_out

_TOGETHER = 2
_SHOWN = 10


def count(pool: Executor, name: str, cases: Iterable[Case], whole: Outcome) -> bool:
    """Carry cases out, print a row of counts; whether nothing went wrong."""
    began = time.monotonic()
    found = list(pool.map(partial(carry_out, whole=whole), cases))
    sums = [sum(getattr(one, failure) for one in found) for failure in FAILURES]
    figures = " ".join(f"{figure:>8}" for figure in (len(found), *sums))
    print(f"{name:<32} {figures} {time.monotonic() - began:>8.1f}", flush=True)
    for said in [said for one in found for said in one.said][:_SHOWN]:
        print(f"    {said}", flush=True)
    return not any(sums)


def main(instants: int) -> int:
    """Go through all instruments and faults; 1 if anything went wrong."""
    heads = " ".join(f"{name.replace('_', ' '):>8}" for name in ("cases", *FAILURES))
    print(f"{'':<32} {heads}  seconds", flush=True)
    sound = []
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(
            _TOGETHER,
            get_context("spawn"),
            initializer=use_firmware,
            initargs=(build_firmware(Path(folder)),),
        ) as pool,
    ):
        for kind in KINDS:
            list(pool.map(carry_out, [Case(kind)] * _TOGETHER))  # loads what the others need
            whole = pool.submit(carry_out, Case(kind)).result()
            for fault in (*SIGNALS, "double", *TROUBLES):
                cases = at_every_line(kind, whole.lines, (fault,))
                sound.append(count(pool, f"{kind}, {fault} at each line", cases, whole))
            cases = at_random(kind, -(-instants // len(KINDS)), whole.seconds)
            sound.append(count(pool, f"{kind}, random instants", cases, whole))
    return 0 if all(sound) else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 500))
