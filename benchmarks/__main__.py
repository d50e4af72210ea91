"""``python -m benchmarks``."""

from __future__ import annotations

import argparse
import importlib
import os

PARTS = ("operators", "identification", "startup")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()

    from rich.console import Console
    from rich.table import Table

    from benchmarks._timing import as_json

    found = []
    for part in chosen.only:
        found += importlib.import_module(f"benchmarks.{part}").rows()
    if chosen.json:
        print(as_json(found))
        return
    table = Table(title=f"{os.cpu_count()} cores", title_justify="left")
    for column in ("what", "measured", "required", "", "accuracy"):
        table.add_column(column, overflow="fold")
    for row in found:
        table.add_row(*row.cells())
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
