"""One record, one model: command line, Python, lab page and fleet, to the last bit.

``python -m benchmarks.one_model --seed S`` takes ten records of its own from that seed.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import minorloop as ml
from benchmarks._plants import Array
from benchmarks._timing import Row
from benchmarks.real_records import DATA
from minorloop.cli import main as command_line
from minorloop.fleet import identify_fleet, read_manifest
from minorloop.identification.pipeline import Options
from minorloop.modelfile import ModelFile, read
from minorloop.page.lab_work import identify_file, look

WAYS = ("command line", "Python", "page", "fleet")
HOLDOUT = 0.3


@dataclass(frozen=True)
class Table:
    """A file with a record: its columns, and options of the identification."""

    what: str
    file: Path
    columns: dict[str, str]
    options: dict[str, Any] = field(default_factory=dict)


def own_records(folder: Path, seed: int) -> Iterator[Table]:
    """Write ten records of random operators with 6 bands, each with something of its own."""
    rng = np.random.default_rng(seed)
    plain = {"input": "u", "output": "y"}
    for what, make in MADE.items():
        model = ml.Preisach(np.linspace(-1, 1, 7), np.tril(rng.uniform(0.2, 1, (6, 6))))
        turns = rng.uniform(-1, 1, 40)
        u = np.interp(np.arange(780) / 20, np.arange(40), turns)
        y = model.simulate(u) + 0.02 * rng.normal(size=u.size)
        header, cells, more = make(rng, u, y)
        file = folder / f"{what.replace(' ', '-')}.csv"
        lines = [",".join(row) for row in cells]
        file.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
        yield Table(what, file, {**plain, **more})


Made = tuple[str, list[list[str]], dict[str, str]]


def _rows(*columns: Any) -> list[list[str]]:
    rows = zip(*columns, strict=True)
    return [[x if isinstance(x, str) else f"{x:.12g}" for x in row] for row in rows]


def _late(y: Array, rows: int) -> Array:
    return np.concatenate([np.full(rows, y[0]), y[: y.size - rows]])


def _even(rng: Any, u: Array, y: Array) -> Made:
    return "u [V],y [um]", _rows(u, y), {}


def _lagging(rng: Any, u: Array, y: Array) -> Made:
    return "t [s],u [V],y [um]", _rows(0.01 * np.arange(u.size), u, _late(y, 3)), {}


def _uneven(rng: Any, u: Array, y: Array) -> Made:
    t = np.cumsum(rng.uniform(0.005, 0.015, u.size))
    return "time [ms],u [V],y [um]", _rows(1000 * t, u, y), {}


def _uneven_and_late(rng: Any, u: Array, y: Array) -> Made:
    t = np.cumsum(rng.uniform(0.005, 0.015, u.size))
    return "t [s],u [V],y [um]", _rows(t, u, np.interp(t - 0.04, t, y)), {}


def _gap(rng: Any, u: Array, y: Array) -> Made:
    t = 0.01 * np.arange(u.size)
    kept = np.r_[0:150, 250 : u.size]
    return "t [s],u [V],y [um]", _rows(t[kept], u[kept], y[kept]), {}


def _set_back(rng: Any, u: Array, y: Array) -> Made:
    t = 0.01 * np.arange(u.size)
    t[200:] -= 5.0
    return "t [s],u [V],y [um]", _rows(t, u, y), {}


def _curves(rng: Any, u: Array, y: Array) -> Made:
    number = np.arange(u.size) // 130
    return "u [V],y [um],run", _rows(u, y, number), {"curves": "run"}


def _groups(rng: Any, u: Array, y: Array) -> Made:
    names = [f"wire {name}" for name in "abcdef" for _ in range(130)]
    return "u [V],y [um],wire", _rows(u, y, names), {"groups": "wire"}


def _deviations(rng: Any, u: Array, y: Array) -> Made:
    sd = np.where(np.arange(u.size) % 2, 0.02, 0.3)
    return "u [V],y [um],sd [um]", _rows(u, y + sd * rng.normal(size=u.size), sd), {}


def _cells(rng: Any, u: Array, y: Array) -> Made:
    cells = [f"{x:.12g}" for x in y]
    for place in rng.choice(u.size, 40, replace=False):
        cells[place] = ""
    cells[100] = "9.9e37"
    return "u [V],y [um]", _rows(u, cells), {}


MADE: dict[str, Callable[[Any, Array, Array], Made]] = {
    "even": _even,
    "late": _lagging,
    "uneven": _uneven,
    "uneven and late": _uneven_and_late,
    "gap": _gap,
    "clock set back": _set_back,
    "curves": _curves,
    "groups": _groups,
    "deviations": _deviations,
    "empty cells": _cells,
}


def measured_records() -> list[Table]:
    """Return the piezo, wire and magnet records that are there."""
    reversal = {"curves": "curve"}
    above = {"start": "positive", "levels": 25}
    loops = {"start_of_curve": "demagnetised"}
    found = [
        ("piezo", "piezo_micromanipulator_minor_loops", "input_V", "displacement_um", {}, {}),
        ("wire", "forc_feco_nanowires", "field_Oe", "moment_emu", reversal, above),
        ("magnet", "bh_mnzn_ferrite", "H_A_per_m", "B_T", {"curves": "loop"}, loops),
    ]
    return [
        Table(what, file, {"input": input, "output": output, **more}, options)
        for what, name, input, output, more, options in found
        if (file := DATA / f"{name}.csv").is_file()
    ]


def models(table: Table, folder: Path) -> dict[str, tuple[ModelFile, float | None]]:
    """Return the model file of each way, and its error on held-out data."""
    ways = (by_command, by_python, by_page, by_fleet)
    return {way: make(table, folder) for way, make in zip(WAYS, ways, strict=True)}


def by_command(table: Table, folder: Path) -> tuple[ModelFile, float | None]:
    path = folder / "command.json"
    kinds = dict.fromkeys(("curves", "groups", "start", "start_of_curve"), "--record=")
    kinds |= dict.fromkeys(("levels", "lag"), "--law=")
    given = {**table.columns, **table.options, "holdout": HOLDOUT, "save": path}
    words = [f"{kinds.get(name, '--')}{name}={value}" for name, value in given.items()]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        command_line(["identify", str(table.file), *words, "--force"])
    return _read(path)


def by_python(table: Table, folder: Path) -> tuple[ModelFile, float | None]:
    path = folder / "python.json"
    record = ml.read(table.file, **table.columns)  # type: ignore[arg-type]
    found = Options.of({"holdout": HOLDOUT, **table.options}).identify(record)
    ml.save(found, path, input=record.input, output=record.output, force=True)
    return _read(path)


def by_page(table: Table, folder: Path) -> tuple[ModelFile, float | None]:
    """As the page asks, which names the column of time that it was told of."""
    here = os.getcwd()
    (described,) = look(str(table.file.parent), table.file.name)
    place = folder / "page"
    place.mkdir(exist_ok=True)
    (place / table.file.name).write_bytes(table.file.read_bytes())
    columns = {name: _header(described, column) for name, column in table.columns.items()}
    options = {"time": described["time"], "holdout": HOLDOUT, **table.options}
    options |= dict.fromkeys(("levels", "lag", "slope", "diagonal"), "auto") | table.options
    try:
        list(identify_file(str(place), table.file.name, **columns, **options))
    finally:
        os.chdir(here)
    return _read(place / "model.json")


def _header(described: dict[str, Any], name: str) -> str:
    headers = [column["header"] for column in described["columns"]]
    return next(header for header in headers if header.split(" [")[0] == name)


def by_fleet(table: Table, folder: Path) -> tuple[ModelFile, float | None]:
    names = ["specimen", "file", *table.columns]
    cells = ["one", str(table.file), *table.columns.values()]
    (folder / "manifest.csv").write_text(f"{','.join(names)}\n{','.join(cells)}\n")
    specimens = read_manifest(folder / "manifest.csv")
    with tempfile.TemporaryDirectory(dir=folder) as out:
        identify_fleet(specimens, Path(out) / "out", workers=1, holdout=HOLDOUT, **table.options)
        return _read(Path(out) / "out" / "models" / "one.json")


def _read(path: Path) -> tuple[ModelFile, float | None]:
    found = read(path)
    return found, found.provenance.scores.get("nrmse_holdout")


def row(table: Table, folder: Path) -> Row:
    """Compare the four ways on one record."""
    began = time.perf_counter()
    found = models(table, folder)
    first, _ = found["command line"]
    same = [
        file.model == first.model and (file.lag, file.warnings) == (first.lag, first.warnings)
        for file, _ in found.values()
    ]
    errors = ", ".join(f"{error:.6%}" for _, error in found.values())
    return Row(
        f"{table.what}: {', '.join(WAYS)}",
        time.perf_counter() - began,
        required="the same model to the last bit",
        met=all(same),
        accuracy=f"held-out errors {errors}",
    )


def rows(quick: bool = False, seed: int = 0) -> list[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        measured = [] if quick else measured_records()
        return [row(table, folder) for table in [*measured, *own_records(folder, seed)]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the ten records")
    for one in rows(seed=parser.parse_args().seed):
        print(f"{'same' if one.met else 'DIFFERENT':<10} {one.what}; {one.accuracy}")


if __name__ == "__main__":
    main()
