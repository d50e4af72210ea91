"""``minorloop identify --creep``: a model whose output changes with time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli import _common
from minorloop.cli._timed import Outputs, TimedData, finish, rows_of

if TYPE_CHECKING:
    from minorloop.identification import AfterEffectIdentification
    from minorloop.lab.records import Record
    from minorloop.report import Report

LEVELS = 25
"""Bands, unless given, as in `identify_after_effect`."""
TAKEN = (
    *("creep", "rate", "levels", "spacing", "diagonal", "smoothness"),
    *("start", "curves", "start_of_curve"),
)
"""Options of ``identify`` that a fit with times has."""


def run(data: TimedData, options: dict[str, Any], outputs: Outputs) -> None:
    """Identify, write the model and the report, and print what time explains."""
    from minorloop.identification import identify_after_effect

    record, labels = data.read("a fit with --creep or --rate")
    began = time.perf_counter()
    with _common.working("identifying") as now:
        found = identify_after_effect(
            record.t, record.u, record.y, curves=labels, progress=now, **options
        )
    figures = _figures(found, time.perf_counter() - began)
    bands = found.model.plane.bands
    title = f"{record.output} against {record.input} and time: Preisach, {bands} bands"
    finish(found, record, data.file, outputs, figures, title, report_of)


def _figures(found: AfterEffectIdentification, seconds: float) -> dict[str, Any]:
    model = found.model
    return {
        **found.scores,
        "law": found.law,
        "laws": {one.law: one.error for one in found.tried},
        "field": model.field,
        "settling": model.settling,
        "times": model.times,
        "creep": [float(one.sum()) for one in model.creep],
        "range": list(model.range),
        "samples": int(found.fitted.sum()),
        "levels": model.plane.bands,
        "seconds": seconds,
    }


def report_of(found: AfterEffectIdentification, record: Record, source: Path) -> Report:
    """Return the report: what time explains, the laws that were compared, and figures."""
    from minorloop.drawing import draw
    from minorloop.report import Picture, Report, Table

    share = 1 - (found.left_out_error / found.without_time) ** 2 if found.without_time else 0.0
    report = Report(
        f"{record.output} against {record.input} and time",
        f"Identified from {int(found.fitted.sum())} rows of {source.name}. On rows that were left "
        f"out, the error is {found.left_out_error:.3%} of the range, and {found.without_time:.3%} "
        f"without time: time explains {max(share, 0.0):.0%} of what hysteresis leaves.",
    )
    labels = {"input_label": str(record.input), "output_label": str(record.output)}
    report.add(
        "Result",
        table=Table(("", ""), rows_of(found)),
        pictures=[Picture(draw(found, **labels), "Record, loop, residual, and laws compared.")],
        notes=found.advice,
    )
    report.add(
        "Model",
        text="The loop of inputs that are held for long, and how the output settles in holds.",
        pictures=[Picture(draw(found.model, **labels), "Settled loop, and holds on the way down.")],
    )
    return report
