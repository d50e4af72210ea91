"""Identification from a file, with the options of the command line."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli import _common
from minorloop.cli._compilation import compilation_said
from minorloop.errors import ParameterError, counted

if TYPE_CHECKING:
    from minorloop.identification import DynamicIdentification, Identification
    from minorloop.identification.pipeline import Options
    from minorloop.lab.records import Record
    from minorloop.modelfile import Provenance

DYNAMICS = ("none", "auto", "operator", "linear")


@dataclass(frozen=True)
class Done:
    """An identification, its record, the origin of it, and the seconds that it took."""

    record: Record
    result: Identification
    provenance: Provenance
    seconds: float
    dynamic: DynamicIdentification | None = None

    @property
    def found(self) -> Identification | DynamicIdentification:
        """The whole model."""
        return self.result if self.dynamic is None else self.dynamic


def identified(
    file: Path, columns: Mapping[str, Any], rows: str | None, options: dict[str, Any], dynamics: str
) -> Done:
    """Read a record and identify a model from it.

    Parameters
    ----------
    file : path
        The record.
    columns : mapping
        Of `minorloop.read`, as they are given on the command line.
    rows : str, optional
        Rows to use, A:B.
    options : dict
        Of `minorloop.identify`; None where they are not given.
    dynamics : str
        One of ``DYNAMICS``.
    """
    from minorloop.arrays import check_option

    check_option("--dynamics", dynamics, DYNAMICS)
    if columns["sd"] not in (None, _common.NONE):
        for name, used in (("noise", options["noise"]), ("dynamics", dynamics != "none")):
            if used not in (None, False):
                raise ParameterError(
                    f"--sd cannot be combined with --{name}; leave one of them out"
                )
    with _common.working(f"reading {file.name}") as now:
        record = _common.read_record(file, columns, now)
        from minorloop.identification.pipeline import Options
        from minorloop.modelfile import Provenance

        provenance = Provenance.of(file)
        asked = Options.of(options)
        part = _common.as_rows(rows, len(record))
        record = record.only(part.start, part.stop)
        began = time.perf_counter()
        count = counted(part.stop - part.start, "row")
        now(f"identifying from {count}")
        if dynamics != "none":
            found = _with_dynamics(record, asked, dynamics)
            return Done(record, found.static, provenance, time.perf_counter() - began, found)
        with compilation_said(lambda sentence: now(sentence, kept=True)):
            result = asked.identify(record, lambda stage: now(f"identifying from {count}: {stage}"))
    return Done(record, result, provenance, time.perf_counter() - began)


def _with_dynamics(record: Record, asked: Options, dynamics: str) -> DynamicIdentification:
    from minorloop.identification import Dynamics

    if asked.law.lag not in ("auto", 0):
        raise ParameterError("--dynamics finds the dead time itself; leave --lag out")
    law = Dynamics(asked.law, dynamics)  # type: ignore[arg-type]
    return law.identify(record.replace(**asked.of_record), asked.prior, asked.holdout)
