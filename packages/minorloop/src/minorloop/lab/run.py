"""Carry out a plan; a run can be stopped and continued without loss of measurements.

Each level is held until its output has settled. The settled point, or the sine, is in the store,
with its raw trace, before the next level or sine is applied. If a run ends for any reason, the
actuator is left on its safe input. Another call of ``run`` with the same store continues after the
last point.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import (
    InstrumentError,
    LimitError,
    ParameterError,
    SafetyError,
    StoreError,
    counted,
)
from minorloop.lab.actuator import ROUNDING, SIX_DIGITS, Actuator, Rounding, Timed, check_input
from minorloop.lab.faults import spikes
from minorloop.lab.holding import Hold
from minorloop.lab.noise import RepeatedReadings, widened
from minorloop.lab.plan import Plan
from minorloop.lab.settling import SPAN_SHARE, judge, settled_after, trend
from minorloop.lab.signals import Allowed, Deferred, ended_by_signals
from minorloop.lab.sines import Driven, MeasuredSine, Sine, apply_sine
from minorloop.lab.store import Point, Store, reason_of

ResumeMode: TypeAlias = Literal["fresh", "restored", "replayed", "finished"]

Choose: TypeAlias = Callable[[Sequence[Point]], float | None]
"""Maps the points so far to the next level, or to None if they are enough. The same points must
give the same level, so that a stopped run continues as if it had not stopped."""


_JUDGED, _MOST = 30, 90.0
"""Number of latest holds that determine the hold time, and percentage of them that then settle."""


@runtime_checkable
class Restorable(Protocol):
    """A plant whose state can be saved and restored exactly, such as a twin."""

    def checkpoint(self) -> dict[str, Any]:
        """Return the state, ready for JSON."""

    def restore(self, checkpoint: dict[str, Any]) -> None:
        """Go back to a saved state."""


@runtime_checkable
class Described(Protocol):
    """A plant that describes its instruments, so that a run continues with the same instruments."""

    @property
    def description(self) -> dict[str, Any] | None:
        """Instruments and the conversion of their readings, for JSON; None if unknown."""


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run."""

    index: int
    total: int
    """``index`` and ``total``: the present level, counted from 0, and the number of levels."""
    input: float
    """The level, in the unit of the input."""
    output: float
    """The latest sample, in the unit of the output; NaN if not measured."""
    held: float
    """Time for which the level has been held, in seconds."""
    point: Point | None = None
    """The settled point, once it is in the store."""
    warning: str = ""
    """Warning about this point and the points before it; empty if there is none."""


def run(
    actuator: Actuator,
    plan: Plan,
    store: Store,
    *,
    choose: Choose | None = None,
    watch: Callable[[RunProgress], None] = lambda progress: None,
) -> ResumeMode:
    """Carry out the rest of a plan, and leave the actuator on its safe input.

    Parameters
    ----------
    actuator : Actuator
        Actuator to measure; it has one input and one output.
    plan : Plan
        Plan to carry out.
    store : Store
        Store for the points, open to write; it may already contain the first points. A sine is a
        point whose trace has its samples.
    choose : callable, optional
        Chooses the levels that the plan leaves open, from the points so far.
    watch : callable
        Called with a ``RunProgress`` while a level or a sine is applied, and when its point is in
        the store.

    Returns
    -------
    str
        How the actuator was brought to the first level of this session: ``fresh``; ``restored`` to
        exactly the state at the last settled point, for twins; ``replayed``: its recorded inputs
        were applied again, without measurement; or ``finished``: the plan was already complete. On
        instruments the next sine begins with its preamble, so inputs are not replayed.

    Raises
    ------
    ParameterError
        If the plan has another unit than the actuator, the actuator has several channels or a meter
        too slow for the plan, or the plan has open levels and there is no ``choose``.
    LimitError
        If a level or a sine is beyond the limits of the actuator; it is not applied then.
    StoreError
        If the store belongs to another plan, was measured on another bench, or cannot be written;
        its points are kept.
    InstrumentError
        If the sensor repeats one reading exactly at all inputs, or a reading is missing in the
        measured periods of a sine, which then stays open; the points are kept.
    SafetyError
        If the actuator does not confirm at the end that it is safe; the points are kept.

    Examples
    --------
    >>> strip = ml.connect("twin:ipmc")
    >>> plan = ml.Plan([0.0, 0.5], longest=20.0, input="voltage [V]")
    >>> setup = ml.Setup("twin:ipmc", "voltage [V]", "curvature [1/m]")
    >>> with ml.Store.create("run.sqlite", plan, setup) as store:
    ...     ml.run(strip, plan, store), len(store)
    ('fresh', 2)
    """
    check_plan(actuator, plan)
    store.check_same(plan)
    channels = str(actuator.inputs[0]), str(actuator.outputs[0])
    if channels != (store.setup.input, store.setup.output):
        raise StoreError(
            f"{store.path} has '{store.setup.input}' and '{store.setup.output}', and the actuator "
            f"has '{channels[0]}' and '{channels[1]}'; give the store of this actuator"
        )
    if plan.open and choose is None:
        raise ParameterError(
            f"level {int(np.argmax(np.isnan(plan.inputs)))} of the plan is open; give every level, "
            "or a function that chooses them"
        )
    if store.finished:
        return "finished"
    if isinstance(actuator, Described) and actuator.description is not None:
        store.check_bench(actuator.description)
    with left_safe(actuator):
        mode, ended = _reach_last_point(actuator, store, watch)
        with store.session(mode):
            if plan.sines:
                for index in range(len(store), len(plan)):
                    _measure_sine(actuator, store, plan.sines[index], index, watch)
            else:
                _Levels(actuator, store, choose, watch, ended).measure()
    return mode


def check_plan(actuator: Actuator, plan: Plan) -> None:
    """Refuse a plan that an actuator cannot carry out; nothing is applied.

    Raises a `ParameterError` if the plan has another unit, the actuator has several channels, its
    tick or its meter is too slow for the plan, or its source would write another input; a
    `LimitError` if an input is beyond the limits, or a sine is faster than the rate limit.
    """
    if len(actuator.inputs) != 1 or len(actuator.outputs) != 1:
        raise ParameterError(
            f"the actuator has {counted(len(actuator.inputs), 'input')} and "
            f"{counted(len(actuator.outputs), 'output')}; a plan is for one of each"
        )
    channel = actuator.inputs[0]
    if plan.input.unit and plan.input.unit != channel.unit:
        raise ParameterError(
            f"the plan is for '{plan.input}' and the actuator takes '{channel}'; "
            f"give the levels in {channel.unit or 'pure numbers'}"
        )
    if plan.sines:
        _check_sines(actuator, plan.sines)
        return
    known = plan.inputs[np.isfinite(plan.inputs)]
    for level in (known.min(), known.max()) if known.size else ():
        check_input(actuator.inputs, level)
    _check_written(actuator, plan.inputs)
    plan.check_answers(answer_time(actuator))


def _check_sines(actuator: Actuator, sines: Sequence[Sine]) -> None:
    """Refuse sines that an actuator cannot carry out."""
    channel, driven = actuator.inputs[0], isinstance(actuator, Driven)
    answer = 0.0 if driven else answer_time(actuator)
    if answer > actuator.tick:
        raise ParameterError(
            f"the meter takes {answer:.3g} s for an answer, and a tick of the actuator is "
            f"{actuator.tick:g} s; give the bench a slower tick or a faster meter"
        )
    for number, sine in enumerate(sines, 1):
        named = f"sine {number} ({sine.frequency:g} Hz)"
        ends = sine.offset - sine.amplitude, sine.offset + sine.amplitude
        try:
            for level in (sine.preamble, *ends):
                check_input(actuator.inputs, level)
            if not driven:
                sine.ticks(actuator.tick)
        except (LimitError, ParameterError) as error:
            raise type(error)(f"{named}: {error}") from None
        span = sine.interval if driven else actuator.tick
        step = 2 * sine.amplitude * math.sin(math.pi / sine.samples)
        if step > channel.rate * span:
            raise LimitError(
                f"{named} changes by {step:.3g} {channel.unit} within {span:g} s, faster than the "
                f"limit {channel.rate:g} {channel.unit}/s; lower its amplitude or its frequency"
            )
        period = sine.inputs[: sine.samples]
        _check_written(actuator, np.array([sine.preamble, sine.offset, *period]))


def _check_written(actuator: Actuator, levels: FloatArray) -> None:
    """Refuse levels (n,) that the source would write as another input; NaN is not checked."""
    if not isinstance(actuator, Rounding):
        return
    span = actuator.inputs[0].high - actuator.inputs[0].low
    for index in np.flatnonzero(np.isfinite(levels)):
        level = float(levels[index])
        written = actuator.written(level)
        if abs(written - level) > SIX_DIGITS * span:
            raise ParameterError(
                f"level {index + 1} of the plan is {level:.9g} and the source would write "
                f"{written:.9g}; write more digits in the command that sets it, such as {{:.9g}}, "
                "or give levels that need fewer"
            )


def answer_time(actuator: Actuator) -> float:
    """Return the time of a reading, in seconds; 0 if the actuator does not give it.

    ``actuator``: the actuator to measure.
    """
    return actuator.answer_time() if isinstance(actuator, Timed) else 0.0


def _reach_last_point(
    actuator: Actuator, store: Store, watch: Callable[[RunProgress], None]
) -> tuple[ResumeMode, float]:
    """Bring the actuator to the last point; return how, and the end of the last hold, or NaN."""
    last = store.last()
    if isinstance(actuator, Restorable):
        if last is None:
            store.set_origin(actuator.checkpoint())
        state = store.origin() if last is None else last.checkpoint
        if state is not None:
            actuator.restore(state)
            return ("fresh" if last is None else "restored"), math.nan
    plan, record = store.plan, None
    if last is None or plan.sines:
        return "fresh", math.nan
    for point in store.points():
        record = actuator.apply(point.input, point.held, min(plan.sample_interval, point.held))
        watch(RunProgress(point.index, len(plan), point.input, math.nan, point.held))
    return "replayed", record.timing.ended if record and record.timing else math.nan


class _Levels:
    """The levels of a plan while they are measured.

    ``ended`` is the end of the last hold, in seconds, NaN if not known; the others are as of `run`.
    """

    def __init__(
        self,
        actuator: Actuator,
        store: Store,
        choose: Choose | None,
        watch: Callable[[RunProgress], None],
        ended: float,
    ) -> None:
        self._actuator, self._store, self._choose, self._watch = actuator, store, choose, watch
        self._points = [] if choose is None else store.points()
        self._last, self._ended, self._ends = store.last(), ended, _ends(store)
        self._repeated = RepeatedReadings.of_plan(store.plan.inputs)

    def measure(self) -> None:
        """Measure level after level."""
        while not self._store.finished:
            index = 0 if self._last is None else self._last.index + 1
            level = self._level(index)
            if level is None:
                self._store.set_enough()
                continue
            point, readings = self._held(index, level)
            self._last = point
            if self._choose is not None:
                self._points.append(point)
            self._ends = widened(self._ends, point.value)
            before, self._repeated = self._repeated, self._repeated.after(level, readings)
            warning = _warning(before, self._repeated, self._actuator, index)
            said = point.value, point.held, point, warning
            self._watch(RunProgress(index, len(self._store.plan), level, *said))

    def _level(self, index: int) -> float | None:
        """Return the level to hold next; None if the points are enough."""
        level = float(self._store.plan.inputs[index])
        if self._choose is None or not math.isnan(level):
            return level
        chosen = self._choose(self._points)
        if chosen is not None:
            check_input(self._actuator.inputs, chosen)
        return chosen

    def _held(self, index: int, level: float) -> tuple[Point, FloatArray]:
        """Hold one level until it has settled; return its stored point, and its readings (T,).

        An output that should move but does not gets the longest hold.
        """
        plan, tolerance = self._store.plan, 0.0
        hold = Hold(plan, index, answer_time(self._actuator))
        for length in hold.stretches():
            hold.add(self._actuator.apply(level, length, plan.sample_interval), length)
            self._watch(RunProgress(index, len(plan), level, hold.latest, hold.held))
            t, y = hold.trace
            tolerance = _tolerance(plan, index, widened(self._ends, y))
            line = trend(t, y, plan.window)
            settled = line is not None and line.is_below(tolerance)
            if settled and not self._repeated.after(level, y).verdict:
                break
        # A clock that restarts with each call does not show the time between holds.
        gap, self._ended = hold.began - self._ended, hold.ended
        end = judge(t, np.where(spikes(y), np.nan, y), tolerance=tolerance, window=plan.window)
        point = Point(
            index=index,
            input=level,
            value=end.value,
            sd=end.sd,
            verdict=end.verdict,
            t=hold.held + (0.0 if self._last is None else self._last.t) + (gap if gap > 0 else 0.0),
            held=hold.held,
            checkpoint=_state(self._actuator),
            sample_interval=hold.sample_interval,
            time_uncertainty=hold.uncertainty,
        )
        self._store.add(point, t, y)
        return point, y


def _state(actuator: Actuator) -> dict[str, Any] | None:
    """Return the state of a twin; None for instruments."""
    return actuator.checkpoint() if isinstance(actuator, Restorable) else None


def _warning(
    before: RepeatedReadings, now: RepeatedReadings, actuator: Actuator, index: int
) -> str:
    """Return a warning if the sensor begins to look faulty; raise an error if it did before.

    The first hold at an end of the range may precede the first motion of the actuator. If the
    sensor is dead, the range of the inputs does not count.
    """
    if not now.verdict:
        return ""
    channel, output = actuator.inputs[0], actuator.outputs[0]
    low, high = now.inputs
    first = index + 2 - now.holds
    (reading,) = now.readings
    found = "has no" if math.isnan(reading) else f"is {reading:.9g} {output.unit} in every"
    said = (
        f"{output.name} {found} reading of holds {first} to {index + 1}, while {channel.name} went "
        f"from {low:g} to {high:g} {channel.unit}; check the meter and its range, and that the "
        "actuator is connected, or hold longer: if it moved, these points are wrong"
    )
    width = channel.high - channel.low
    # Least share of the range of the limits that the input must cover before a repeated reading
    # ends a run: with less, an actuator may be below its threshold
    far = not math.isfinite(width) or high - low >= 0.5 * width * (1 - ROUNDING)
    sure = now.verdict == "dead" or (now.verdict == "faulty" and far)
    if before.verdict and sure:
        raise InstrumentError(said)
    return "" if before.verdict else said


def _measure_sine(
    actuator: Actuator, store: Store, sine: Sine, index: int, watch: Callable[[RunProgress], None]
) -> None:
    """Measure one sine and write it to the store."""
    total, last, driven = len(store.plan), store.last(), isinstance(actuator, Driven)
    before = 2 * sine.hold

    def said(t: float, y: float, point: Point | None = None) -> None:
        watch(RunProgress(index, total, sine.offset, y, t, point))

    said(0.0, math.nan)
    took, t, y = apply_sine(actuator, sine, lambda t, y: said(before + t, y))
    measured = y[-sine.measured * sine.samples :]
    lost = int(np.count_nonzero(~np.isfinite(measured)))
    if lost:
        raise InstrumentError(
            f"sine {index + 1} ({sine.frequency:g} Hz, amplitude {sine.amplitude:g}) has no "
            f"reading in {lost} of the {measured.size} samples of its measured periods, and all "
            "are needed; check the sensor"
        )
    point = Point(
        index=index,
        input=sine.offset,
        value=float(np.mean(measured)),
        sd=math.nan,
        verdict="settled",
        t=before + took + (0.0 if last is None else last.t),
        held=before + took,
        checkpoint=_state(actuator),
        sample_interval=took / sine.count,
        time_uncertainty=0.0 if driven else sine.interval,
    )
    store.add(point, t, y)
    said(point.held, float(y[-1]), point)


def measured_sines(store: Store) -> list[MeasuredSine]:
    """Return the sines that a store has.

    Raises a `StoreError` if its plan has none.
    """
    sines = store.plan.sines
    if not sines:
        raise StoreError(f"{store.path} has settled points and no sines; give a store of sines")
    return [
        MeasuredSine(
            sine,
            sine.inputs,
            store.trace(point.index)[1],
            held=point.time_uncertainty > 0,
            slow=point.sample_interval / sine.interval,
        )
        for point, sine in zip(store.points(), sines, strict=False)
    ]


def _ends(store: Store) -> tuple[float, float]:
    """Return the lowest and the highest output of a store, NaN before the first."""
    totals = store.totals()
    return widened(
        (math.nan, math.nan), np.array([totals["lowest"], totals["highest"]], dtype=float)
    )


def _tolerance(plan: Plan, index: int, ends: tuple[float, float]) -> float:
    if plan.tolerance is not None:
        return plan.tolerance
    span = float(np.ptp(ends))
    return SPAN_SHARE * span / float(plan.longest[index]) if math.isfinite(span) else 0.0


def long_enough(store: Store) -> float:
    """Return the hold time after which most outputs settle, in seconds.

    It follows from the latest extrapolated holds; NaN if they do not determine it.
    """
    plan, ends, found = store.plan, _ends(store), []
    for point in store.points(max(len(store) - _JUDGED, 0)):
        if point.verdict == "extrapolated":
            longest = float(plan.longest[point.index])
            change = _tolerance(plan, point.index, ends) * longest
            t, y = store.trace(point.index)
            found.append(settled_after(t, y, change=change, window=plan.window))
    known = [seconds for seconds in found if math.isfinite(seconds)]
    return float(np.percentile(known, _MOST)) if known else math.nan


@contextmanager
def left_safe(actuator: Actuator) -> Iterator[None]:
    """Context that always leaves the actuator on its safe input.

    Signals are raised only inside the context, so that they cannot prevent the safe input.

    ``actuator``: the actuator to make safe.
    """
    with ended_by_signals(), Deferred():
        try:
            with Allowed():
                yield
        except SafetyError:
            raise  # the actuator was read again until a deadline
        except BaseException as error:
            _make_safe(actuator, error)
            raise
        _make_safe(actuator, None)


def _make_safe(actuator: Actuator, cause: BaseException | None) -> None:
    """Make an actuator safe; if that fails, report it first and then the cause of the end."""
    try:
        actuator.safe()
    except Exception as error:
        message = f"{error}"
        if not isinstance(error, SafetyError):
            message = f"the actuator may still be on, switch it off by hand: {error}"
        if cause is None:
            raise SafetyError(message) from error
        raise SafetyError(f"{message}; the run ended because of: {reason_of(cause)}") from cause
