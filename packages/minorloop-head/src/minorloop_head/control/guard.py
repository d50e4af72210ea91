"""Guard of one wire: limits, checks of sensor and target, the law inside them, and a log.

The guard keeps the current within the limits of current and temperature for any request of the law
and any reading. If the sensor is lost, stuck or has the wrong sign, the wire cools. If readings
jump faster than the wire can move, the wire goes by its model for some seconds, and then cools
until both agree, as they do for a cold wire. If a target cannot be reached, the guard holds the
nearest angle in reach. Nothing is raised in the loop; the log gives reasons.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, TypeAlias

from minorloop.arrays import check_kind
from minorloop.errors import ParameterError
from minorloop_head.control.controller import Controller, Loop
from minorloop_head.control.lateness import Lateness, LatenessWatch
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.observer import Estimate, ObserverControl, PowerObserver
from minorloop_head.control.reach import STROKE_SHARE, ReachState, ReachWatch, Unreachable
from minorloop_head.control.readings import (
    ASTRAY,
    Expected,
    Fault,
    ReadingState,
    ReadingWatch,
    SensorWatch,
    as_number,
)
from minorloop_head.heated_wire import HeatedState

Cause: TypeAlias = Literal[
    "sensor",
    "sensor back",
    "unread",
    "read again",
    "reference",
    "clock",
    "hot",
    "unreachable",
    "reachable",
    "behind",
    "warm",
    "stress",
]
COOLED = ("lost", "stuck", "unconfirmed", "reversed")
"""Faults of the sensor at which the wire cools."""
_FAULTS: dict[Fault, str] = {
    "lost": "the sensor is lost; the wire cools",
    "stuck": "the sensor is stuck; the wire cools",
    "implausible": "the sensor is implausible: {odd}; the wire goes by its model",
    "late": "readings show where the wire was {late:.1f} s before: they are late, or a load sways "
    "the wire; it goes by its model for a while",
    "reversed": "readings fall while the wire is heated: the sign of the sensor is reversed, or "
    "the picture is mirrored; the wire cools until it is begun anew",
    "unconfirmed": f"readings have contradicted the model for {ASTRAY:g} s, and one of both is "
    "wrong; the wire cools until they agree",
}
"""Messages on the fault of a sensor, and the reaction of the wire."""
_ENDED: dict[Cause, tuple[Cause, str]] = {
    "sensor": ("sensor back", "the sensor is trusted again"),
    "unread": ("read again", "there are readings again"),
    "unreachable": ("reachable", "targets are tried again"),
}
"""Messages at the end of a cause."""
MOST_EVENTS, MOST_ALIKE = 64, 8
"""Largest number of events in the log, and of those of one cause."""
_UNREAD = 5
"""Number of missing readings that is logged, if the patience is longer: more than are lost by
chance."""
_BEHIND_FOR = 1.0
"""Seconds after which a wire behind a moving target is logged."""
_IDLE_LAGS = 4.0
"""Lags without current after which a wire above its target shows that its surroundings are too
warm: 98 % of the heat have left it by then."""
_HOLD_SHARE = 0.9
"""Share of its reach at which a wire holds for an unreachable target: it leaves spare current."""
_COLD = 0.3
"""Degrees above the cold wire below which a target means no current."""
_BEHIND_BY = 2.0
"""Least error in degrees of a wire at a limit that counts as behind a moving target."""
_RESYNC, _RESYNC_SHARE = 5.0, 0.1
"""Seconds for which times must differ from the clock by the same offset for it to count as set, and
share of them by which the offset may change: readings are not late for so long."""
LARGEST = 1e6
"""Angle in degrees from which a value counts as missing."""
_LONGEST_GAP = 500
"""Intervals after which a gap counts as a jump of the clock: 20 s at 25 Hz."""
_LATE = 1.5
"""Least duration of a late step, in intervals."""


@dataclass(frozen=True)
class Event:
    """Entry of the log."""

    step: int
    """Number of the step, from 1."""
    cause: Cause
    """Such as ``sensor`` or ``unreachable``."""
    text: str
    """A sentence."""


class _StepClock(NamedTuple):
    """State of the clock by the times of the steps."""

    t: float = math.nan
    """The newest accepted time in seconds, NaN if there was none."""
    waited: int = 0
    """Steps since."""
    strange: int = 0
    """Number of consecutive times with the same offset from that clock."""
    off: float = math.nan
    """That offset, in seconds."""


@dataclass(frozen=True, eq=False)
class GuardState:
    """State of the guard."""

    estimate: Estimate
    """Estimate of the wire."""
    heated: float
    """Effective power by the current alone, in A^2."""
    driven: HeatedState
    """Wire by its current alone, without readings."""
    bias: float
    """Power that the surroundings added at the beginning, in A^2."""
    reference: float
    """Last target that was a number, in degrees."""
    applied: float
    """Present current in A."""
    inner: Any = None
    """State of a law with its own estimate."""
    reading: ReadingState = field(default_factory=ReadingState)
    """State of the check of readings."""
    lateness: Lateness = field(default_factory=Lateness)
    """State of the check for late readings."""
    reach: ReachState = field(default_factory=ReachState)
    """State of the check of the target."""
    asked: float = math.nan
    """Target from which it was computed, in degrees; NaN if that was no number."""
    steps: int = 0
    """Steps so far."""
    clock: _StepClock = field(default_factory=_StepClock)
    """Clock by the times of the steps."""
    behind: float = 0.0
    """Seconds for which the wire has been behind a moving target at a limit."""
    idle: float = 0.0
    """Seconds for which it has been above its target without a current."""
    active: frozenset[Cause] = frozenset()
    """Causes that persist."""
    log: tuple[Event, ...] = ()
    """The newest events, oldest first."""

    @property
    def unreachable(self) -> Unreachable | None:
        """Reason why the target is out of reach; None if it is not known to be."""
        return self.reach.verdict

    @property
    def fault(self) -> Fault:
        """Fault of the sensor; empty if it has none."""
        return self.reading.fault

    @property
    def cools(self) -> bool:
        """Whether the wire cools because of that fault."""
        return self.fault in COOLED


@dataclass(frozen=True, eq=False, kw_only=True)
class Guard:
    """A law inside the limits of its wire.

    Raises a `ParameterError` if controller and observer do not have the same interval.
    """

    observer: PowerObserver
    """Estimates the effective power of the wire, and so its temperature."""
    controller: Controller | None = None
    """A law with its own estimate; without one, the observer is an `ObserverControl`, and the
    current follows from the estimate of the guard."""
    limits: WireLimits = field(default_factory=WireLimits)
    """Limits of the wire."""
    sensor: SensorWatch = field(default_factory=SensorWatch)
    """Check that decides which readings are usable."""

    def __post_init__(self) -> None:
        alone = self.controller is None
        check_kind("observer", self.observer, ObserverControl if alone else PowerObserver)
        check_kind("limits", self.limits, WireLimits)
        check_kind("sensor", self.sensor, SensorWatch)
        if self.controller and self.controller.interval != self.observer.interval:
            raise ParameterError(
                f"the controller steps every {self.controller.interval} s and the observer every "
                f"{self.observer.interval} s; give them the same interval"
            )

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> GuardState:
        """Return the state of a wire that has settled at an angle under a current.

        ``measurement``: in degrees; 0 if it is not a number. ``current``: in A; clipped to the
        limits.
        """
        angle = measurement if math.isfinite(measurement) else 0.0
        most = self.observer.highest
        on = min(max(current, 0.0), most) if math.isfinite(current) else most
        estimate = self.observer.found(angle, on)
        return GuardState(
            estimate=estimate,
            heated=max(on**2, estimate.wire.power),
            driven=estimate.wire,
            bias=estimate.ambient,
            reference=angle,
            applied=on,
            inner=self.controller and self.controller.begin(angle, on),
        )

    def step(
        self,
        state: GuardState,
        reference: float,
        measurement: float,
        *,
        t: float | None = None,
        raw: float | None = None,
        asked: object = None,
    ) -> tuple[float, GuardState]:
        """Return the current for the next interval, within the limits; nothing is raised.

        ``reference``: wanted angle in degrees; the last valid one is used if it is not a number.
        ``measurement``: newest reading in degrees, or NaN. ``t``: time of the reading in seconds. A
        late reading is not used; during a gap the current is assumed to have been on.
        ``raw``: reading of the sensor, if the measurement was computed from it and others.
        ``asked``: requested angle, if the reference was computed from it.
        """
        whole = reference if asked is None else asked
        steps, read, notes, clock = self._pass_time(
            state.clock, measurement if raw is None else raw, t
        )
        wanted = as_number(reference)
        if not abs(wanted) < LARGEST:
            shown = float(whole) if isinstance(whole, float) else whole
            wanted = state.reference
            notes["reference"] = (
                f"target {shown!r:.40} is not a number below {LARGEST:g}; {wanted:.4g} degrees "
                "are kept"
            )
        predicted, heated, driven = self._predicted(state, steps)
        reading, lateness = self._check_reading(
            state, (read, as_number(measurement)), predicted, driven.angle, steps
        )
        expected = predicted.expected
        if lateness.doubted and not state.lateness.doubted:
            # Wrong readings have spoilt the estimate.
            past = (driven.angle,) * len(predicted.past)
            predicted = Estimate(driven, state.bias, 0.0, past)
        estimate = self.observer.corrected(predicted, reading.value)
        reach = ReachState()
        if not reading.fault:
            reach = self._watch.step(state.reach, wanted, reading.value, state.applied, estimate)
        target = self._target(wanted, reach)
        # If readings are not used, the law continues with those that the model expects.
        instead = reading.used or math.isnan(as_number(read))
        known = reading.value if instead else expected
        requested, inner = self._requested_current(state, estimate, target, known, steps)
        cool = self._allowed_current(estimate, heated)
        current = min(requested, cool, self._useful(reading, reach, estimate))
        if self.controller and current != requested:
            inner = replace(inner, applied=current)
        number = as_number(whole)
        behind, idle = self._waits(state, number, wanted, reading.value, current)
        new = replace(
            state,
            estimate=estimate,
            heated=heated,
            driven=driven,
            reference=wanted,
            applied=current,
            inner=inner,
            reading=reading,
            lateness=lateness,
            reach=reach,
            asked=number,
            steps=state.steps + 1,
            clock=clock,
            behind=behind,
            idle=idle,
        )
        if cool < requested:
            notes["hot"] = (
                f"the wire may be {self.temperature(new):.0f} degrees Celsius; less current"
            )
        return current, self._logged(state, new, notes)

    def later(self, steps: int) -> Guard:
        """Return the guard for readings that are older by some intervals; states remain valid.

        ``steps``: 0 or more. A law without a delay of its own, such as the adaptive one, remains as
        it is.
        """
        law: Any = self.controller
        if isinstance(law, Loop):
            law = law.later(steps)
        return replace(self, controller=law, observer=self.observer.later(steps))

    def temperature(self, state: GuardState) -> float:
        """Return the highest temperature that the wire may have now, in degrees Celsius."""
        return self.limits.temperature(max(state.heated, state.estimate.wire.power))

    @cached_property
    def reach(self) -> tuple[float, float]:
        """Least and largest angle of the wire by its model and its limits, in degrees."""
        wire = self.observer.wire
        low, top = wire.operator.range
        power = min(self.limits.highest_power, float(wire.operator.levels[-1]))
        return low, min(STROKE_SHARE * top, wire.begin(power).angle)

    @property
    def tolerance(self) -> float:
        """Degrees beyond the reach from which a target is unreachable."""
        return self._watch.tolerance

    @cached_property
    def _watch(self) -> ReachWatch:
        return ReachWatch(wire=self.observer.wire, rise=self.limits.rise, **self._clock)

    @cached_property
    def _readings(self) -> ReadingWatch:
        return ReadingWatch(wire=self.observer.wire, sensor=self.sensor, **self._clock)

    @cached_property
    def _lateness(self) -> LatenessWatch:
        return LatenessWatch(observer=self.observer)

    @property
    def _clock(self) -> dict[str, Any]:
        return {name: getattr(self.observer, name) for name in ("interval", "delay", "highest")}

    def _pass_time(
        self, clock: _StepClock, measurement: object, t: object
    ) -> tuple[int, object, dict[Cause, str], _StepClock]:
        """Return the passed intervals, the reading if it is new, notes, and the clock.

        If times keep the same offset from the clock for some seconds, the clock was set.
        """
        interval, waited = self.observer.interval, clock.waited + 1
        if t is None:
            return 1, measurement, {}, clock._replace(waited=waited, strange=0)
        now = as_number(t)
        if not math.isfinite(now):
            note: dict[Cause, str] = {"clock": f"time is {t!r:.40}; the reading is not used"}
            return 1, math.nan, note, clock._replace(waited=waited, strange=0)
        if math.isnan(clock.t):
            return 1, measurement, {}, _StepClock(now)
        off = now - clock.t - waited * interval
        gap = off + interval
        if 0 < gap <= _LONGEST_GAP * interval:
            late = gap > _LATE * interval
            note = {"clock": f"{gap:.3g} s went by between two steps"} if late else {}
            return max(round(gap / interval), 1), measurement, note, _StepClock(now)
        near = interval * (2 + _RESYNC_SHARE * clock.strange)
        strange = clock.strange + 1 if clock.strange and abs(off - clock.off) <= near else 1
        if strange * interval >= _RESYNC:
            note = {"clock": f"the clock was set from {clock.t:.6g} to {now:.6g} s"}
            return 1, measurement, note, _StepClock(now)
        note = {"clock": f"time went from {clock.t:.6g} to {now:.6g} s; the reading is not used"}
        first = off if strange == 1 else clock.off
        return 1, math.nan, note, _StepClock(clock.t, waited, strange, first)

    def _predicted(self, state: GuardState, steps: int) -> tuple[Estimate, float, HeatedState]:
        """Return estimate, heated power and driven wire some intervals later, before a reading."""
        estimate, heated, driven = state.estimate, state.heated, state.driven
        observer, power = self.observer, state.applied**2
        interval, lag = observer.interval, observer.wire.lag
        for k in range(steps):
            if k:
                estimate = observer.corrected(estimate, math.nan)
            estimate = observer.predicted(estimate, state.applied)
            gained = power + max(estimate.ambient, 0.0) - heated
            heated += interval * gained / (lag + interval)
            driven = observer.wire.step(driven, power, interval, ambient=state.bias)
        return estimate, heated, driven

    def _check_reading(
        self,
        state: GuardState,
        read: tuple[object, float],
        predicted: Estimate,
        driven: float,
        steps: int,
    ) -> tuple[ReadingState, Lateness]:
        """Return the checks of a reading, raw and without coupling, and of its lateness."""
        expected = Expected(
            angle=predicted.expected,
            motion=predicted.wire.angle - state.estimate.wire.angle,
            heating=state.applied**2 + predicted.ambient - state.estimate.wire.power,
            driven=driven,
            steps=steps,
        )
        reading = self._readings.step(state.reading, *read, expected)
        lateness = self._lateness.step(
            state.lateness, state.estimate, state.applied, reading.value,
            expected=expected.angle, steps=steps,
        )  # fmt: skip
        if lateness.doubted and reading.fault not in COOLED:
            reading = reading._replace(value=math.nan, fault="late")
        return reading, lateness

    def _target(self, wanted: float, reach: ReachState) -> float:
        """Return the target of the law."""
        low, top = self.observer.wire.operator.range
        target = min(wanted, STROKE_SHARE * top)
        if reach.verdict is not None and reach.verdict.reason != "beyond the stroke":
            target = min(target, _HOLD_SHARE * reach.verdict.reach)
        # The loop begins flat: many powers give the angle of a cold wire.
        return target if target > low + _COLD else low - 1.0

    def _requested_current(
        self, state: GuardState, estimate: Estimate, target: float, known: float, steps: int
    ) -> tuple[float, Any]:
        """Return the current in A that the law requests, within its limits, and its state."""
        if isinstance(self.observer, ObserverControl):
            return self.observer.toward(estimate, target), None
        assert self.controller is not None
        inner = state.inner
        for _ in range(steps - 1):  # the law advances by its model, as the current did
            inner = self.controller.step(inner, target, math.nan)[1]
            inner = replace(inner, applied=state.applied)
        requested, inner = self.controller.step(inner, target, known)
        most = self.observer.highest
        return min(max(requested, 0.0), most) if math.isfinite(requested) else 0.0, inner

    def _allowed_current(self, estimate: Estimate, heated: float) -> float:
        """Return the largest current in A that keeps the wire cool enough by both estimates."""
        wire, interval = self.observer.wire, self.observer.interval
        bias = estimate.ambient
        power = min(
            self.limits.allowed(wire, heated, max(bias, 0.0), interval),
            self.limits.allowed(wire, estimate.wire.power, bias, interval),
        )
        return min(math.sqrt(power), self.observer.highest)

    def _useful(self, reading: ReadingState, reach: ReachState, estimate: Estimate) -> float:
        """Return the largest current in A for this state of the sensor and this target."""
        low, top = self.observer.wire.operator.range
        angle = reading.value if reading.used else estimate.angle
        verdict = reach.verdict
        nothing = verdict is not None and (
            verdict.reach < low + self.tolerance or verdict.reason == "no motion"
        )
        if reading.fault in COOLED or angle > STROKE_SHARE * top or nothing:
            return 0.0
        return self.observer.highest

    def _waits(
        self, state: GuardState, asked: float, wanted: float, reading: float, current: float
    ) -> tuple[float, float]:
        """Return the seconds for which the wire is behind a moving target, or too warm for it.

        ``asked`` and ``wanted``: requested angle, and the target computed from it, in degrees;
        ``reading``: in degrees, NaN if it is not used; ``current``: of the next interval, in A.
        """
        moving = asked != state.asked and math.isfinite(asked)
        at_limit = current >= self.observer.highest or current <= 0.0
        behind = at_limit and moving and abs(wanted - reading) > _BEHIND_BY
        idle = current <= 0.0 and reading > wanted + _BEHIND_BY and not state.fault
        interval = self.observer.interval
        return (
            state.behind + interval if behind else 0.0,
            state.idle + interval if idle else 0.0,
        )

    def _logged(self, old: GuardState, new: GuardState, notes: dict[Cause, str]) -> GuardState:
        """Return the new state with its log; a persistent cause is logged when it begins."""
        present = dict(self._present_causes(new)) | notes
        known = old.active if new.fault == old.fault else old.active - {"sensor"}
        fresh = [(cause, text) for cause, text in present.items() if cause not in known]
        for cause, after in _ENDED.items():
            if cause in old.active and cause not in present:
                fresh += [] if cause == "unread" and new.fault else [after]
        if not fresh and present.keys() == old.active:
            return new
        log = (*old.log, *(Event(new.steps, cause, text) for cause, text in fresh))
        return replace(new, active=frozenset(present), log=_newest(log) if fresh else old.log)

    def _present_causes(self, state: GuardState) -> Iterator[tuple[Cause, str]]:
        """Yield the causes that the state shows, with their sentences."""
        reading = state.reading
        odd = f"readings jumped by {reading.jumped:.3g} degrees, faster than the wire can move"
        if reading.believed:
            odd = f"readings are not from {self.sensor.low:g} to {self.sensor.high:g} degrees"
        if reading.fault:
            yield "sensor", _FAULTS[reading.fault].format(odd=odd, late=state.lateness.late)
        elif not reading.used and max(reading.missing, reading.odd) >= _UNREAD:
            what = "there is no reading" if reading.missing >= _UNREAD else odd
            yield "unread", f"{what}; the wire goes by its model"
        if state.unreachable is not None:
            yield "unreachable", str(state.unreachable)
        if state.behind > _BEHIND_FOR:
            yield "behind", "the target moves faster than the wire can follow"
        if state.idle > _IDLE_LAGS * self.observer.wire.lag:
            yield (
                "warm",
                f"without a current it stays above {state.reference:.1f} degrees: the surroundings "
                "are too warm",
            )
        if self.limits.stressed(state.estimate.angle):
            yield "stress", f"the stress of the wire is above {self.limits.stress / 1e6:.0f} MPa"


def _newest(log: tuple[Event, ...]) -> tuple[Event, ...]:
    """Return the newest events; a frequent cause does not displace others."""
    kept: list[Event] = []
    alike: dict[Cause, int] = {}
    for event in reversed(log):
        alike[event.cause] = alike.get(event.cause, 0) + 1
        if alike[event.cause] <= MOST_ALIKE:
            kept.append(event)
    return tuple(reversed(kept[:MOST_EVENTS]))
