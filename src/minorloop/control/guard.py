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

from minorloop.control.controller import Controller
from minorloop.control.limits import WireLimits
from minorloop.control.observer import Estimate, PowerObserver
from minorloop.control.reach import ReachState, ReachWatch, Unreachable
from minorloop.control.sensing import Sensed, SensorWatch
from minorloop.errors import ParameterError

Cause: TypeAlias = Literal[
    "sensor",
    "sensor back",
    "reference",
    "clock",
    "hot",
    "unreachable",
    "reachable",
    "behind",
    "stress",
]
MOST_EVENTS = 64
"""How many events the log keeps, the newest."""
_HOLD_SHARE = 0.9
_BEHIND_BY = 2.0
_BEHIND_FOR = 1.0
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
    behind : float
        For how long the wire has been behind the target at a limit, in seconds.
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
    behind: float = 0.0
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
        steps, said, notes = self._passed(state, said, t)
        wanted, notes = self._wanted(state, reference, notes)
        sensed = self.sensor.step(state.sensed, said)
        if raw is not None and math.isfinite(sensed.value):
            sensed = replace(sensed, value=measurement)
        estimate, heated = self._observed(state, steps, sensed.value)
        reach = self._watched(state, sensed, wanted, estimate)
        target = wanted
        if reach.verdict is not None:
            target = min(wanted, _HOLD_SHARE * reach.verdict.reach)
        asked, inner = self.controller.step(state.inner, target, sensed.value)
        asked = min(max(asked, 0.0), self.observer.highest) if math.isfinite(asked) else 0.0
        cool = self._allowed(estimate, heated)
        current = min(asked, cool, self._useful(sensed, reach))
        if current != asked:
            inner = replace(inner, applied=current)
        behind = self._behind(state, wanted, sensed.value, current)
        new = GuardState(
            inner,
            estimate,
            heated,
            sensed,
            reach,
            wanted,
            current,
            state.steps + 1,
            state.t if t is None or not math.isfinite(t) else max(t, _first(state.t)),
            behind,
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
        self, state: GuardState, measurement: float, t: float | None
    ) -> tuple[int, float, dict[Cause, str]]:
        """Intervals that passed, the reading if it is new, and what there is to note."""
        if t is None:
            return 1, measurement, {}
        if not math.isfinite(t):
            return 1, math.nan, {"clock": f"time is {t}; the reading is not used"}
        if math.isnan(state.t):
            return 1, measurement, {}
        gap = t - state.t
        if gap <= 0:
            text = f"time went from {state.t:.6g} to {t:.6g} s; the reading is not used"
            return 1, math.nan, {"clock": text}
        late = gap > _LATE * self.observer.interval
        note: dict[Cause, str] = {"clock": f"{gap:.3g} s went by between two steps"} if late else {}
        count = round(min(gap / self.observer.interval, _LONGEST_GAP))
        return max(count, 1), measurement, note

    def _wanted(
        self, state: GuardState, reference: float, notes: dict[Cause, str]
    ) -> tuple[float, dict[Cause, str]]:
        try:
            wanted = float(reference)
        except (TypeError, ValueError, OverflowError):
            wanted = math.nan
        if math.isfinite(wanted):
            return wanted, notes
        text = f"target {reference!r} is not a number; {state.reference:.4g} degrees stand"
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

    def _useful(self, sensed: Sensed, reach: ReachState) -> float:
        """Largest current in A that makes sense with this sensor and this target."""
        if sensed.fault:
            return 0.0
        verdict = reach.verdict
        if verdict is None or verdict.reason == "beyond the stroke":
            return self.observer.highest
        nothing = verdict.reach < self.observer.wire.operator.range[0] + self._watch.tolerance
        if nothing or verdict.reason == "no motion":
            return 0.0
        return _HOLD_SHARE * self.observer.highest

    def _behind(self, state: GuardState, wanted: float, value: float, current: float) -> float:
        """For how long the wire has been too slow for its target, at a limit of the current."""
        at_limit = current >= self.observer.highest or current <= 0.0
        moving = wanted != state.reference
        if at_limit and abs(wanted - value) > _BEHIND_BY and (moving or state.behind > 0):
            return state.behind + self.observer.interval
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
        if self.limits.stressed(new.estimate.wire.angle):
            present["stress"] = f"the wire bears more than {self.limits.stress / 1e6:.0f} MPa"
        fresh = [(cause, text) for cause, text in present.items() if cause not in old.active]
        if "sensor" in old.active and "sensor" not in present:
            fresh.append(("sensor back", "the sensor is believed again"))
        if "unreachable" in old.active and "unreachable" not in present:
            fresh.append(("reachable", "targets are tried again"))
        events = tuple(Event(new.steps, cause, text) for cause, text in fresh)
        log = (*old.log, *events)[-MOST_EVENTS:]
        return replace(new, active=frozenset(present), log=log)


def _first(t: float) -> float:
    return -math.inf if math.isnan(t) else t
