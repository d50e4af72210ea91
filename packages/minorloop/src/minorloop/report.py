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
    from minorloop.arrays import FloatArray
    from minorloop.identification.accuracy import CurveAccuracy
    from minorloop.identification.after_effect_result import AfterEffectIdentification
    from minorloop.identification.dynamic_result import DynamicIdentification
    from minorloop.identification.frequency import FrequencyResponse
    from minorloop.identification.oscillator_result import OscillatorIdentification
    from minorloop.identification.result import Identification
    from minorloop.lab.reduction import Reduction
    from minorloop.scoring import ModelScore

_SENTENCE = 30
"""Characters from which a cell of a table counts as a sentence."""
_RESOLUTION = 110
"""Dots per inch of the raster parts of a figure: sharp on a screen, and small."""
_MOST_SCORED = 2000
"""Readings whose bands are computed: the share of 90 % within them is then known to 0.7 %."""


@dataclass(frozen=True)
class Table:
    """A table: headings ``columns`` and ``rows`` of cells, as text."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def sentences(self) -> list[bool]:
        """Whether each column has sentences, which begin at the left; numbers end at the right."""
        cells = zip(*self.rows, strict=False)
        found = [any(len(str(cell)) > _SENTENCE for cell in column) for column in cells]
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
        # Text stays text. Browsers have letters that the fonts of matplotlib lack, so its warning
        # is ignored. Without metadata equal figures give equal bytes.
        no_metadata = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        with (
            rc_context({"svg.hashsalt": "minorloop", "svg.fonttype": "none"}),
            warnings.catch_warnings(),
        ):
            warnings.filterwarnings("ignore", message="Glyph")
            self.figure.savefig(text, format="svg", dpi=_RESOLUTION, metadata=no_metadata)
        return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode()


@dataclass
class Report:
    """A page with a title, a summary and sections."""

    title: str
    """Heading of the page."""
    summary: str
    """One paragraph under it: method and results."""
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


def identification_report(
    result: Identification,
    *,
    source: str,
    input_label: str,
    output_label: str,
    dynamic: DynamicIdentification | None = None,
    time: FloatArray | None = None,
) -> Report:
    """Return a report on an identified model and its quality.

    Parameters
    ----------
    result : Identification
        The identification.
    source : str
        Name of the record.
    input_label, output_label : str
        Name and unit of input and output, such as ``voltage [V]``.
    dynamic : DynamicIdentification, optional
        The operator ``result`` with its dynamics.
    time : (T,) array, optional
        Time of each sample in seconds; samples are counted without it.
    """
    from minorloop.identification.baseline import percent
    from minorloop.identification.scores import score_rows

    whole = result if dynamic is None else dynamic
    held = whole.holdout_nrmse
    score = (
        "nothing was held out" if held is None else f"{percent(held, 2)} of range on held-out data"
    )
    moving = "" if dynamic is None else " with dynamics"
    report = Report(
        f"Hysteresis of {output_label} against {input_label}",
        f"A Preisach model of {result.model.bands} bands{moving}, identified from {source}: "
        f"{percent(whole.nrmse, 2)} of range on the {result.samples} samples it was fitted to, "
        f"{score}; the best polynomial of the delayed input reaches "
        f"{percent(result.baseline_nrmse, 2)}.",
    )
    # A dollar in a label does not begin a formula.
    labels = [label.replace("$", r"\$") for label in (input_label, output_label)]
    if dynamic is not None:
        _add_dynamics(report, dynamic, labels)
    rows = [
        *score_rows(result),
        ("rms error on fitted data", f"{result.rmse:.4g}"),
        *([("smoothness", f"{result.smoothness:g}")] if result.posterior is None else []),
        *_band_rows(result),
    ]
    chosen = [f"Chosen {choice}." for choice in result.choices]
    table = Table(("", ""), rows)
    report.add("How good it is", text=chosen, table=table, notes=result.advice)
    figure = result.plot(input_label=labels[0], output_label=labels[1], time=time)
    grey = "" if result.posterior else ", cells that the record does not excite in grey"
    caption = (
        f"Measured loop with the model; density on the Preisach plane{grey}; the record in time, "
        "with held-out samples shaded; the residual in time, with the band in which 90 % of the "
        "readings should lie; its size by the amplitude and by the rate of the input."
    )
    report.add("What it looks like", pictures=[Picture(figure, caption)])
    if result.curve_accuracy:
        _add_curves(report, result.curve_accuracy)
    return report


def after_effect_report(
    result: AfterEffectIdentification, *, source: str, input_label: str, output_label: str
) -> Report:
    """Return a report on a model with time in the plane: what time explains, and by which law.

    Parameters are as of `identification_report`.
    """
    left, without = result.left_out_error, result.without_time
    share = 1 - (left / without) ** 2 if without else 0.0
    report = Report(
        f"{output_label} against {input_label} and time",
        f"Identified from {int(result.fitted.sum())} rows of {source}. On rows that were left "
        f"out, the error is {left:.3%} of the range, and {without:.3%} without time: time explains "
        f"{max(share, 0.0):.0%} of what hysteresis leaves.",
    )
    # A dollar in a label does not begin a formula.
    names = [label.replace("$", r"\$") for label in (input_label, output_label)]
    labels = dict(zip(("input_label", "output_label"), names, strict=True))
    report.add(
        "Result",
        table=Table(("", ""), result.rows),
        pictures=[Picture(result.plot(**labels), "Record, loop, residual, and laws compared.")],
        notes=result.advice,
    )
    report.add(
        "Model",
        text="The loop of inputs that are held for long, and how the output settles in holds.",
        pictures=[Picture(result.model.plot(**labels), "Settled loop, and holds on the way down.")],
    )
    return report


def oscillator_report(
    found: OscillatorIdentification, *, source: str, input_label: str, output_label: str
) -> Report:
    """Return a report on an oscillator: parameters, the displacement with the error, the loop.

    Parameters
    ----------
    found : OscillatorIdentification
        The identification.
    source : str
        Name of the record.
    input_label, output_label : str
        Name and unit of input and output.
    """
    report = Report(
        f"{output_label} of an oscillator, driven by {input_label}",
        f"Identified from {found.record.u.size} rows of {source} by the error of the "
        f"simulation, which is {found.error:.3g} m rms, {found.scores['nrmse']:.3%} of the range.",
    )
    caption = "Displacement, what the model misses, and its loops."
    report.add(
        "Result",
        table=Table(("", ""), found.rows),
        pictures=[Picture(found.plot(), caption)],
        notes=found.advice,
    )
    return report


def score_report(score: ModelScore, *, model: str, source: str) -> Report:
    """Return a report on the errors of a model on another record.

    Parameters
    ----------
    score : ModelScore
        The errors.
    model, source : str
        Names of the model file and of the record.
    """
    from minorloop.identification.baseline import percent

    known = score.simulation.model
    report = Report(
        f"{model} on {source}",
        f"The model predicts {score.accuracy.samples} readings of {source} to "
        f"{percent(score.nrmse, 2)} of their range, {score.accuracy.rmse:.4g} "
        f"{known.output.unit} rms. It was identified from {known.provenance.data or 'no file'}.",
    )
    notes = [*known.warnings, *score.advice, *score.simulation.notes]
    report.add("How good it is", table=Table(("", ""), score.rows), notes=notes)
    labels = {"input_label": str(known.input), "output_label": str(known.output)}
    labels = {name: label.replace("$", r"\$") for name, label in labels.items()}
    caption = (
        "Measured and predicted loop; the record; the residual, predicted less measured, by the "
        "input, and in time with the 90 % bands, if the model has some."
    )
    report.add("What it looks like", pictures=[Picture(score.plot(**labels), caption)])
    if score.curve_accuracy:
        _add_curves(report, score.curve_accuracy)
    return report


def _add_curves(report: Report, curves: Sequence[CurveAccuracy]) -> None:
    """Add a section on the errors by curve, with a figure for many curves."""
    from minorloop.drawing.identification import draw_curves
    from minorloop.identification.scores import MOST_CURVES, curve_table

    pictures = []
    if len(curves) > MOST_CURVES:
        caption = "Root-mean-square and largest error of each curve, in the order of the record."
        pictures.append(Picture(draw_curves(curves), caption))
    columns, rows, title = curve_table(curves)
    report.add(
        "Curve by curve",
        text=f"{title[0].upper()}{title[1:]}.",
        table=Table(columns, rows),
        pictures=pictures,
    )


def _add_dynamics(report: Report, found: DynamicIdentification, labels: Sequence[str]) -> None:
    """Add sections on dynamics; the sections after them are on the operator without them."""
    from minorloop.identification.baseline import percent

    figure = found.plot(input_label=labels[0], output_label=labels[1])
    caption = (
        "The record with the model, held-out samples shaded; the operator alone, which is the "
        "output for slow inputs; the residual; the unit step response of the dynamics."
    )
    report.add(
        "With dynamics",
        text="The sections on quality and looks are on the operator, and the record without "
        "dynamics.",
        table=Table(("", ""), found.rows),
        pictures=[Picture(figure, caption)],
    )
    compared = [(one.what, f"{one.dead_time:.3g}", percent(one.error)) for one in found.tried]
    report.add(
        "Dynamics that were compared",
        text=f"Chosen: {next(one.what for one in found.tried if one.chosen)}.",
        table=Table(("", "dead time [s]", "error, of range"), compared),
    )


def reduction_report(
    reduction: Reduction, *, source: str, notes: Sequence[str] | None = None
) -> Report:
    """Return a report on the settled points of a raw log.

    Parameters
    ----------
    reduction : Reduction
        The points.
    source : str
        Name of the log.
    notes : sequence of str, optional
        Advice; that of the reduction if not given.
    """
    log = reduction.log
    report = Report(
        f"Settled points of {log.output} against {log.input}", f"{source}: {reduction}."
    )
    advice = reduction.notes if notes is None else notes
    report.add("How good they are", table=Table(("", ""), reduction.summary()), notes=advice)
    caption = (
        "The log with its points; the points against the input, with two standard deviations; the "
        "holds that were found in the input; the standard deviation of each point, and by how much "
        "it was extrapolated from the end of its hold."
    )
    report.add("What they look like", pictures=[Picture(reduction.plot(), caption)])
    return report


def frequency_report(
    response: FrequencyResponse, source: str, names: tuple[str, str], notes: Sequence[str] = ()
) -> Report:
    """Return a report on a frequency response: a table and a Bode plot.

    Parameters
    ----------
    response : FrequencyResponse
        The response.
    source : str
        Name of the store or log.
    names : (str, str)
        Name and unit of input and output, such as ``voltage [V]``.
    notes : sequence of str
        Advice.
    """
    from minorloop.identification.frequency import decibels, degrees

    several = response.after is not None and response.amplitudes.size > 1
    spread = f" {response.gain_spread()}." if several else ""
    report = Report(
        f"Frequency response of {names[1]} to {names[0]}",
        f"{source}: gain and phase of the fundamental component at {response.frequencies.size} "
        f"frequencies and {response.amplitudes.size} amplitudes.{spread}".replace(". g", ". G"),
    )
    figure = response.plot()
    caption = "Gain and phase from input to output"
    if response.after is not None:
        caption += ", and from the output of the model to that of the actuator"
    report.add("Bode plot", pictures=[Picture(figure, f"{caption}.")], notes=notes)
    kinds = [response.plant] if response.after is None else [response.plant, response.after]
    polar = [(decibels(gains), degrees(gains)) for gains in kinds]
    rows = [
        (
            f"{frequency:.4g}",
            f"{amplitude:.4g}",
            *(f"{values[i, j]:.3f}" for pair in polar for values in pair),
            f"{response.distortion[i, j]:.2%}",
        )
        for j, frequency in enumerate(response.frequencies)
        for i, amplitude in enumerate(response.amplitudes)
    ]
    after = ("after, dB", "phase, deg") if response.after is not None else ()
    columns = ("Hz", "amplitude", "gain, dB", "phase, deg", *after, "distortion")
    report.add("Gains", table=Table(columns, rows))
    return report


def _band_rows(result: Identification) -> list[tuple[str, str]]:
    """Return the width of the bands, and how many readings lie within."""
    import numpy as np

    from minorloop.identification.bands import PER_DEVIATION
    from minorloop.identification.rough_model import one_of_each

    scored = np.flatnonzero(result.held_out if result.held_out.any() else result.fitted)
    scored = scored[one_of_each(scored.size, _MOST_SCORED)]
    reach = PER_DEVIATION * result.deviation(scored)
    inside = float(np.mean(np.abs((result.prediction - result.y)[scored]) <= reach))
    where = "held-out" if result.held_out.any() else "fitted"
    return [
        ("90 % bands of a reading, half width", f"{reach.mean():.4g} on average"),
        ("readings within them", f"{inside:.0%} of the {where} readings"),
    ]
