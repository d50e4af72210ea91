"""HTML reports: text, tables and figures in one file without external links."""

from __future__ import annotations

import base64
import io
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from minorloop.files import PathLike, check_writable, write_atomically
from minorloop.version import __version__

if TYPE_CHECKING:
    from minorloop.lab.reduction import Reduction


@dataclass(frozen=True)
class Table:
    """A table: headings ``columns`` and ``rows`` of cells, as text."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def sentences(self) -> list[bool]:
        """Whether each column has sentences, aligned at the left; numbers are at the right."""
        cells = zip(*self.rows, strict=False)
        # A cell of a table with more characters counts as a sentence
        found = [any(len(str(cell)) > 30 for cell in column) for column in cells]
        return found or [False] * len(self.columns)


@dataclass(frozen=True)
class Picture:
    """A matplotlib figure with its caption."""

    figure: Any
    caption: str

    @property
    def address(self) -> str:
        """The figure as SVG in a data URL; equal figures give equal bytes."""
        from matplotlib import rc_context

        text = io.BytesIO()
        # Text stays text. Browsers have characters that the fonts of matplotlib lack, so its
        # warning is ignored. Without metadata equal figures give equal bytes.
        no_metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with (
            rc_context({"svg.hashsalt": "minorloop", "svg.fonttype": "none"}),
            warnings.catch_warnings(),
        ):
            warnings.filterwarnings("ignore", message="Glyph")
            # Dots per inch of the raster parts of a figure: sharp on a screen, and small
            self.figure.savefig(text, format="svg", dpi=110, metadata=no_metadata)
        return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode()


@dataclass
class Report:
    """A page with a title, a summary and sections."""

    title: str
    """Heading of the page."""
    summary: str
    """One paragraph below the heading: method and results."""
    sections: list[dict[str, Any]] = field(default_factory=list)

    def add(
        self,
        heading: str,
        *,
        text: str | Iterable[str] = (),
        table: Table | None = None,
        pictures: Sequence[Picture] = (),
        notes: Sequence[str] = (),
    ) -> None:
        """Add a section.

        ``heading``: its title; ``text``: paragraphs; ``table``: shown after the text; ``pictures``:
        shown after the table; ``notes``: shown last, each set off as advice.
        """
        paragraphs = [text] if isinstance(text, str) else list(text)
        self.sections.append(
            {
                "heading": heading,
                "paragraphs": paragraphs,
                "table": table,
                "pictures": pictures,
                "notes": notes,
            }
        )

    def html(self) -> str:
        """Return the whole page."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        environment = Environment(
            loader=PackageLoader("minorloop"), autoescape=True, undefined=StrictUndefined
        )
        return environment.get_template("report.html").render(report=self, version=__version__)

    def write(self, path: PathLike, *, force: bool = False) -> None:
        """Write the page to a file.

        Raises an `OutputError` if the file exists and ``force`` is false, or it cannot be written.
        """
        write_atomically(check_writable(path, force=force), self.html())


def reduction_report(
    reduction: Reduction, *, source: str, notes: Sequence[str] | None = None
) -> Report:
    """Return a report on the settled points of a raw log.

    ``reduction``: the points; ``source``: name of the log; ``notes``: advice, by default that of
    the reduction.
    """
    log = reduction.log
    report = Report(
        f"Settled points of {log.output} against {log.input}", f"{source}: {reduction}."
    )
    advice = reduction.notes if notes is None else notes
    report.add("Quality of the points", table=Table(("", ""), reduction.summary()), notes=advice)
    caption = (
        "The log with its points; the points against the input, with two standard deviations; the "
        "holds that were found in the input; the standard deviation of each point, and by how much "
        "it was extrapolated from the end of its hold."
    )
    report.add("Figures", pictures=[Picture(reduction.plot(), caption)])
    return report
