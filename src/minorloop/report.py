"""Self-contained HTML reports: text, tables and figures in one file that opens offline."""

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
    from minorloop.identification.result import Identification

_RESOLUTION = 110
_MOST_SCORED = 2000


@dataclass(frozen=True)
class Table:
    """A table: ``columns`` of headings, ``rows`` of cells ready to be shown."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Picture:
    """A matplotlib figure with its caption."""

    figure: Any
    caption: str

    @property
    def address(self) -> str:
        """The figure as SVG in a data address; the same figure gives the same bytes."""
        from matplotlib import rc_context

        text = io.BytesIO()
        # Text stays text: a browser has letters that the fonts of matplotlib lack, of which
        # matplotlib warns. Nothing is said of when and with what the figure was made.
        unsaid = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with (
            rc_context({"svg.hashsalt": "minorloop", "svg.fonttype": "none"}),
            warnings.catch_warnings(),
        ):
            warnings.filterwarnings("ignore", message="Glyph")
            self.figure.savefig(text, format="svg", dpi=_RESOLUTION, metadata=unsaid)
        return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode()


@dataclass
class Report:
    """Sections in the order in which they are added.

    Parameters
    ----------
    title : str
        Heading of the page.
    summary : str
        One paragraph under it: what was done and what came of it.
    """

    title: str
    summary: str
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

        Parameters
        ----------
        heading : str
            Its title.
        text : str or iterable of str
            Paragraphs.
        table : Table, optional
            Shown after the text.
        pictures : sequence of Picture
            Shown after the table.
        notes : sequence of str
            Shown last, each set off as advice.
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
        """The whole page."""
        from jinja2 import Environment, PackageLoader, StrictUndefined

        environment = Environment(
            loader=PackageLoader("minorloop"), autoescape=True, undefined=StrictUndefined
        )
        return environment.get_template("report.html").render(report=self, version=__version__)

    def write(self, path: PathLike, *, force: bool = False) -> None:
        """Write the page to a file.

        Raises
        ------
        OutputError
            If the file exists and ``force`` is false, or it cannot be written.
        """
        write_atomically(check_writable(path, force=force), self.html())


def identification_report(
    result: Identification, *, source: str, input_label: str, output_label: str
) -> Report:
    """What a user should know about an identified model before relying on it.

    Parameters
    ----------
    result : Identification
        The identification.
    source : str
        What the record is called.
    input_label, output_label : str
        Name and unit of input and output, such as ``voltage [V]``.

    Returns
    -------
    Report
    """
    from minorloop.identification.baseline import percent

    held = result.holdout_nrmse
    score = (
        "nothing was held out" if held is None else f"{percent(held, 2)} of range on held-out data"
    )
    report = Report(
        f"Hysteresis of {output_label} against {input_label}",
        f"A Preisach model of {result.model.bands} bands, identified from {source}: "
        f"{percent(result.nrmse, 2)} of range on the {result.samples} samples it was fitted to, "
        f"{score}; the best polynomial of the delayed input reaches "
        f"{percent(result.baseline_nrmse, 2)}.",
    )
    rows = [
        ("samples fitted", f"{result.samples}"),
        ("unknowns", f"{result.unknowns}"),
        ("cells of the plane excited", f"{result.excited_fraction:.0%}"),
        ("lag of the output", f"{result.lag} samples"),
        ("error on fitted data", f"{result.rmse:.4g} ({percent(result.nrmse)} of range)"),
        ("error on held-out data", "-" if held is None else f"{percent(held)} of range"),
        ("best delayed polynomial", f"{percent(result.baseline_nrmse)} of range"),
        *_bands(result),
        ("optimality (KKT)", f"{result.kkt:.1e}"),
    ]
    report.add("How good it is", table=Table(("", ""), rows), notes=result.advice)
    # A dollar in a label is a dollar, and no formula.
    of_input, of_output = (label.replace("$", r"\$") for label in (input_label, output_label))
    figure = result.plot(input_label=of_input, output_label=of_output)
    grey = "" if result.posterior else ", cells that the record does not excite in grey"
    band = ", with the band in which 90 % of the readings should lie" if result.posterior else ""
    caption = (
        f"Measured loop with the model; density on the Preisach plane{grey}; the record over time "
        f"with what was held out shaded; what is left{band}."
    )
    report.add("What it looks like", pictures=[Picture(figure, caption)])
    return report


def _bands(result: Identification) -> list[tuple[str, str]]:
    """How the weights were held together, and what that says of the error."""
    if result.posterior is None:
        return [("smoothness", f"{result.smoothness:g}")]
    import numpy as np

    from minorloop.identification.bands import PER_DEVIATION

    scored = np.flatnonzero(result.held_out if result.held_out.any() else result.fitted)
    scored = scored[:: max(scored.size // _MOST_SCORED, 1)]
    reach = PER_DEVIATION * result.deviation(scored)
    inside = float(np.mean(np.abs((result.prediction - result.y)[scored]) <= reach))
    where = "held-out" if result.held_out.any() else "fitted"
    return [
        ("90 % bands of a reading, half width", f"{reach.mean():.4g} on average"),
        ("they hold", f"{inside:.0%} of the {where} readings"),
    ]
