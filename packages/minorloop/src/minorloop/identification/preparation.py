"""Prepare a record for an identification, and report findings about it.

Command line, Python, lab page and fleet all identify through these functions, so that a record
always gives the same model.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.errors import ParameterError, RecordError
from minorloop.lab.holds import looks_like_raw_log
from minorloop.lab.records import Record
from minorloop.lab.timebase import parse_lag


@dataclass(frozen=True)
class RecordAdvice:
    """Findings about a record and choices for it, one sentence each."""

    chosen: tuple[str, ...] = ()
    """Columns that were chosen."""
    notes: tuple[str, ...] = ()
    """Findings about the file and its times."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust a model of the record."""
    first: int = 0
    """Row of the record that is sample 0."""
    sd: str | None = None
    """Column of the standard deviations that weight the samples; None if samples count alike."""
    not_fitted: tuple[int, ...] = ()
    """Points of an adaptive run that are not fitted."""

    def with_model(
        self, warnings: Sequence[str], advice: Sequence[str], *, samples: bool = False
    ) -> tuple[str, ...]:
        """Return all advice: warnings, findings about the record, then the rest.

        ``warnings``, ``advice``: those about the record and the model, and all advice about the
        model; ``samples``: whether these sentences name samples.
        """
        said = [*warnings, *self.notes, *advice]
        if self.first and samples:
            said.append(
                f"samples are counted from row {self.first} of the file here; its first row below "
                "the header is row 0"
            )
        return tuple(dict.fromkeys(said))


NOTHING = RecordAdvice()
"""Advice about a record that was given as arrays: none."""


def fit_prepared(record: Record, lag: int | str, fit: Callable[[Record, Any], Any]) -> Any:
    """Prepare a record, fit it, and report findings about it.

    A lag in rows needs even times. If a lag is searched or given, a record with uneven times is
    resampled; if the best lag is 0, it is used as it is. The memory is unknown after gaps, unless
    each curve has its own.

    Raises a `ParameterError` if there is a lag in seconds without times.

    ``record``: the record; ``lag``: of `Plane`; ``fit``: identifies rows with a lag, as
    `Plane.fit`.
    """
    u, y, _ = record.checked
    delay = parse_lag(lag) if isinstance(lag, str) else None
    known = record if record.curves is None else record.with_memory_reset()
    used = even = known.with_known_memory() if delay is None else known.without_lag(delay)
    beside = record.weighted or record.curves is not None or record.groups is not None
    if delay is None and lag != 0 and record.whole and not beside:
        even = known.evenly_sampled()
    whole: Any = lag if delay is None else 0
    result = fit(even.cut(), whole)
    if lag == "auto" and not result.lag and not np.array_equal(even.t, used.t):
        of_lag = tuple(one for one in result.choices if one.name == "lag")
        even, result = used, fit(used.cut(), 0)
        result = replace(result, searched=True, choices=(*of_lag, *result.choices))
    told = _advice(known, uneven=bool(result.lag or delay))
    if record.weighted and (column := record.origin.sd_column):
        said = f"weights: by the standard deviations in the column {column}"
        told = replace(told, chosen=(*told.chosen, said), sd=column)
    if not record.origin.settled:
        raw = looks_like_raw_log(record.t if record.timed else None, u, y)
        told = replace(told, warnings=(*((raw,) if raw else ()), *told.warnings))
    t = even.cut().t if even.timed else None
    interval = None if record.check is None else record.check.interval
    return replace(result, t=t, delay=delay, told=told, interval=interval, record=record)


def moving_samples(record: Record) -> tuple[Record, RecordAdvice]:
    """Return a record with times from 0 at even intervals for dynamics, and findings about it.

    Raises a `ParameterError` if the record has no times, has curves or groups, or is of settled
    points.
    """
    if record.origin.settled:
        raise ParameterError(
            "dynamics need a record of transients, and this is a store of settled points; "
            "give a raw log"
        )
    if record.check is None:
        raise ParameterError("dynamics need times; name the column of time with time= (--time)")
    for name, labels in (("curves", record.curves), ("groups", record.groups)):
        if labels is not None:
            raise ParameterError(
                f"{name} (--{name}) cannot be combined with dynamics; leave one of them out, or "
                "reduce the record to settled points and identify the operator from them"
            )
    even = (record.evenly_sampled() if record.whole else record.with_known_memory()).cut()
    return even.replace(t=even.t - even.t[0]), _advice(record, uneven=True, dynamics=True)


def samples_in_time(record: Record) -> tuple[Record, RecordAdvice]:
    """Return a record with its original times, and findings about it.

    Raises a `ParameterError` if the record has no times; a `RecordError` if the clock was set back.
    """
    check = record.check
    if check is None:
        raise ParameterError(
            "creep and rate need times; name the column of time with time= (--time)"
        )
    if check.jumps.size:
        raise RecordError(
            f"the clock was set back after sample {check.jumps[0]}; give the rows in the order "
            "of time"
        )
    origin = record.origin
    told = RecordAdvice(origin.chosen, origin.notes + check.others, first=record.first)
    return record.cut(), told


def _advice(record: Record, *, uneven: bool, dynamics: bool = False) -> RecordAdvice:
    """Return findings about the file and its times.

    ``record``: the record; ``uneven``: whether the model depends on even times; ``dynamics``:
    whether dynamics are identified.
    """
    lost = () if record.check is None else record.left_out(dynamics=dynamics)
    of_times: tuple[str, ...] = ()
    if record.check is not None:
        of_steps = record.check.of_steps if uneven else ()
        of_times = (*record.check.of_breaks, *of_steps, *record.check.others, *record.of_memory)
    return RecordAdvice(
        record.origin.chosen,
        (*record.origin.notes, *of_times, *lost),
        lost if record.mostly_left_out else (),
        record.first,
    )
