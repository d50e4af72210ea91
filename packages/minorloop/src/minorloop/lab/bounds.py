"""Bounds of a table: each reader checks a size here before it allocates what has that size."""

import sys
from dataclasses import dataclass
from pathlib import Path

from minorloop.errors import RecordError

NUMBER = 8
"""Bytes that a number of a column takes."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The largest table that is read."""

    rows: int = sys.maxsize
    columns: int = 10_000
    """``rows`` and ``columns``: most of each."""
    memory: int = 256 * 1024**2
    """Bytes that the cells of a table may take, whatever the size of its file."""
    share: int = 8
    """Bytes that they may take for each byte of the file, where this is more. A text never needs as
    many: its shortest number and separator are two bytes, which become ``NUMBER``."""
    expansion: int = 50
    """Most bytes for each byte of a compressed part of more than ``small`` bytes. Sheets have 4 to
    17, also where all cells are alike, because each has its place."""
    small: int = 8 * 1024**2
    """Bytes up to which a part may expand from any size."""
    advice: str = ""
    """What to do otherwise, after the advice to give fewer rows or columns."""

    def check(self, file: Path, *, rows: int = 0, columns: int = 0, held: int = 0) -> None:
        """Refuse a table that is larger.

        Raises a `RecordError` if one of them is beyond its bound.

        Parameters
        ----------
        file : Path
            The file that it is in.
        rows, columns : int
            Those that are known so far.
        held : int
            Bytes that its cells take, or will take.
        """
        if self is not LARGEST:  # what no bounds allow gets no advice to try others
            LARGEST.check(file, rows=rows, columns=columns, held=held)
        if held > self.memory:
            size = file.stat().st_size
            most = max(self.memory, self.share * size)
            if held > most:
                raise RecordError(
                    f"{file} has a table that takes {_megabytes(held)} of memory or more; a file "
                    f"of {_megabytes(size)} may take {_megabytes(most)}: split it, or save it as "
                    "CSV"
                )
        for what, count, limit in (("columns", columns, self.columns), ("rows", rows, self.rows)):
            if count > limit:
                raise RecordError(
                    f"{file} has {count} {what} or more; give at most {limit}{self.advice}"
                )

    def check_expansion(self, file: Path, packed: int, size: int) -> None:
        """Refuse a part of ``packed`` bytes that expands to ``size`` bytes as no table does.

        Raises a `RecordError` if it does.
        """
        if size > self.small and size > self.expansion * packed:
            raise RecordError(
                f"{file} expands from {_megabytes(packed)} to {_megabytes(size)}; a table expands "
                f"at most {self.expansion} times: save it as CSV"
            )


LARGEST = Bounds()
"""The largest table that a command reads."""


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.3g} MB" if size < 1e9 else f"{size / 1e6:.0f} MB"
