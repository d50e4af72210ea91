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
    from minorloop.lab.logs import Log
    from minorloop.modelfile import Provenance

DYNAMICS = ("none", "auto", "operator", "linear")


@dataclass(frozen=True)
class Done:
    """An identification, its record, the origin of it, and the seconds that it took."""

    log: Log
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
    given = {name: value for name, value in options.items() if value is not None}
    with _common.working(f"reading {file.name}") as now:
        log = _common.read_record(file, columns, now)
        from minorloop.identification import identify
        from minorloop.modelfile import Provenance

        provenance = Provenance.of(file)
        part = _common.as_rows(rows, len(log))
        log = log.only(part.start, part.stop)
        began = time.perf_counter()
        count = counted(part.stop - part.start, "row")
        now(f"identifying from {count}")
        if dynamics != "none":
            found = _with_dynamics(log, given, dynamics)
            return Done(log, found.static, provenance, time.perf_counter() - began, found)
        with compilation_said(lambda sentence: now(sentence, kept=True)):
            result = identify(
                log, progress=lambda stage: now(f"identifying from {count}: {stage}"), **given
            )
    return Done(log, result, provenance, time.perf_counter() - began)


def _with_dynamics(log: Log, options: dict[str, Any], dynamics: str) -> DynamicIdentification:
    from minorloop.identification import identify_dynamics

    if options.pop("lag", "auto") not in ("auto", 0):
        raise ParameterError("--dynamics finds the dead time itself; leave --lag out")
    return identify_dynamics(log, first=dynamics, **options)  # type: ignore[arg-type]
