"""What the verbs share: options, output as a table or as JSON, progress."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Save = Annotated[Path | None, typer.Option(help="Write the result to this CSV file.")]


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
    """A table on stdout."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    headed = any(columns)
    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        header_style="bold",
        show_header=headed,
        min_width=len(title),
    )
    for number, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if number == 0 else "right")
    for row in rows:
        table.add_row(*map(Text, row))  # as text: units are in square brackets, as markup is
    Console().print(table)


def print_advice(sentences: Sequence[str]) -> None:
    """Advice on stdout, a paragraph each."""
    from rich.console import Console
    from rich.text import Text

    for sentence in sentences:
        Console().print(Text("! ", style="bold yellow") + Text(sentence))


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """Show on stderr, where that is a terminal, that something is being worked on.

    Yields a function that changes what it says.
    """
    if not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda stage: progress.update(task, description=stage)


def read_column(file: Path, column: str) -> FloatArray:
    """One column of a CSV file, without gaps."""
    from minorloop.lab.columns import read_columns

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
            f"rows {text!r} are not A:B; give two whole numbers, such as 200:7000"
        ) from None
    rows = slice(*slice(first, last).indices(total))
    if rows.stop <= rows.start:
        raise RecordError(f"rows {text} hold nothing: the file has {total} rows")
    return rows


def write_csv(path: Path, columns: Mapping[str, Any], *, force: bool) -> None:
    """Columns of equal length by their headers."""
    import csv
    import io

    from minorloop.files import check_writable, write_atomically

    check_writable(path, force=force)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(list(values) for values in columns.values()), strict=True))
    write_atomically(path, text.getvalue())


def check_outputs(paths: Sequence[Path | None], *, force: bool) -> None:
    """Find out before a long computation whether its results can be written."""
    from minorloop.errors import OutputError
    from minorloop.files import check_writable

    wanted = [path for path in paths if path is not None]
    for path in wanted:
        try:
            check_writable(path, force=force)
        except OutputError as error:
            raise OutputError(str(error).replace("or force to", "or --force to")) from None
    if len({path.absolute() for path in wanted}) < len(wanted):
        raise OutputError(f"{wanted[0]} is named for two results; give each a file of its own")
