"""A case: something that gives figures for fixed inputs and seeds."""

from __future__ import annotations

import io
import json
import os
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from minorloop.cli import main

FIGURES = Path(__file__).parent / "figures"
MEASURED = Path(__file__).parents[3] / "shared" / "data"
"""Folder of measured records, which are not part of the project."""
TIMES = ("*seconds*", "*created*", "*version*", "*elapsed*", "*.began", "*.ended", "*.started")
"""Names of figures that a machine decides."""


@dataclass(frozen=True)
class Case:
    """A case by its name, the function that gives its figures, and their tolerances.

    Parameters
    ----------
    name : str
        Name of its file of figures.
    run : callable
        Returns the figures; the current folder is empty and its own.
    quick : bool
        Whether it takes seconds, and runs with the tests.
    measured : tuple of str
        Files of the measured records that it reads.
    bands : mapping
        Relative tolerance by a pattern of the name of a figure.
    left_out : tuple of str
        Patterns of names of figures that do not count.
    """

    name: str
    run: Callable[[], Any]
    quick: bool = True
    measured: tuple[str, ...] = ()
    bands: Mapping[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    @property
    def file(self) -> Path:
        """File of its figures."""
        return FIGURES / f"{self.name}.txt"

    @property
    def missing(self) -> list[str]:
        """Measured records that it needs and that are not there."""
        return [name for name in self.measured if not (MEASURED / name).is_file()]


@contextmanager
def within(folder: Path) -> Iterator[None]:
    """Make a folder the current one."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def command(line: str, program: Callable[[list[str]], int] = main) -> Any:
    """Return the exit status of a command line, and the JSON object or the error that it prints."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = program(shlex.split(line))
    try:
        answer = json.loads(out.getvalue())
    except ValueError:
        answer = {"error": err.getvalue().splitlines()[-1:]}
    return {"status": status, "answer": answer}


def commands(lines: Mapping[str, str]) -> dict[str, Any]:
    """Return what each command line gives, by name."""
    return {name: command(f"{line} --json") for name, line in lines.items()}
