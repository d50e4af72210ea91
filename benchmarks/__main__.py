"""``python -m benchmarks``."""

from __future__ import annotations

import argparse
import importlib
import os

import benchmarks

PARTS = (
    "operators",
    "identification",
    "fit_times",
    "one_model",
    "first_use",
    "real_records",
    "kinds_of_records",
    "staircases",
    "optima",
    "prior",
    "advice",
    "twins",
    "camera",
    "calibration",
    "startup",
    "firmware",
    "fleet",
    "console",
    "console_depth",
    "console_devices",
    "meter",
    "long_run",
    "dead_meter",
    "raw_logs",
    "fast_stage",
    "after_effect",
    "group_bands",
    "bands",
    "major_loops",
    "faults",
    "connections",
    "uploads",
)
COLUMNS = ("what", "ours", "the other way", "ratio", "required", "verdict", "accuracy")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=benchmarks.__doc__)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="these parts")
    parser.add_argument("--quick", action="store_true", help="small sizes, no verdicts")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()

    from rich.console import Console
    from rich.table import Table

    from benchmarks._timing import as_json

    found = []
    with Console(stderr=True).status("measuring") as status:
        for part in chosen.only:
            status.update(f"measuring: {part}")
            found += importlib.import_module(f"benchmarks.{part}").rows(chosen.quick)
    if chosen.json:
        print(as_json(found, chosen.quick))
        return
    sizes = ", small sizes" if chosen.quick else ""
    table = Table(title=f"{os.cpu_count()} cores{sizes}", title_justify="left")
    for column in COLUMNS:
        table.add_column(column, overflow="fold")
    for row in found:
        table.add_row(*row.cells(verdict=not chosen.quick))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
