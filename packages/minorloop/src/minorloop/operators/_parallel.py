"""Run a loop over independent signals on all cores."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def in_parallel(work: Callable[[int], None], rows: int) -> None:
    """Call ``work(row)`` for every row in threads; compiled loops release the GIL."""
    workers = min(rows, os.cpu_count() or 1)
    if workers < 2:
        for row in range(rows):
            work(row)
        return
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(work, range(rows)))
