"""Options, output and progress that several verbs share."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer

from minorloop import values
from minorloop.cli._compilation import compilation_said
from minorloop.errors import MinorloopError, OutputError, ParameterError, all_done

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop.report import Report as Drawn


NONE = "none"
"""Given instead of the name of a column to use no such column."""


def _parser(kind: type[Any], what: str) -> Callable[[str], Any]:
    def parse(text: str) -> Any:
        try:
            return kind(text)
        except ValueError:
            raise typer.BadParameter(f"{text!r} is not {what}") from None

    return parse


whole, number = _parser(int, "a whole number"), _parser(float, "a number")
"""Parsers of options."""


def whole_option(help: str) -> Any:
    """Return an option for a whole number."""
    return typer.Option(parser=whole, metavar="N", help=help)


def number_option(help: str) -> Any:
    """Return an option for a number."""
    return typer.Option(parser=number, metavar="X", help=help)


def seconds_option(help: str) -> Any:
    """Return an option for a number of seconds, which must be positive and finite."""
    return typer.Option(parser=number, metavar="X", help=help, callback=_positive)


def _positive(param: typer.CallbackParam, value: float | None) -> float | None:
    if value is not None and not 0 < value < float("inf"):
        option = str(param.name).replace("_", "-")
        raise ParameterError(f"--{option} is {value:g}; give a positive number of seconds")
    return value


def plain(help: str) -> str:
    """Return a help text with square brackets escaped: they enclose units and are no markup."""
    return help.replace("[", r"\[")


DataFile = Annotated[
    Path, typer.Argument(help="Table with one header line: CSV, .mat or .xlsx.", show_default=False)
]
ModelFile = Annotated[
    Path, typer.Argument(help="Model file, as identify --save writes it.", show_default=False)
]
Start = Annotated[
    str, typer.Option(help="Memory before the first row: negative, positive or demagnetised.")
]
Address = Annotated[
    str,
    typer.Option(
        show_default=False,
        help="Its address, such as bench:bench.toml or twin:ipmc; a twin may have options, as "
        "twin:ipmc,specimen=3,noise=0.05,seed=4. See minorloop devices.",
    ),
]
Input = Annotated[
    str | None,
    typer.Option(help="Input of an actuator with several; the one in the plan without it."),
]
Output = Annotated[
    str | None,
    typer.Option(help="Output of an actuator with several; that of the input without it."),
]
Time = Annotated[
    str | None,
    typer.Option(
        help="Column of time: in s, ms, us, min, h or d by its header, or date or time of day."
    ),
]
Holdout = Annotated[
    float, number_option("Share at the end that is scored, not fitted, 0 to 0.9; try 0.3.")
]
Save = Annotated[Path | None, typer.Option(help="Write the result to this CSV file.")]
Report = Annotated[Path | None, typer.Option(help="Write an HTML report to this file.")]
Target = Annotated[str, typer.Option(help="Column of the target outputs, in order.")]
NewStore = Annotated[Path, typer.Option(show_default=False, help="New file for the points.")]
Convert = Annotated[
    str | None,
    typer.Option(
        metavar="KIND:NUMBERS",
        help="Convert the readings: laser:D0,H0[,SD,SD] (distance to the straight strip, height "
        "above the clamp and their standard deviations, to curvature, positive towards the laser), "
        "linear:GAIN[,OFFSET], polynomial:C0,C1,... or table:FILE (two columns); all but the first "
        "also with name=, unit= and calibration_sd= of the result.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Show all scores and advice.")]


def numbers(name: str, text: str, counts: Any, form: str) -> list[float]:
    """Return the numbers of an option, separated by commas."""
    return values.numbers(text, counts, f"--{name}", form)


def check_word(what: str, word: str, known: Sequence[str]) -> None:
    """Refuse an argument that is not one of the known words."""
    if word not in known:
        raise ParameterError(f"there is no {what} {word!r}; give one of {', '.join(known)}")


def refuse_given(options: Mapping[str, Any], why: str) -> None:
    """Refuse options that are not None; ``why`` completes the message."""
    for name, value in options.items():
        if value is not None:
            raise ParameterError(f"--{name.replace('_', '-')} {why}; leave it out")


_json_missing = False
"""Whether a JSON object is still to be printed on stdout."""
_beside: dict[str, Any] = {}
"""Content to add to the JSON object of an error that ends the command."""


def expect_json(expected: bool) -> None:
    """Note at the beginning of a command whether it prints JSON."""
    global _json_missing
    _json_missing = expected
    _beside.clear()


def print_beside_error(content: Mapping[str, Any]) -> None:
    """Store content to add to the JSON object of an error, if one ends the command."""
    _beside.update(content)


def print_json(content: Mapping[str, Any]) -> None:
    """Print one JSON object on stdout; numbers that are not finite become null."""
    expect_json(False)
    print(json_text(content))


def json_text(content: Mapping[str, Any]) -> str:
    """Return one JSON object; numbers that are not finite become null."""
    return json.dumps(_plain(content), allow_nan=False)


def print_missing_json(content: Mapping[str, Any]) -> None:
    """Print an object instead of an expected result; nothing if no result is expected any more."""
    if _json_missing:
        print_json({**content, **_beside})


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
    """Print a table on stdout, under its title."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(header_style="bold", show_header=any(columns))
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))  # as text: units are in square brackets, as markup is
    if title:
        typer.echo(title)
    Console().print(table)


def print_advice(sentences: Sequence[str]) -> None:
    """Print advice on stdout, one paragraph each."""
    for sentence in sentences:
        print_sentence(sentence, "! ")


def print_sentence(sentence: str, mark: str = "") -> None:
    """Print a sentence on stdout after a mark, wrapped to the width of the terminal."""
    from rich.console import Console
    from rich.text import Text

    Console().print(Text(mark, style="bold yellow") + Text(sentence))


def print_warnings(sentences: Sequence[str]) -> None:
    """Print the warnings of a model file on stderr, one line each."""
    for sentence in sentences:
        typer.echo(f"warning: this model is not to be trusted: {sentence}", err=True)


class Progress(Protocol):
    """Shows the progress of a command."""

    def __call__(self, stage: str, *, kept: bool = False) -> None:
        """Show a text until the next one, or permanently on its own line if ``kept``."""


@contextmanager
def working(what: str, *, logged: bool = False) -> Iterator[Progress]:
    """Show progress on stderr if that is a terminal.

    Yields a function that changes the text. Nothing else may be printed meanwhile. If stderr is not
    a terminal, permanent texts are printed there, and if ``logged`` also one of the others at most
    every ten seconds. If ``logged``, a sentence reports that the command compiles code.
    """
    if not sys.stderr.isatty():
        log = _logger(0.0 if logged else math.inf)
        with compilation_said(partial(log, kept=True)) if logged else nullcontext():
            yield log
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=None)

        def show(stage: str, *, kept: bool = False) -> None:
            if kept:
                progress.console.print(stage, markup=False, highlight=False)
            else:
                progress.update(task, description=stage)

        with compilation_said(partial(show, kept=True)) if logged else nullcontext():
            yield show


def _logger(begins: float) -> Progress:
    """Return a function that prints permanent texts at once, others after ``begins`` seconds."""
    due, last = time.monotonic() + begins, ""

    def log(stage: str, *, kept: bool = False) -> None:
        nonlocal due, last
        if stage != last and (kept or time.monotonic() >= due):
            typer.echo(stage, err=True)
            # Ten seconds between lines
            due, last = max(due, time.monotonic() + 10.0), stage

    return log


@contextmanager
def interruptible(kept: Callable[[], str]) -> Iterator[None]:
    """Print the text that ``kept`` returns if the work inside is interrupted."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo(kept(), err=True)
        raise


def connected(address: str, **options: Any) -> AbstractContextManager[Actuator]:
    """Return `minorloop.connect.opened` of an address, with messages on stderr."""
    from minorloop.connect import opened

    return opened(address, say=partial(typer.echo, err=True), **options)


def named(column: str | None) -> str | None:
    """Return the name of a column, ``AUTO`` if none is given, or None for ``none``."""
    from minorloop.lab.logs import AUTO

    return AUTO if column is None else None if column == NONE else column


def reading(file: Path, now: Callable[[str], None]) -> Callable[[str], None]:
    """Return a function that shows the share of a file that has been read."""
    return lambda share: now(f"reading {file.name}: {share}")


def write_csv(path: Path, columns: Mapping[str, Any], *, force: bool) -> None:
    """Write columns of equal length under their headers."""
    from minorloop.files import check_writable, table_text, write_atomically

    check_writable(path, force=force)
    rows = zip(*(list(values) for values in columns.values()), strict=True)
    write_atomically(path, table_text(columns, rows))


def write_report(draw: Callable[[], Drawn], path: Path, *, force: bool) -> None:
    """Draw a report and write it; any error in drawing becomes an `OutputError`."""
    try:
        draw().write(path, force=force)
    except MinorloopError:
        raise
    except Exception as error:
        raise OutputError(f"{path} was not written, the report cannot be drawn: {error}") from error


@dataclass(frozen=True)
class Written:
    """A file that a verb writes if its path is given."""

    path: Path | None
    write: Callable[[Path], object]
    said: str = "written to {}"
    """Sentence that is printed, with ``{}`` for the path."""


def table(path: Path | None, columns: Mapping[str, Any], force: bool, said: str = "") -> Written:
    """Return the CSV file of columns of equal length under their headers."""
    return Written(path, partial(write_csv, columns=columns, force=force), said or "written to {}")


def drawn(path: Path | None, draw: Callable[[], Drawn], force: bool) -> Written:
    """Return the file of a report."""

    def write(path: Path) -> None:
        with working("drawing the report"):
            write_report(draw, path, force=force)

    return Written(path, write, "report written to {}; open it in a browser")


def finish(
    as_json: bool,
    content: Callable[[], Mapping[str, Any]],
    show: Callable[[], object],
    *files: Written,
) -> None:
    """Write files first, as printing may fail, then print the content as JSON or show it.

    If a file cannot be written, the others still are: the computation may have been long.
    """

    def write(file: Written, path: Path) -> None:
        file.write(path)
        if not as_json:
            typer.echo(file.said.format(path))

    steps = [partial(write, one, one.path) for one in files if one.path is not None]
    all_done([*steps, (lambda: print_json(content())) if as_json else show])


def check_outputs(
    paths: Sequence[Path | None], *, force: bool, inputs: Sequence[Path] = ()
) -> None:
    """Check before a long computation that its results can be written.

    Raises an `OutputError` if one of them cannot be written, is also an input, or is named twice.
    None stands for a result that is not written.
    """
    from minorloop.files import check_writable

    read, written = {os.path.realpath(path) for path in inputs}, set()
    for path in paths:
        if path is None:
            continue
        check_writable(path, force=True)
        place = os.path.realpath(path)
        if place in read:
            raise OutputError(f"{path} is an input and is not replaced; give another name")
        if place in written:
            raise OutputError(f"{path} is given for two results; give each its own file")
        if path.exists() and not force:
            raise OutputError(f"{path} exists already; give another name, or --force to replace it")
        written.add(place)
