"""Prepare a record, as it was read, for an identification, and say what was found in it.

Command line, Python, lab page and fleet identify through these functions, so that one record gives
one model.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError
from minorloop.identification.record_checks import checked_record
from minorloop.lab.holds import looks_like_raw_log
from minorloop.lab.logs import Log
from minorloop.lab.records import Record
from minorloop.lab.timebase import parse_lag

_OF_ROWS = ("curves", "groups", "interval")
"""Options of `identify` that a record has itself."""


@dataclass(frozen=True)
class RecordAdvice:
    """What was found in a record and chosen for it, one sentence each."""

    chosen: tuple[str, ...] = ()
    """Columns that were chosen."""
    notes: tuple[str, ...] = ()
    """What was found in the file and its times."""
    warnings: tuple[str, ...] = ()
    """Why a model of the record is not to be trusted."""
    first: int = 0
    """Row of the record that is sample 0."""
    sd: str | None = None
    """Column of the standard deviations by which the samples count; None if they are alike."""
    left_out: tuple[int, ...] = ()
    """Points of a run that chose its own inputs that are not fitted."""

    def with_model(
        self, warnings: Sequence[str], advice: Sequence[str], *, samples: bool = False
    ) -> tuple[str, ...]:
        """Return all advice: warnings, what was found in the record, then the rest.

        Parameters
        ----------
        warnings, advice : sequence of str
            Those about the record and the model, and all advice about the model.
        samples : bool
            Whether these sentences name samples.
        """
        said = [*warnings, *self.notes, *advice]
        if self.first and samples:
            said.append(
                f"samples are counted from row {self.first} of the file here; its first row below "
                "the header is row 0"
            )
        return tuple(dict.fromkeys(said))


NOTHING = RecordAdvice()
"""Of a record that was given as arrays."""


def raw_log(u: FloatArray, y: FloatArray, t: FloatArray | None = None) -> tuple[str, ...]:
    """Return the sentence about a raw log, if inputs and outputs (T,) are one."""
    found = looks_like_raw_log(t, u, y)
    return (found,) if found else ()


def identify_log(log: Log, identify: Callable[..., Any], options: Mapping[str, Any]) -> Any:
    """Identify a model from a log.

    A lag in rows needs even times: where it is searched or given, a record with uneven ones is
    resampled, and used as it is if the best lag is 0. The memory is unknown after gaps, unless each
    curve has one of its own.

    Raises a `ParameterError` if an option is given that the record has itself, or a lag in seconds
    without times.

    Parameters
    ----------
    log : Log
        The record.
    identify : callable
        Identifies inputs and outputs, as `minorloop.identify`.
    options : mapping
        Options of `minorloop.identify`, all of them.

    Returns
    -------
    Identification
    """
    _check(log, options)
    if log.identified_by is not None:
        return log.identified_by(log, options)
    weighted = log.sd is not None and options["noise"] is None
    part = slice(None) if log.whole else log.part
    beside = _beside(log, part) | (
        {"noise": log.sd[part]} if log.sd is not None and weighted else {}
    )
    given = {**options, **beside, "interval": None if log.check is None else log.check.interval}
    lag = options["lag"]
    delay = parse_lag(lag) if isinstance(lag, str) else None

    def fit(record: Record, lag: Any) -> Any:
        return identify(record.u[part], record.y[part], **{**given, "lag": lag})

    known = log if log.curves is None else log.with_memory_reset()
    record = even = known.with_known_memory() if delay is None else known.without_lag(delay)
    if delay is None and lag != 0 and log.whole and not beside:
        even = known.evenly_sampled()
    result = fit(even, lag if delay is None else 0)
    if lag == "auto" and not result.lag and not np.array_equal(even.t, record.t):
        of_lag = tuple(one for one in result.choices if one.name == "lag")
        even, result = record, fit(record, 0)
        result = replace(result, searched=True, choices=(*of_lag, *result.choices))
    told = _advice(known, uneven=bool(result.lag or delay))
    if weighted:
        said = f"weights: by the standard deviations in the column {log.sd_column}"
        told = replace(told, chosen=(*told.chosen, said), sd=log.sd_column)
    if not log.settled:
        t = log.record.t if log.record.timed else None
        raw = raw_log(log.record.u, log.record.y, t)
        told = replace(told, warnings=(*raw, *told.warnings))
    return replace(result, t=even.t[part] if even.timed else None, delay=delay, told=told)


def moving_samples(
    log: Log, options: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray, FloatArray, RecordAdvice]:
    """Return times from 0, inputs and outputs at even intervals for dynamics, and what was found.

    Raises a `ParameterError` if the record has no times, has curves or groups, or is of settled
    points.

    Parameters
    ----------
    log : Log
        The record.
    options : mapping
        Of `minorloop.identify_dynamics`.
    """
    _check(log, options)
    if log.settled:
        raise ParameterError(
            "dynamics need a record of transients, and this is a store of settled points; "
            "give a raw log"
        )
    if log.check is None:
        raise ParameterError("dynamics need times; name the column of time with time= (--time)")
    for name, labels in (("curves", log.curves), ("groups", log.groups)):
        if labels is not None:
            raise ParameterError(
                f"{name} (--{name}) cannot be combined with dynamics; leave one of them out"
            )
    record = log.evenly_sampled() if log.whole else log.with_known_memory()
    part = slice(None) if log.whole else log.part
    t = record.t[part]
    return t - t[0], record.u[part], record.y[part], _advice(log, uneven=True, dynamics=True)


def samples_in_time(
    log: Log, options: Mapping[str, Any]
) -> tuple[FloatArray, FloatArray, FloatArray, dict[str, Any], RecordAdvice]:
    """Return times, inputs and outputs as they were recorded, the labels, and what was found.

    Raises a `ParameterError` if the record has no times; a `RecordError` if the clock was set back.

    Parameters
    ----------
    log : Log
        The record.
    options : mapping
        Of `minorloop.identify_after_effect`.
    """
    _check(log, options)
    if log.check is None:
        raise ParameterError(
            "creep and rate need times; name the column of time with time= (--time)"
        )
    if log.check.jumps.size:
        raise RecordError(
            f"the clock was set back after sample {log.check.jumps[0]}; give the rows in the order "
            "of time"
        )
    record, part = log.record, log.part
    told = RecordAdvice(log.chosen, log.of_file + log.check.others, first=log.first)
    return record.t[part], record.u[part], record.y[part], _beside(log, part), told


def _check(log: Log, options: Mapping[str, Any]) -> None:
    """Refuse samples that cannot be used, and options that a record has itself for its rows."""
    checked_record(log.record.u, log.record.y)
    for name in (*_OF_ROWS, "noise"):
        value = options.get(name)
        if value is not None and (name != "noise" or np.ndim(value)):
            raise ParameterError(
                f"{name} is given beside a record that was read; name its column when the record "
                "is read"
            )


def _beside(log: Log, part: slice) -> dict[str, Any]:
    """Return the labels of the rows, by option."""
    labels = {"curves": log.curves, "groups": log.groups}
    return {name: values[part] for name, values in labels.items() if values is not None}


def _advice(log: Log, *, uneven: bool, dynamics: bool = False) -> RecordAdvice:
    """Return what was found in the file and its times.

    Parameters
    ----------
    log : Log
        The record.
    uneven : bool
        Whether the model depends on even times.
    dynamics : bool
        Whether dynamics are identified.
    """
    lost = () if log.check is None else log.left_out(dynamics=dynamics)
    of_times: tuple[str, ...] = ()
    if log.check is not None:
        of_steps = log.check.of_steps if uneven else ()
        of_times = (*log.check.of_breaks, *of_steps, *log.check.others, *log.of_memory)
    return RecordAdvice(
        log.chosen,
        (*log.of_file, *of_times, *lost),
        lost if log.mostly_left_out else (),
        log.first,
    )
