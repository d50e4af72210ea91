"""Carry out a plan of sines; a run can be stopped and continued at the next sine.

A simulated actuator gets each sine as a waveform, linear between samples. A bench gets it sample by
sample: an input is held for a whole number of ticks, and the output is read at the end. Each sine
is in the store, with all its samples, before the next one begins.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, LimitError, ParameterError, StoreError
from minorloop.lab.actuator import Actuator, Rounding, check_input
from minorloop.lab.records import Record
from minorloop.lab.run import (
    Described,
    Restorable,
    ResumeMode,
    RunProgress,
    answer_time,
    check_channels,
    check_written,
    left_safe,
    noted_session,
)
from minorloop.lab.sines import Sine, SinePlan
from minorloop.lab.store import Point, Store

__all__ = [
    "Driven",
    "MeasuredSine",
    "check_sines",
    "is_sine_store",
    "measured_sines",
    "planned_sines",
    "run_sines",
    "sine_design",
]

SLOW = 1.01
"""The bench was too slow if a sine took longer than planned by more than this factor."""
_DESIGN = "sines"


@runtime_checkable
class Driven(Protocol):
    """A plant to which a whole waveform can be applied, such as a twin."""

    def drive(self, t: npt.ArrayLike, u: npt.ArrayLike) -> Record:
        """Apply a waveform, linear between samples, and record it and the output."""


@dataclass(frozen=True, eq=False)
class MeasuredSine:
    """A sine and what was measured."""

    sine: Sine
    """The sine as planned."""
    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (count,). Inputs and outputs of its samples."""
    held: bool
    """Whether each input was held until its output was read; otherwise it is linear in between."""
    slow: float = 1.0
    """How long the sine took, as a multiple of the planned time."""

    @property
    def before(self) -> FloatArray:
        """The inputs before the sine, which bring the actuator to a known memory."""
        return np.array([self.sine.preamble, self.sine.offset])


def sine_design(plan: SinePlan, actuator: Actuator) -> dict[str, Any]:
    """Return what the setup of a store has as ``design`` for a run of sines on an actuator."""
    return {_DESIGN: plan.to_dict(), "held": not isinstance(actuator, Driven)}


def is_sine_store(store: Store) -> bool:
    """Whether a store has sines and no settled points."""
    return _DESIGN in (store.setup.design or {})


def check_sines(actuator: Actuator, plan: SinePlan) -> None:
    """Refuse sines that an actuator cannot carry out; nothing is applied.

    Raises a `ParameterError` if the plan has another unit, the actuator has several channels, its
    source would write another input, or its tick or its meter is too slow; a `LimitError` if an
    input is beyond the limits, or changes faster than the rate limit.
    """
    check_channels(actuator, plan.input)
    channel = actuator.inputs[0]
    answer = 0.0 if isinstance(actuator, Driven) else answer_time(actuator)
    if answer > actuator.tick:
        raise ParameterError(
            f"the meter takes {answer:.3g} s for an answer, and a tick of the actuator is "
            f"{actuator.tick:g} s; give the bench a slower tick or a faster meter"
        )
    for number, sine in enumerate(plan, 1):
        named = f"sine {number} ({sine.frequency:g} Hz)"
        ends = sine.offset - sine.amplitude, sine.offset + sine.amplitude
        try:
            for level in (sine.preamble, *ends):
                check_input(actuator.inputs, level)
            span = sine.interval
            if not isinstance(actuator, Driven):
                sine.ticks(actuator.tick)
                span = actuator.tick
        except (LimitError, ParameterError) as error:
            raise type(error)(f"{named}: {error}") from None
        step = 2 * sine.amplitude * math.sin(math.pi / sine.samples)
        if step > channel.rate * span:
            raise LimitError(
                f"{named} changes by {step:.3g} {channel.unit} within {span:g} s, faster than the "
                f"limit {channel.rate:g} {channel.unit}/s; lower its amplitude or its frequency"
            )
        if isinstance(actuator, Rounding):
            levels = np.array([sine.preamble, sine.offset, *sine.inputs[: sine.samples]])
            check_written(actuator, levels, channel.high - channel.low)


def run_sines(
    actuator: Actuator,
    store: Store,
    *,
    watch: Callable[[RunProgress], None] = lambda progress: None,
) -> ResumeMode:
    """Carry out the rest of the sines of a store, and leave the actuator on its safe input.

    Parameters
    ----------
    actuator : Actuator
        What to measure; it has one input and one output.
    store : Store
        Open to write; its setup has a design as `sine_design` gives it.
    watch : callable
        Called with a ``RunProgress`` during a sine and when it is in the store.

    Returns
    -------
    str
        ``fresh``, ``restored`` (a twin at the end of the last sine) or ``finished``, as `run` does.
        On instruments the next sine begins with its preamble, so nothing is replayed.

    Raises
    ------
    ParameterError
        If the actuator cannot carry out the sines.
    LimitError
        If an input is beyond the limits; nothing is applied then.
    StoreError
        If the store has no sines, was measured on another bench, or cannot be written.
    InstrumentError
        If a sine has no reading somewhere in its measured periods; it stays open, and the sines
        before it are kept.
    SafetyError
        If the actuator does not confirm at the end that it is safe; the sines are kept.
    """
    plan = planned_sines(store)
    if store.setup.design != sine_design(plan, actuator):
        raise StoreError(
            f"{store.path} was measured with another kind of actuator; give the same actuator, or "
            "begin a new run"
        )
    if store.finished:
        return "finished"
    check_sines(actuator, plan)
    if isinstance(actuator, Described) and actuator.description is not None:
        store.check_bench(actuator.description)
    with left_safe(actuator):
        mode: ResumeMode = "fresh"
        last = store.last()
        if isinstance(actuator, Restorable):
            if last is None:
                store.set_origin(actuator.checkpoint())
            elif last.checkpoint is not None:
                actuator.restore(last.checkpoint)
                mode = "restored"
        began = 0.0 if last is None else last.t
        with noted_session(store, mode):
            for index in range(len(store), len(plan)):
                began = _keep(actuator, store, plan.sines[index], index, began, watch)
    return mode


def measured_sines(store: Store) -> Iterator[MeasuredSine]:
    """Yield the sines that a store has.

    Raises a `StoreError` if it has no sines.
    """
    plan, held = planned_sines(store), bool((store.setup.design or {}).get("held"))
    for point, sine in zip(store.points(), plan.sines, strict=False):
        yield MeasuredSine(
            sine,
            sine.inputs,
            store.trace(point.index)[1],
            held,
            point.sample_interval / sine.interval,
        )


def planned_sines(store: Store) -> SinePlan:
    """Return the plan of a store of sines.

    Raises a `StoreError` if the store has settled points.
    """
    if not is_sine_store(store):
        raise StoreError(f"{store.path} has settled points and no sines; give a store of sines")
    return SinePlan.from_dict((store.setup.design or {})[_DESIGN])


def _keep(
    actuator: Actuator,
    store: Store,
    sine: Sine,
    index: int,
    began: float,
    watch: Callable[[RunProgress], None],
) -> float:
    """Measure one sine and write it to the store; return when it ended."""
    total = len(store.plan)

    def said(held: float, output: float, point: Point | None = None) -> None:
        watch(RunProgress(index, total, sine.offset, output, held, point))

    said(0.0, math.nan)
    for level in (sine.preamble, sine.offset):
        before = actuator.apply(level, sine.hold, sine.hold)
    if isinstance(actuator, Driven):
        t, y, took = *_driven(actuator, sine), sine.length
    else:
        t, y = _streamed(actuator, sine, lambda t, y: said(2 * sine.hold + t, y))
        after = actuator.apply(sine.offset, actuator.tick, actuator.tick)
        took = sine.length
        if before.timing and after.timing:
            took = after.timing.began - before.timing.ended
    held = 2 * sine.hold + took
    measured = y[-sine.measured * sine.samples :]
    lost = int(np.count_nonzero(~np.isfinite(measured)))
    if lost:
        raise InstrumentError(
            f"sine {index + 1} ({sine.frequency:g} Hz, amplitude {sine.amplitude:g}) has no "
            f"reading in {lost} of the {measured.size} samples of its measured periods, and every "
            "one is needed; check the sensor"
        )
    point = Point(
        index=index,
        input=sine.offset,
        value=float(np.mean(measured)),
        sd=math.nan,
        verdict="settled",
        t=began + held,
        held=held,
        checkpoint=actuator.checkpoint() if isinstance(actuator, Restorable) else None,
        sample_interval=took / sine.count,
        time_uncertainty=0.0 if isinstance(actuator, Driven) else sine.interval,
    )
    store.add(point, t, y)
    said(held, float(y[-1]), point)
    return point.t


def _driven(actuator: Driven, sine: Sine) -> tuple[FloatArray, FloatArray]:
    """Return times and outputs of a sine that is applied as a waveform."""
    t: FloatArray = sine.interval * np.arange(sine.count + 1, dtype=np.float64)
    record = actuator.drive(t, np.concatenate([[sine.offset], sine.inputs]))
    return t[1:], np.asarray(record.y[1:])


def _streamed(
    actuator: Actuator, sine: Sine, watch: Callable[[float, float], None]
) -> tuple[FloatArray, FloatArray]:
    """Return times and outputs of a sine whose samples are held for whole numbers of ticks."""
    ticks, inputs = sine.ticks(actuator.tick), sine.inputs
    t: FloatArray = sine.interval * np.arange(1, sine.count + 1, dtype=np.float64)
    y = np.empty(sine.count)
    for k, u in enumerate(inputs):
        for _ in range(ticks):
            y[k] = actuator.exchange(float(u))
        if (k + 1) % sine.samples == 0:
            watch(float(t[k]), float(y[k]))
    return t, y
