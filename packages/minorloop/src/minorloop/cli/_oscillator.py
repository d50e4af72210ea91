"""``minorloop identify --oscillator``: hysteresis inside a vibrating structure."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli import _common
from minorloop.cli._time_records import Outputs, TimedData, finish, rows_of
from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.dynamics.oscillator import Oscillator
    from minorloop.identification.oscillator_result import OscillatorIdentification
    from minorloop.lab.records import Record
    from minorloop.report import Report

UNKNOWN = "unknown"
BETWEEN = ("band", "straight", "held")
TAKEN = ("oscillator", "period", "between")
"""Options of ``identify`` that the fit of an oscillator has."""


def run(data: TimedData, start: str, options: dict[str, Any], outputs: Outputs) -> None:
    """Identify, write the model and the report, and print the parameters.

    Parameters
    ----------
    data : TimedData
        Where the record is.
    start : str
        ``unknown``, or a model file with an oscillator whose parameters are rough.
    options : dict
        ``period`` and ``between`` of `Vibration`, and ``skip`` of the record.
    outputs : Outputs
        What to write.
    """
    from minorloop.identification.oscillator import Vibration

    rough = UNKNOWN if start == UNKNOWN else _read_start(start)
    record = data.read("--oscillator")
    _check_units(record)
    began = time.perf_counter()
    with _common.working("identifying"):
        law = Vibration(rough, options["period"], options["between"])  # type: ignore[arg-type]
        found = law.identify(record.replace(skip=options["skip"]))
    figures = _figures(found, time.perf_counter() - began)
    title = f"{record.output} of an oscillator with hysteresis, driven by {record.input}"
    finish(found, record, data.file, outputs, figures, title, report_of)


def _read_start(start: str) -> Oscillator:
    """Return the oscillator in a model file.

    Raises a `ParameterError` if the file has another model.
    """
    from minorloop import modelfile
    from minorloop.dynamics.oscillator import Oscillator

    if not Path(start).exists():
        raise ParameterError(
            f"--oscillator is {start!r}; give unknown, or a model file with a rough oscillator, "
            "which minorloop.save writes"
        )
    known = modelfile.read(start)
    if not isinstance(known.model, Oscillator):
        raise ParameterError(
            f"{start} has a model of kind {known.kind!r}; give one with a rough oscillator, which "
            "minorloop.save writes, or unknown"
        )
    return known.model


def _check_units(record: Record) -> None:
    """Refuse units in which mass and damping would not be those of the SI."""
    for quantity, unit in ((record.input, "N"), (record.output, "m")):
        if quantity.unit not in ("", unit):
            raise RecordError(
                f"{quantity.name} is in {quantity.unit}; an oscillator is identified from forces "
                f"in N and displacements in m, so convert the column to {unit}"
            )


def _figures(found: OscillatorIdentification, seconds: float) -> dict[str, Any]:
    return {
        **found.scores,
        "noise": found.noise,
        "parameters": dict(zip(found.names, found.parameters.tolist(), strict=True)),
        "standard_deviations": dict(zip(found.names, found.sd.tolist(), strict=True)),
        "levels": {str(one.levels): one.error for one in found.tried},
        "converged": found.converged,
        "samples": int(found.record.scored.sum()),
        "seconds": seconds,
    }


def report_of(found: OscillatorIdentification, record: Record, source: Path) -> Report:
    """Return the report: parameters, the displacement with the error, and the hysteretic loop."""
    from minorloop.report import Picture, Report, Table

    report = Report(
        f"{record.output} of an oscillator, driven by {record.input}",
        f"Identified from {found.record.u.size} rows of {source.name} by the error of the "
        f"simulation, which is {found.error:.3g} m rms, {found.scores['nrmse']:.3%} of the range.",
    )
    report.add(
        "Result",
        table=Table(("", ""), rows_of(found)),
        pictures=[Picture(found.plot(), "Displacement, what the model misses, and its loops.")],
        notes=found.advice,
    )
    return report
