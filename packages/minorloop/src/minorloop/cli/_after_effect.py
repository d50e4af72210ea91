"""``minorloop identify --creep``: a model whose output changes with time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli import _common
from minorloop.cli._time_records import Outputs, TimedData, finish

if TYPE_CHECKING:
    from minorloop.identification import AfterEffectIdentification, Viscosity
    from minorloop.identification.regularisation import Prior
    from minorloop.lab.records import Record
    from minorloop.report import Report

TAKEN = (
    *("creep", "rate", "levels", "spacing", "diagonal", "smoothness"),
    *("start", "curves", "start_of_curve"),
)
"""Options of ``identify`` that a fit with times has."""


def run(
    data: TimedData, law: Viscosity, prior: Prior, start: Mapping[str, Any], outputs: Outputs
) -> None:
    """Identify, write the model and the report, and print what time explains.

    Parameters
    ----------
    data : TimedData
        Where the record is.
    law : Viscosity
        What is compared.
    prior : "auto" or Smooth
        Of the planes.
    start : mapping
        Parameters of `Record`.
    outputs : Outputs
        What to write.
    """
    record = data.read("a fit with --creep or --rate")
    began = time.perf_counter()
    with _common.working("identifying") as now:
        found = law.identify(record.replace(**start), prior, say=now)
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
    """Return the report of a fit to a record."""
    from minorloop.report import after_effect_report

    labels = str(record.input), str(record.output)
    return after_effect_report(
        found, source=source.name, input_label=labels[0], output_label=labels[1]
    )
