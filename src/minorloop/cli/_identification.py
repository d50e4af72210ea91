"""Identification from a file, with the options of the command line."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli import _common
from minorloop.errors import ParameterError, RecordError, counted

if TYPE_CHECKING:
    from minorloop.identification import Identification
    from minorloop.identification.adaptive import Adaptive
    from minorloop.identification.dynamic_result import DynamicIdentification
    from minorloop.lab.logs import Log
    from minorloop.lab.records import Record
    from minorloop.modelfile import Provenance

_DEFAULTS: dict[str, Any] = {
    "levels": "auto",
    "diagonal": "auto",
    "slope": "auto",
    "lag": "auto",
    "prior": "auto",
}
DYNAMICS = ("none", "auto", "operator", "linear")
NOT_USED = "none"
_NOT_OF_RUNS = ("holdout", "skip", "start_of_curve")


@dataclass(frozen=True)
class Done:
    """An identification and its data; ``sd`` is the column of standard deviations, if any."""

    record: Record
    result: Identification
    provenance: Provenance
    seconds: float
    notes: tuple[str, ...] = ()
    left_out: tuple[int, ...] = ()
    first: int = 0
    of_time: tuple[str, ...] = ()
    dynamic: DynamicIdentification | None = None
    sd: str | None = None
    lag_given: float | None = None

    @property
    def lag_seconds(self) -> float:
        """Lag in seconds, as given or from rows of a known interval; 0 where neither is known."""
        return self.result.lag_seconds if self.lag_given is None else self.lag_given

    @property
    def lag(self) -> int:
        """Lag in whole rows, also where it was given in seconds."""
        if self.lag_given is None or not self.result.interval:
            return self.result.lag
        return round(self.lag_given / self.result.interval)

    @property
    def advice(self) -> list[str]:
        """Advice about the run and its times, then about the model."""
        of_model = self.result.advice if self.dynamic is None else self.dynamic.advice
        said = list(dict.fromkeys([*self.notes, *self.of_time, *of_model]))
        result = self.result
        if self.first and (result.findings or result.codes or result.suspects):
            said.append(
                f"samples are counted from row {self.first} of the file here; its first row below "
                "the header is row 0"
            )
        return said

    @property
    def warnings(self) -> tuple[str, ...]:
        """The part of the advice that says why the model is not to be trusted."""
        result = self.result if self.dynamic is None else self.dynamic
        return (*(note for note in self.notes if note not in result.advice), *result.warnings)


@dataclass(frozen=True)
class Columns:
    """Names of the columns of a file; None where not given."""

    input: str | None
    output: str | None
    curves: str | None = None
    groups: str | None = None
    time: str | None = None
    sd: str | None = None

    @property
    def labels(self) -> list[str]:
        """Names of the columns of labels."""
        return [name for name in (self.curves, self.groups) if name is not None]

    def with_deviation(self, file: Path, noise: float | None, dynamics: str) -> Columns:
        """Return the columns with that of standard deviations: the given one, or that of reduce.

        The latter is named ``sd`` and has the unit of the output. With a noise that is given, or
        with dynamics, it is not used.
        """
        from minorloop.lab.columns import (
            deviation_column,
            find_column,
            read_headers,
            split_header,
            with_unit,
        )

        used = noise is None and dynamics == "none"
        if self.output is None:  # of a store, which has them
            return self if used else replace(self, sd=NOT_USED)
        if self.sd == NOT_USED or (self.sd is None and not used):
            return replace(self, sd=None)
        if not used:
            other = "--noise" if noise is not None else "--dynamics"
            raise ParameterError(f"--sd cannot be combined with {other}; leave one of them out")
        headers = read_headers(file)
        output = with_unit(self.output, find_column(self.output, headers, source=file))
        if self.sd is None:
            return replace(self, sd=deviation_column(headers, output))
        header = with_unit(self.sd, find_column(self.sd, headers, source=file))
        if split_header(header)[1] not in ("", split_header(output)[1]):
            raise RecordError(
                f"column '{header}' of {file} is no standard deviation of '{output}'; give one in "
                "the unit of the output"
            )
        return self

    def beside(self, log: Log) -> dict[str, Any]:
        """Return what each row has beside input and output, by option of `identify`."""
        named = {"curves": self.curves, "groups": self.groups}
        found = {option: log.labels[name] for option, name in named.items() if name is not None}
        return found if log.sd is None else {**found, "noise": log.sd}


def identified(
    file: Path,
    columns: Columns,
    rows: str | None,
    options: dict[str, Any],
    lag_seconds: float | None = None,
    dynamics: str = "none",
) -> Done:
    """Read a record and identify a model from it.

    A lag in seconds and dynamics need a column of time.
    """
    from minorloop.arrays import check_option

    check_option("--dynamics", dynamics, DYNAMICS)

    with _common.working(f"reading {file.name}") as now:
        columns = columns.with_deviation(file, options["noise"], dynamics)
        record, run_by, log = _record(file, columns, now)
        from minorloop.identification import identify  # slow: a refused file does not wait for it
        from minorloop.modelfile import Provenance

        beside = columns.beside(log)
        provenance = Provenance.of(file)
        began = time.perf_counter()
        if run_by is not None:
            now(f"identifying from {len(record)} points of an adaptive run")
            _refuse_dynamics(dynamics, f"{file.name} is an adaptive run of settled points")
            return _of_run(record, run_by, rows, options, provenance)
        logged = record
        if columns.curves is not None:
            log = log.with_memory_reset()
        whole = not beside and rows is None
        dynamic = dynamics != "none"
        record, of_time = _timed(log, columns, options["lag"], lag_seconds, whole, dynamic)
        timed = columns.time is not None
        lost = log.left_out(dynamics=dynamic) if timed and log.mostly_left_out else ()
        part = _common.as_rows(rows, len(record))
        settings: dict[str, Any] = {
            name: _DEFAULTS.get(name) if v is None else v for name, v in options.items()
        }
        settings |= {name: values[part] for name, values in beside.items()}
        now(f"identifying from {part.stop - part.start} rows")
        if dynamic:
            _shown(now, part)("dynamics")
            found = _with_dynamics(record, part, columns, {**settings, "first": dynamics})
            seconds = time.perf_counter() - began
            static = found.static
            return Done(record, static, provenance, seconds, lost, (), part.start, of_time, found)
        if columns.time is not None and log.check is not None:
            settings["interval"] = log.check.interval
        result = identify(record.u[part], record.y[part], progress=_shown(now, part), **settings)
        seconds = time.perf_counter() - began
        raw = _raw(logged, columns)
        return Done(
            record,
            result,
            provenance,
            seconds,
            raw + lost,
            first=part.start,
            of_time=of_time,
            sd=(columns.sd or "sd") if "noise" in beside else None,
            lag_given=lag_seconds,
        )


def _with_dynamics(
    record: Record, part: slice, columns: Columns, settings: dict[str, Any]
) -> DynamicIdentification:
    from minorloop.identification import identify_dynamics

    if columns.time is None:
        _refuse_dynamics("auto", "the record has no time; name its column with --time")
    for option in ("curves", "groups", "start_of_curve"):
        if settings.pop(option, None) is not None:
            name = option.replace("_", "-")
            raise ParameterError(
                f"--{name} cannot be combined with --dynamics; leave one of them out"
            )
    if settings.pop("lag") not in ("auto", 0):
        raise ParameterError("--dynamics finds the dead time itself; leave --lag out")
    t = record.t[part]
    return identify_dynamics(t - t[0], record.u[part], record.y[part], **settings)


def _refuse_dynamics(dynamics: str, reason: str) -> None:
    if dynamics != "none":
        raise ParameterError(f"--dynamics needs a record of transients, and {reason}")


def _shown(now: Callable[[str], None], part: slice) -> Callable[[str], None]:
    """Return a function that shows what is done with the rows."""
    rows = counted(part.stop - part.start, "row")
    return lambda stage: now(f"identifying from {rows}: {stage}")


def _raw(record: Record, columns: Columns) -> tuple[str, ...]:
    """Return the sentence about a raw log, if the record is one."""
    from minorloop.lab.holds import looks_like_raw_log

    if columns.input is None:
        return ()
    found = looks_like_raw_log(record.t if record.timed else None, record.u, record.y)
    return (found,) if found else ()


def _timed(
    log: Log,
    columns: Columns,
    lag: Any,
    lag_seconds: float | None,
    whole: bool,
    dynamics: bool,
) -> tuple[Record, tuple[str, ...]]:
    """Return the record as its times require it, and what was found in them."""
    if columns.time is None:
        if lag_seconds is not None:
            raise ParameterError(
                f"--lag is {lag_seconds:g} s and the column of time is not named; give it with "
                "--time, or the lag in rows"
            )
        advice = "name the column with --time to take this into account"
        return log.record, (*log.of_file, *(f"{note}; {advice}" for note in log.irregular))
    notes = log.notes + log.of_memory + log.left_out(dynamics=dynamics)
    if lag_seconds is not None:
        return log.without_lag(lag_seconds), notes
    if lag == 0 or not whole:
        return log.with_known_memory(), notes
    return log.evenly_sampled(), notes


def _of_run(
    record: Record,
    chooser: Adaptive,
    rows: str | None,
    options: dict[str, Any],
    provenance: Provenance,
) -> Done:
    """Return the model of an adaptive run, with the settings of the run; validation held out."""
    from minorloop.identification.adaptive_run import findings

    if rows is not None or options["holdout"] != 0 or options["skip"] != 0:
        raise ParameterError(
            "an adaptive run holds out its own validation; leave --rows, --skip and --holdout out"
        )
    given = {name: v for name, v in options.items() if v is not None and name not in _NOT_OF_RUNS}
    if given["smoothness"] != "auto":
        given.setdefault("prior", "auto")
    began = time.perf_counter()
    u, y = record.u.tolist(), record.y.tolist()
    result = chooser.identification(u, y, **given)
    seconds = time.perf_counter() - began
    found = findings(chooser, u, y)
    return Done(record, result, provenance, seconds, found.warnings, found.outliers)


def _record(
    file: Path, columns: Columns, now: Callable[[str], None]
) -> tuple[Record, Adaptive | None, Log]:
    """Return the points of a store and what chose them, or columns of a file with their times."""
    from minorloop.cli._adaptive import chooser_of, is_adaptive
    from minorloop.lab.logs import Log
    from minorloop.lab.store import Store, is_store

    input, output = columns.input, columns.output
    if is_store(file):
        if replace(columns, sd=None) != Columns(None, None) or columns.sd not in (None, NOT_USED):
            raise ParameterError(
                f"{file} is an experiment store, which has one input and one output; "
                "leave --input, --output, --time, --sd, --curves and --groups out"
            )
        with Store.open(file) as store:
            chose = is_adaptive(store.setup)
            chooser = chooser_of(store.setup, store.points()) if chose else None
            sd = [point.sd for point in store.points()] if columns.sd is None else None
            log = Log.of_points(store.record(), sd)
            if store.running:
                note = f"the run goes on, and has {len(store)} of {len(store.plan)} points so far"
                log = replace(log, of_file=(note,))
            return log.record, chooser, log
    if input is None or output is None:
        if not os.path.exists(file):
            raise RecordError(f"{file} does not exist; give a CSV file or an experiment store")
        missing = "--input" if input is None else "--output"
        raise ParameterError(f"{missing} is missing; name a column of {file}")
    beside: dict[str, Any] = {"labels": columns.labels, "sd": columns.sd}
    log = _common.read_log(file, input, output, columns.time, now, **beside)
    return log.record, None, log
