"""The layer that every controller goes through: limits, sensor, targets, and the log.

Whatever the controller asks for, whatever the sensor says, what leaves this layer keeps the
limits of current and temperature. A sensor that cannot be believed ends in cooling, a target
that cannot be reached in holding what can; nothing is raised in the loop, and the log says why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

from minorloop.errors import ParameterError
from minorloop.head.control.controller import Controller
from minorloop.head.control.limits import WireLimits
from minorloop.head.control.observer import Estimate, PowerObserver
from minorloop.head.control.reach import STROKE_SHARE, ReachState, ReachWatch, Unreachable
from minorloop.head.control.sensing import Sensed, SensorWatch, as_number

Cause: TypeAlias = Literal[
    "sensor",
    "sensor back",
    "reference",
    "clock",
    "hot",
    "unreachable",
    "reachable",
    "behind",
    "warm",
    "stress",
]
MOST_EVENTS, MOST_ALIKE = 64, 8
"""How many events the log keeps, the newest, and of one cause."""
_HOLD_SHARE = 0.9
_COLD = 0.3
_BEHIND_BY = 2.0
_BEHIND_FOR = 1.0
_IDLE_LAGS = 4.0
_RESYNC = 3
_LONGEST_GAP = 500
_LATE = 1.5


@dataclass(frozen=True)
class Event:
    """Something that the log keeps.

    Parameters
    ----------
    step : int
        Number of the step, from 1.
    cause : str
        What kind of thing, such as ``sensor`` or ``unreachable``.
    text : str
        A sentence.
    """

    step: int
    cause: Cause
    text: str


@dataclass(frozen=True, eq=False)
class GuardState:
    """What the guard remembers.

    Parameters
    ----------
    inner : state of the controller
    estimate : Estimate
        Of the wire.
    heated : float
        Effective power that the current alone explains, in A^2.
    sensed : Sensed
        Of the sensor.
    reach : ReachState
        Of the target.
    reference : float
        Last target that was a number, in degrees.
    applied : float
        Current in A that is on.
    steps : int
        Steps so far.
    t : float
        Time of the last step in seconds, NaN if none was given.
    strange : int
        How many times in a row have not gone on from there, but from one another.
    last : float
        Time that was given last, in seconds.
    behind : float
        For how long the wire has been behind a moving target at a limit, in seconds.
    idle : float
        For how long it has been above its target without a current, in seconds.
    active : frozenset of str
        Causes that persist.
    log : tuple of Event
        The newest events, oldest first.
    """

    inner: Any
    estimate: Estimate
    heated: float
    sensed: Sensed
    reach: ReachState
    reference: float
    applied: float
    steps: int = 0
    t: float = math.nan
    strange: int = 0
    last: float = math.nan
    behind: float = 0.0
    idle: float = 0.0
    active: frozenset[Cause] = frozenset()
    log: tuple[Event, ...] = ()

    @property
    def unreachable(self) -> Unreachable | None:
        """Why the target is out of reach, None if it is not known to be."""
        return self.reach.verdict

    @property
    def fault(self) -> str:
        """What is wrong with the sensor; empty if nothing is."""
        return self.sensed.fault


@dataclass(frozen=True, eq=False, kw_only=True)
class Guard:
    """A controller inside the limits of its wire.

    Parameters
    ----------
    controller : Controller
        Of one wire.
    observer : PowerObserver
        Watches the wire beside the controller: its effective power is its temperature.
    limits : WireLimits
        What the wire may bear.
    sensor : SensorWatch
        What the sensor is like.

    Raises
    ------
    ParameterError
        If controller and observer do not have the same interval.
    """

    controller: Controller
    observer: PowerObserver
    limits: WireLimits = field(default_factory=WireLimits)
    sensor: SensorWatch = field(default_factory=SensorWatch)

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
        """State of a wire that is found settled at an angle under a current.

        Parameters
        ----------
        measurement : float
            In degrees; one that is not a number counts as 0.
        current : float
            In A; beyond the limits it counts as the nearer one.
        """
        angle = measurement if math.isfinite(measurement) else 0.0
        most = self.observer.highest
        on = min(max(current, 0.0), most) if math.isfinite(current) else most
        estimate = self.observer.found(angle, on)
        heated = max(on**2, estimate.wire.power)
        inner = self.controller.begin(angle, on)
        return GuardState(inner, estimate, heated, Sensed(), ReachState(), angle, on)

    def step(
        self,
        state: GuardState,
        reference: float,
        measurement: float,
        *,
        t: float | None = None,
        raw: float | None = None,
    ) -> tuple[float, GuardState]:
        """Current for the next interval, within the limits; nothing is raised.

        Parameters
        ----------
        state : GuardState
        reference : float
            Angle wanted in degrees; the last number stands in for what is none.
        measurement : float
            Newest reading in degrees, or NaN.
        t : float, optional
            Time of the reading in seconds. Readings that are not later than the one before are
            not used; after a gap the wire is taken to have had its current on throughout.
        raw : float, optional
            What the sensor said, where the measurement was worked out from more than that.
        """
        said = measurement if raw is None else raw
        steps, read, notes, clock = self._passed(state, said, t)
        wanted, notes = self._wanted(state, reference, notes)
        sensed = self.sensor.step(state.sensed, read)
        if raw is not None and math.isfinite(sensed.value):
            sensed = replace(sensed, value=measurement)
        estimate, heated = self._observed(state, steps, sensed.value)
        reach = self._watched(state, sensed, wanted, estimate)
        target = self._target(wanted, reach)
        asked, inner = self.controller.step(state.inner, target, sensed.value)
        asked = min(max(asked, 0.0), self.observer.highest) if math.isfinite(asked) else 0.0
        cool = self._allowed(estimate, heated)
        current = min(asked, cool, self._useful(sensed, reach, estimate))
        if current != asked:
            inner = replace(inner, applied=current)
        behind = self._behind(state, wanted, sensed.value, current)
        idle = self._idle(state, wanted, sensed.value, current)
        new = GuardState(
            inner,
            estimate,
            heated,
            sensed,
            reach,
            wanted,
            current,
            state.steps + 1,
            *clock,
            behind,
            idle,
        )
        return current, self._logged(state, new, notes, cool < asked)

    def temperature(self, state: GuardState) -> float:
        """Highest temperature that the wire may have now, in degrees Celsius."""
        return self.limits.temperature(max(state.heated, state.estimate.wire.power))

    @cached_property
    def _watch(self) -> ReachWatch:
        return ReachWatch(
            wire=self.observer.wire,
            rise=self.limits.rise,
            interval=self.observer.interval,
            delay=self.observer.delay,
            highest=self.observer.highest,
        )

    def _passed(
        self, state: GuardState, measurement: object, t: object
    ) -> tuple[int, object, dict[Cause, str], tuple[float, int, float]]:
        """Intervals that passed, the reading if it is new, what there is to note, the clock.

        The clock is the time that is believed, how many in a row did not go on from it but
        from one another, and the last of these. A few such, and the clock was set.
        """
        if t is None:
            return 1, measurement, {}, (state.t, state.strange, state.last)
        now = as_number(t)
        if math.isnan(now):
            note: dict[Cause, str] = {"clock": f"time is {t!r:.40}; the reading is not used"}
            return 1, math.nan, note, (state.t, 0, state.last)
        if math.isnan(state.t):
            return 1, measurement, {}, (now, 0, now)
        gap, interval = now - state.t, self.observer.interval
        if 0 < gap <= _LONGEST_GAP * interval:
            late = gap > _LATE * interval
            note = {"clock": f"{gap:.3g} s went by between two steps"} if late else {}
            return max(round(gap / interval), 1), measurement, note, (now, 0, now)
        goes_on = 0 < now - state.last <= 2 * _LATE * interval
        strange = state.strange + 1 if goes_on else 1
        if strange >= _RESYNC:
            note = {"clock": f"the clock was set from {state.t:.6g} to {now:.6g} s"}
            return 1, measurement, note, (now, 0, now)
        note = {"clock": f"time went from {state.t:.6g} to {now:.6g} s; the reading is not used"}
        return 1, math.nan, note, (state.t, strange, now)

    def _target(self, wanted: float, reach: ReachState) -> float:
        """What the controller is told to aim at."""
        low, top = self.observer.wire.operator.range
        target = min(wanted, STROKE_SHARE * top)
        if reach.verdict is not None and reach.verdict.reason != "beyond the stroke":
            target = min(target, _HOLD_SHARE * reach.verdict.reach)
        # The flat beginning of the loop has the output of a cold wire up to a good heat.
        return target if target > low + _COLD else low - 1.0

    def _wanted(
        self, state: GuardState, reference: float, notes: dict[Cause, str]
    ) -> tuple[float, dict[Cause, str]]:
        wanted = as_number(reference)
        if math.isfinite(wanted):
            return wanted, notes
        text = f"target {reference!r:.40} is not a number; {state.reference:.4g} degrees stand"
        return state.reference, {**notes, "reference": text}

    def _observed(self, state: GuardState, steps: int, value: float) -> tuple[Estimate, float]:
        estimate, heated = state.estimate, state.heated
        observer, lag = self.observer, self.observer.wire.lag
        for k in range(steps):
            reading = value if k == steps - 1 else math.nan
            estimate = observer.update(estimate, state.applied, reading)
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
        """Largest current in A after which the wire is not too hot, whichever estimate holds."""
        wire, interval = self.observer.wire, self.observer.interval
        bias = estimate.ambient
        power = min(
            self.limits.allowed(wire, heated, max(bias, 0.0), interval),
            self.limits.allowed(wire, estimate.wire.power, bias, interval),
        )
        return min(math.sqrt(power), self.observer.highest)

    def _useful(self, sensed: Sensed, reach: ReachState, estimate: Estimate) -> float:
        """Largest current in A that makes sense with this sensor and this target."""
        low, top = self.observer.wire.operator.range
        angle = sensed.value if math.isfinite(sensed.value) else estimate.wire.angle
        if sensed.fault or angle > STROKE_SHARE * top:
            return 0.0
        verdict = reach.verdict
        if verdict is None:
            return self.observer.highest
        nothing = verdict.reach < low + self._watch.tolerance
        return 0.0 if nothing or verdict.reason == "no motion" else self.observer.highest

    def _behind(self, state: GuardState, wanted: float, value: float, current: float) -> float:
        """For how long the wire has been too slow for a moving target, at a limit."""
        at_limit = current >= self.observer.highest or current <= 0.0
        moving = wanted != state.reference
        if at_limit and moving and abs(wanted - value) > _BEHIND_BY:
            return state.behind + self.observer.interval
        return 0.0

    def _idle(self, state: GuardState, wanted: float, value: float, current: float) -> float:
        """For how long it has been above its target without a current."""
        if current <= 0.0 and value > wanted + _BEHIND_BY and not state.sensed.fault:
            return state.idle + self.observer.interval
        return 0.0

    def _logged(
        self, old: GuardState, new: GuardState, notes: dict[Cause, str], hot: bool
    ) -> GuardState:
        """The new state with its log: a cause that persists is noted when it begins."""
        present = dict(notes)
        if new.fault:
            present["sensor"] = f"the sensor is {new.fault}; the wire cools"
        if new.unreachable is not None:
            present["unreachable"] = str(new.unreachable)
        if hot:
            present["hot"] = (
                f"the wire may be {self.temperature(new):.0f} degrees Celsius; less current"
            )
        if new.behind > _BEHIND_FOR:
            present["behind"] = "the target moves faster than the wire can follow"
        if new.idle > _IDLE_LAGS * self.observer.wire.lag:
            present["warm"] = (
                f"without a current it stays above {new.reference:.3g} degrees: the surroundings "
                "are too warm"
            )
        if self.limits.stressed(new.estimate.wire.angle):
            present["stress"] = f"the wire bears more than {self.limits.stress / 1e6:.0f} MPa"
        fresh = [(cause, text) for cause, text in present.items() if cause not in old.active]
        if "sensor" in old.active and "sensor" not in present:
            fresh.append(("sensor back", "the sensor is believed again"))
        if "unreachable" in old.active and "unreachable" not in present:
            fresh.append(("reachable", "targets are tried again"))
        events = tuple(Event(new.steps, cause, text) for cause, text in fresh)
        log = _newest((*old.log, *events)) if events else old.log
        return replace(new, active=frozenset(present), log=log)


def _newest(log: tuple[Event, ...]) -> tuple[Event, ...]:
    """The newest events, so that one cause that comes and goes does not push out others."""
    kept: list[Event] = []
    alike: dict[Cause, int] = {}
    for event in reversed(log):
        alike[event.cause] = alike.get(event.cause, 0) + 1
        if alike[event.cause] <= MOST_ALIKE:
            kept.append(event)
    return tuple(reversed(kept[:MOST_EVENTS]))
