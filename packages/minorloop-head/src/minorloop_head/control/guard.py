"""Guard around every controller: limits, checks of sensor and target, and a log.

Whatever the controller requests and the sensor reads, the current that leaves the guard keeps the
limits of current and temperature. If the sensor is lost, stuck or has the wrong sign, the wire
cools; if it reads what no wire can do, the wire goes by its model for some seconds, and then cools
until both agree, as they do for a cold wire; if a target cannot be reached, the guard holds an
angle that can. Nothing is raised in the loop; the log gives reasons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

from minorloop.errors import ParameterError
from minorloop_head.control.controller import Controller, Loop
from minorloop_head.control.delays import DelayWatch
from minorloop_head.control.guard_log import ASTRAY, GuardLog
from minorloop_head.control.guard_state import COOLED, Cause, GuardState, StepClock
from minorloop_head.control.lateness import StopWatch
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.motion import MotionWatch, SignWatch
from minorloop_head.control.observer import Estimate, PowerObserver
from minorloop_head.control.reach import STROKE_SHARE, ReachState, ReachWatch
from minorloop_head.control.sensing import Fault, Sensed, SensorWatch, as_number
from minorloop_head.heated_wire import HeatedState

_HOLD_SHARE = 0.9
"""Share of the reach of a wire at which an unreachable target is held: some current is left."""
_COLD = 0.3
"""Degrees above the cold wire below which a target means no current."""
_BEHIND_BY = 2.0
"""Degrees from which a wire at a limit counts as behind a moving target."""
_RESYNC, _RESYNC_SHARE = 5.0, 0.1
"""Seconds for which times differ from their clock by the same time, and share of them by which that
may change, until the clock counts as set: longer than readings come late in a row."""
_LARGEST = 1e6
"""Angle in degrees from which a number counts as none."""
_LONGEST_GAP = 500
"""Intervals after which a gap counts as a jump of the clock: 20 s at 25 Hz."""
_LATE = 1.5
"""Intervals from which a step counts as late."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Guard:
    """A controller inside the limits of its wire.

    Raises
    ------
    ParameterError
        If controller and observer do not have the same interval.
    """

    controller: Controller
    """Of one wire."""
    observer: PowerObserver
    """Estimates the effective power of the wire, and so its temperature."""
    limits: WireLimits = field(default_factory=WireLimits)
    """Of the wire."""
    sensor: SensorWatch = field(default_factory=SensorWatch)
    """Checks of the sensor."""

    def __post_init__(self) -> None:
        kinds = {"observer": PowerObserver, "limits": WireLimits, "sensor": SensorWatch}
        for name, kind in kinds.items():
            if not isinstance(getattr(self, name), kind):
                raise ParameterError(f"{name} is {getattr(self, name)!r}; give a {kind.__name__}")
        if self.controller.interval != self.observer.interval:
            raise ParameterError(
                f"the controller steps every {self.controller.interval} s and the observer every "
                f"{self.observer.interval} s; give them the same interval"
            )

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> GuardState:
        """Return the state of a wire that has settled at an angle under a current.

        Parameters
        ----------
        measurement : float
            In degrees; 0 if it is not a number.
        current : float
            In A; clipped to the limits.
        """
        angle = measurement if math.isfinite(measurement) else 0.0
        most = self.observer.highest
        on = min(max(current, 0.0), most) if math.isfinite(current) else most
        estimate = self.observer.found(angle, on)
        heated = max(on**2, estimate.wire.power)
        return GuardState(
            inner=self.controller.begin(angle, on),
            estimate=estimate,
            heated=heated,
            driven=estimate.wire,
            bias=estimate.ambient,
            reference=angle,
            applied=on,
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

        Parameters
        ----------
        state : GuardState
        reference : float
            Wanted angle in degrees; the last valid one is used if it is not a number.
        measurement : float
            Newest reading in degrees, or NaN.
        t : float, optional
            Time of the reading in seconds. A reading that is late is not used; during a gap the
            current is assumed to have been on.
        raw : float, optional
            Reading of the sensor, if the measurement was computed from it and others.
        asked : object, optional
            What was asked for, if the reference was computed from it.
        """
        reading = measurement if raw is None else raw
        whole = as_number(reference if asked is None else asked)
        steps, read, notes, clock = self._passed(state, reading, t)
        wanted, notes = self._wanted(state, reference, asked, notes)
        estimate, heated = self._predicted(state, steps)
        number, expected = as_number(read), estimate.expected
        usable = math.isfinite(number) and self.sensor.possible(number)
        angle = as_number(measurement) if usable else math.nan
        belief = self._motion.step(
            state.belief,
            angle,
            expected,
            motion=estimate.wire.angle - state.estimate.wire.angle,
            heating=state.applied**2 + estimate.ambient - state.estimate.wire.power,
            steps=steps,
        )
        sensed = self.sensor.step(state.sensed, read, believed=belief.believed)
        if raw is not None and math.isfinite(sensed.value):
            sensed = replace(sensed, value=measurement)
        driven = self._driven(state, steps)
        sign = self._sign.step(state.sign, angle, driven.angle, steps=steps)
        if sign.reversed or belief.astray > ASTRAY:
            fault: Fault = "reversed" if sign.reversed else "unconfirmed"
            sensed = replace(sensed, value=math.nan, fault=fault)
        used = math.nan if sensed.fault or not belief.believed else angle
        stop = self._stop.step(state.stop, used, state.applied**2, steps=steps)
        delays = self._delays.step(
            state.delays, state.estimate, state.applied, used, expected=expected, steps=steps
        )
        late = stop.late or delays.late
        if late and not state.lateness.doubted:  # the readings have led the estimate astray
            past = (driven.angle,) * len(estimate.past)
            estimate = Estimate(driven, state.bias, 0.0, past)
        lateness = state.lateness.later(steps * self.observer.interval, late)
        if lateness.doubted > 0.0 and sensed.fault not in COOLED:
            sensed = replace(sensed, value=math.nan, fault="late")
        estimate = self.observer.corrected(estimate, sensed.value)
        reach = self._watched(state, sensed, wanted, estimate)
        target = self._target(wanted, reach)
        # Where readings are not believed, a law goes on with what the model expects.
        doubted = sensed.fault in ("implausible", "late") or (usable and not belief.believed)
        known = expected if doubted or sign.reversed else sensed.value
        inner = state.inner
        for _ in range(steps - 1):  # the law goes on by its model, as the current did
            inner = replace(self.controller.step(inner, target, math.nan)[1], applied=state.applied)
        requested, inner = self.controller.step(inner, target, known)
        most = self.observer.highest
        requested = min(max(requested, 0.0), most) if math.isfinite(requested) else 0.0
        cool = self._allowed(estimate, heated)
        current = min(requested, cool, self._useful(sensed, reach, estimate))
        if current != requested:
            inner = replace(inner, applied=current)
        moving = math.isfinite(whole) and whole != state.asked
        behind = self._behind(state, wanted, sensed.value, current, moving=moving)
        idle = self._idle(state, wanted, sensed.value, current)
        new = GuardState(
            inner=inner,
            estimate=estimate,
            heated=heated,
            sensed=sensed,
            belief=belief,
            driven=driven,
            bias=state.bias,
            sign=sign,
            lateness=lateness,
            stop=stop,
            delays=delays,
            reach=reach,
            reference=wanted,
            asked=whole,
            applied=current,
            steps=state.steps + 1,
            clock=clock,
            behind=behind,
            idle=idle,
            active=state.active,
            log=state.log,
        )
        hot = self.temperature(new) if cool < requested else None
        return current, self._log.step(state, new, notes, hot)

    def later(self, steps: int) -> Guard:
        """Return the guard for readings that are older by some intervals; states remain valid.

        Parameters
        ----------
        steps : int
            0 or more. A law without a delay of its own, such as the adaptive one, remains as it is.
        """
        law = self.controller
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
        return ReachWatch(
            wire=self.observer.wire,
            rise=self.limits.rise,
            interval=self.observer.interval,
            delay=self.observer.delay,
            highest=self.observer.highest,
        )

    @cached_property
    def _log(self) -> GuardLog:
        return GuardLog(limits=self.limits, sensor=self.sensor, lag=self.observer.wire.lag)

    @cached_property
    def _motion(self) -> MotionWatch:
        return MotionWatch(
            wire=self.observer.wire, jump=self.sensor.jump, interval=self.observer.interval
        )

    @cached_property
    def _stop(self) -> StopWatch:
        return StopWatch(
            wire=self.observer.wire,
            jump=self.sensor.jump,
            interval=self.observer.interval,
            delay=self.observer.delay,
            highest=self.observer.highest,
        )

    @cached_property
    def _sign(self) -> SignWatch:
        return SignWatch(
            wire=self.observer.wire,
            jump=self.sensor.jump,
            interval=self.observer.interval,
            highest=self.observer.highest,
        )

    @cached_property
    def _delays(self) -> DelayWatch:
        return DelayWatch(observer=self.observer)

    def _driven(self, state: GuardState, steps: int) -> HeatedState:
        """Return the wire by its current alone, some intervals later."""
        wire, driven = self.observer.wire, state.driven
        power, interval = state.applied**2, self.observer.interval
        for _ in range(steps):
            driven = wire.step(driven, power, interval, ambient=state.bias)
        return driven

    def _passed(
        self, state: GuardState, measurement: object, t: object
    ) -> tuple[int, object, dict[Cause, str], StepClock]:
        """Return the passed intervals, the reading if it is new, notes, and the clock.

        If times differ from the clock by the same time for seconds, it was set.
        """
        clock, interval = state.clock, self.observer.interval
        waited = clock.waited + 1
        if t is None:
            return 1, measurement, {}, replace(clock, waited=waited, strange=0)
        now = as_number(t)
        if not math.isfinite(now):
            note: dict[Cause, str] = {"clock": f"time is {t!r:.40}; the reading is not used"}
            return 1, math.nan, note, replace(clock, waited=waited, strange=0)
        if math.isnan(clock.t):
            return 1, measurement, {}, StepClock(now)
        off = now - clock.t - waited * interval
        gap = off + interval
        if 0 < gap <= _LONGEST_GAP * interval:
            late = gap > _LATE * interval
            note = {"clock": f"{gap:.3g} s went by between two steps"} if late else {}
            return max(round(gap / interval), 1), measurement, note, StepClock(now)
        near = interval * (2 + _RESYNC_SHARE * clock.strange)
        strange = clock.strange + 1 if clock.strange and abs(off - clock.off) <= near else 1
        if strange * interval >= _RESYNC:
            note = {"clock": f"the clock was set from {clock.t:.6g} to {now:.6g} s"}
            return 1, measurement, note, StepClock(now)
        note = {"clock": f"time went from {clock.t:.6g} to {now:.6g} s; the reading is not used"}
        return (
            1,
            math.nan,
            note,
            StepClock(clock.t, waited, strange, off if strange == 1 else clock.off),
        )

    def _target(self, wanted: float, reach: ReachState) -> float:
        """Return the target of the controller."""
        low, top = self.observer.wire.operator.range
        target = min(wanted, STROKE_SHARE * top)
        if reach.verdict is not None and reach.verdict.reason != "beyond the stroke":
            target = min(target, _HOLD_SHARE * reach.verdict.reach)
        # The loop begins flat: many powers give the angle of a cold wire.
        return target if target > low + _COLD else low - 1.0

    def _wanted(
        self, state: GuardState, reference: object, asked: object, notes: dict[Cause, str]
    ) -> tuple[float, dict[Cause, str]]:
        wanted = as_number(reference)
        if abs(wanted) < _LARGEST:
            return wanted, notes
        given = reference if asked is None else asked
        shown = float(given) if isinstance(given, float) else given
        text = (
            f"target {shown!r:.40} is not a number below {_LARGEST:g}; {state.reference:.4g} "
            "degrees are kept"
        )
        return state.reference, {**notes, "reference": text}

    def _predicted(self, state: GuardState, steps: int) -> tuple[Estimate, float]:
        """Return the estimate after some intervals before its reading, and the heated power."""
        estimate, heated = state.estimate, state.heated
        observer, lag = self.observer, self.observer.wire.lag
        for k in range(steps):
            if k:
                estimate = observer.corrected(estimate, math.nan)
            estimate = observer.predicted(estimate, state.applied)
            gained = state.applied**2 + max(estimate.ambient, 0.0) - heated
            heated += observer.interval * gained / (lag + observer.interval)
        return estimate, heated

    def _watched(
        self, state: GuardState, sensed: Sensed, wanted: float, estimate: Estimate
    ) -> ReachState:
        if sensed.fault:
            return ReachState()
        return self._watch.step(state.reach, wanted, sensed.value, state.applied, estimate)

    def _allowed(self, estimate: Estimate, heated: float) -> float:
        """Return the largest current in A that keeps the wire cool enough by both estimates."""
        wire, interval = self.observer.wire, self.observer.interval
        bias = estimate.ambient
        power = min(
            self.limits.allowed(wire, heated, max(bias, 0.0), interval),
            self.limits.allowed(wire, estimate.wire.power, bias, interval),
        )
        return min(math.sqrt(power), self.observer.highest)

    def _useful(self, sensed: Sensed, reach: ReachState, estimate: Estimate) -> float:
        """Return the largest current in A for this state of the sensor and this target."""
        low, top = self.observer.wire.operator.range
        angle = sensed.value if math.isfinite(sensed.value) else estimate.angle
        if sensed.fault in COOLED or angle > STROKE_SHARE * top:
            return 0.0
        verdict = reach.verdict
        if verdict is None:
            return self.observer.highest
        nothing = verdict.reach < low + self._watch.tolerance
        return 0.0 if nothing or verdict.reason == "no motion" else self.observer.highest

    def _behind(
        self, state: GuardState, wanted: float, value: float, current: float, *, moving: bool
    ) -> float:
        """Return the seconds for which the wire, at a limit, has been behind a moving target."""
        at_limit = current >= self.observer.highest or current <= 0.0
        if at_limit and moving and abs(wanted - value) > _BEHIND_BY:
            return state.behind + self.observer.interval
        return 0.0

    def _idle(self, state: GuardState, wanted: float, value: float, current: float) -> float:
        """Return the seconds for which the wire has been above its target without a current."""
        if current <= 0.0 and value > wanted + _BEHIND_BY and not state.sensed.fault:
            return state.idle + self.observer.interval
        return 0.0
