"""Read columns of numbers and labels from a file, by their names."""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop.files import PathLike
from minorloop.lab.sheets import is_sheet, read_sheet
from minorloop.lab.tables import LARGEST, Bounds, Labels, OpenTable
from minorloop.lab.text_tables import opened_text


@contextmanager
def opened(
    path: PathLike, progress: Callable[[str], None] = lambda share: None, bounds: Bounds = LARGEST
) -> Iterator[OpenTable]:
    """Open a table.

    A text file is UTF-8, UTF-16 or else Windows-1252. It has one header line; comments before it
    begin with ``#``, ``%`` or ``//``, and a row of units may follow it. Commas, semicolons or tabs
    separate the columns; decimals have a point, or a comma if commas do not separate columns. A
    ``.mat`` file has a vector for each column or a matrix, an ``.xlsx`` file its table on the first
    sheet with numbers. Other columns may have any content.

    Raises a `RecordError` if the file cannot be read, is not such a table, or is larger than the
    bounds.

    ``path``: the file, at most 4 GiB; ``progress``: called with the share that has been read, as
    text; ``bounds``: largest size of the table.
    """
    file = Path(path)
    if is_sheet(file):
        yield read_sheet(file, bounds)
        return
    with opened_text(file, progress, bounds) as table:
        yield table


def read_columns(
    path: PathLike, names: Sequence[str], *, gaps: Collection[str] = (), dates: Collection[str] = ()
) -> dict[str, FloatArray]:
    """Read columns of numbers from a file, as `opened` and `OpenTable.read` say."""
    with opened(path) as table:
        return table.read(names, gaps=gaps, dates=dates)


def row_number(path: PathLike, index: int) -> int:
    """Return the number in the file of a row of data, as in the messages of `OpenTable.read`.

    ``path``: the file; ``index``: row of data, counted from 0: index of its values in the columns.
    """
    with opened(path) as table:
        for block in table.blocks:
            if index < len(block.numbers):
                return block.numbers[index]
            index -= len(block.numbers)
    raise IndexError(f"row {index} of {path}")


def read_each(
    path: PathLike, bounds: Bounds = LARGEST
) -> list[tuple[str, FloatArray | RecordError]]:
    """Return headers and columns of a file, with gaps; an unusable column is replaced by its error.

    Raises a `RecordError` as `opened`, or if there are no rows.
    """
    with opened(path, bounds=bounds) as table:
        names = table.headers
        return list(table.read(names, gaps=names, tried=names).items())


def read_labels(path: PathLike, name: str) -> Labels:
    """Return a column of labels, as `OpenTable.read`."""
    with opened(path) as table:
        labels: Labels = table.read((), [name])[name]
    return labels


def read_headers(path: PathLike) -> list[str]:
    """Return the column headers of a file, with their units.

    Raises a `RecordError` if the file cannot be read or does not begin with a line of headers.
    """
    with opened(path) as table:
        return table.headers
