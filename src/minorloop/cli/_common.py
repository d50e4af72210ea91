"""What the verbs share: options, output as a table or as JSON, progress."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.errors import MinorloopError, OutputError, ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.lab.actuator import Actuator
    from minorloop.report import Report


_EVERY = 10.0
"""Seconds between lines of a log."""


def whole(text: str) -> int:
    """A whole number, for the parser of options."""
    try:
        return int(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a whole number") from None


def number(text: str) -> float:
    """A number, for the parser of options."""
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a number") from None


def whole_option(help: str, *, panel: str | None = None) -> Any:
    """An option that takes a whole number; its help stands in a panel of that title."""
    return typer.Option(parser=whole, metavar="N", help=help, rich_help_panel=panel)


def number_option(help: str, *, panel: str | None = None) -> Any:
    """An option that takes a number; its help stands in a panel of that title."""
    return typer.Option(parser=number, metavar="X", help=help, rich_help_panel=panel)


DataFile = Annotated[
    Path, typer.Argument(help="CSV file: one header line, then numbers.", show_default=False)
]
ModelFile = Annotated[
    Path, typer.Argument(help="Model file, as identify --save writes it.", show_default=False)
]
Start = Annotated[
    str,
    typer.Option(help="Memory before the first row: negative, positive or demagnetised."),
]
Save = Annotated[Path | None, typer.Option(help="Write the result to this CSV file.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def print_json(content: Mapping[str, Any]) -> None:
    """One JSON object on stdout; numbers that are not finite become null."""
    print(json.dumps(_plain(content), allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not -float("inf") < value < float("inf"):
        return None
    return value


def print_table(columns: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> None:
    """A table on stdout, under its title."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(header_style="bold", show_header=any(columns))
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if index == 0 else "right")
    for row in rows:
        table.add_row(*map(Text, row))  # as text: units are in square brackets, as markup is
    if title:
        typer.echo(title)
    Console().print(table)


def print_advice(sentences: Sequence[str]) -> None:
    """Advice on stdout, a paragraph each."""
    from rich.console import Console
    from rich.text import Text

    for sentence in sentences:
        Console().print(Text("! ", style="bold yellow") + Text(sentence))


def print_warnings(sentences: Sequence[str]) -> None:
    """What a model file says against its model, on stderr, a line each."""
    for sentence in sentences:
        typer.echo(f"warning: this model is not to be trusted: {sentence}", err=True)


@contextmanager
def working(what: str, *, logged: bool = False) -> Iterator[Callable[[str], None]]:
    """Show on stderr, where that is a terminal, that something is being worked on.

    Yields a function that changes what it says. Nothing may be printed meanwhile. Where stderr is
    no terminal and it is to be logged, what is said is a line there, no more than one in ten
    seconds.
    """
    if not sys.stderr.isatty():
        yield _logger() if logged else lambda stage: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda stage: progress.update(task, description=stage)


def _logger() -> Callable[[str], None]:
    due = time.monotonic()

    def log(stage: str) -> None:
        nonlocal due
        if time.monotonic() >= due:
            typer.echo(stage, err=True)
            due = time.monotonic() + _EVERY

    return log


@contextmanager
def connected(address: str, **options: Any) -> Iterator[Actuator]:
    """Yield the actuator at an address; let go of its instruments at the end.

    A signal that ends the process is an exception in here. From before the first line to an
    instrument to after the last, none cuts one in half.
    """
    from minorloop.connect import connect
    from minorloop.lab.signals import Deferred, ended_by_signals

    with ended_by_signals():
        plant = connect(address, **options)
        try:
            for warning in getattr(plant, "warnings", ()):
                typer.echo(f"! {warning}", err=True)
            yield plant
        finally:
            with Deferred():
                getattr(plant, "close", lambda: None)()


def read_column(file: Path, column: str, unit: str = "") -> FloatArray:
    """One column of a CSV file, without gaps, refused if its header names another unit."""
    from minorloop.lab.columns import find_column, read_columns, read_headers, split_header

    header = find_column(column, read_headers(file), source=file)
    found = split_header(header)[1]
    if found and unit and found != unit:
        raise RecordError(
            f"column '{header}' of {file} is in {found} and the model in {unit}; "
            f"give the column in {unit}"
        )
    return read_columns(file, [column])[column]


def as_rows(text: str | None, total: int) -> slice:
    """Rows ``A:B``, from A up to but not including B, counted from 0 as Python does."""
    if text is None:
        return slice(0, total)
    parts = text.split(":")
    try:
        first, last = (int(part) if part.strip() else None for part in parts)
    except ValueError:
        raise ParameterError(
            f"--rows is {text!r}; give two whole numbers A:B, such as 200:7000"
        ) from None
    for end in (first, last):
        if end is not None and not -total <= end <= total:
            raise ParameterError(
                f"--rows is {text!r}, and the file has {total} rows; give A:B from 0 to {total}"
            )
    rows = slice(*slice(first, last).indices(total))
    if rows.stop <= rows.start:
        raise ParameterError(f"--rows is {text!r}, which holds no row; give A:B with A below B")
    return rows


def write_csv(path: Path, columns: Mapping[str, Any], *, force: bool) -> None:
    """Columns of equal length by their headers."""
    from minorloop.files import check_writable, table_text, write_atomically

    check_writable(path, force=force)
    rows = zip(*(list(values) for values in columns.values()), strict=True)
    write_atomically(path, table_text(columns, rows))


def write_report(draw: Callable[[], Report], path: Path, *, force: bool) -> None:
    """Draw a report and write it; whatever goes wrong in drawing is one sentence."""
    try:
        draw().write(path, force=force)
    except MinorloopError:
        raise
    except Exception as error:
        raise OutputError(f"{path} was not written, the report cannot be drawn: {error}") from error


def do_all(steps: Iterable[Callable[[], None]]) -> None:
    """Do every step, whatever became of those before it; then raise the first error.

    For what follows a long computation, so that one result that cannot be written does not
    take the others with it.
    """
    errors: list[Exception] = []
    for step in steps:
        try:
            step()
        except Exception as error:
            errors.append(error)
    if errors:
        raise errors[0]


def check_outputs(
    paths: Sequence[Path | None], *, force: bool, inputs: Sequence[Path] = ()
) -> None:
    """Find out before a long computation whether its results can be written.

    Parameters
    ----------
    paths : sequence of path
        Files that are going to be written; None where one was not asked for.
    force : bool
        Whether files that exist may be replaced.
    inputs : sequence of path
        Files that are going to be read, which are never replaced.

    Raises
    ------
    OutputError
        If one of them cannot be written, is read, or is named twice.
    """
    from minorloop.files import check_writable

    read, written = {os.path.realpath(path) for path in inputs}, set()
    for path in paths:
        if path is None:
            continue
        check_writable(path, force=True)
        place = os.path.realpath(path)
        if place in read:
            raise OutputError(f"{path} is read here and is not replaced; give another name")
        if place in written:
            raise OutputError(f"{path} is named for two results; give each a file of its own")
        if path.exists() and not force:
            raise OutputError(f"{path} exists already; give another name, or --force to replace it")
        written.add(place)
