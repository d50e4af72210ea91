"""Log of the guard: which causes are present, and what it says of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from minorloop_head.control.guard_state import Cause, Event, GuardState
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.motion import Belief
from minorloop_head.control.sensing import SensorWatch

MOST_EVENTS, MOST_ALIKE = 64, 8
"""How many events the log keeps: the newest, and those of one cause."""
ASTRAY = 10.0
"""Seconds for which a wire goes by its model while readings contradict it: either may be wrong, the
model after readings that were wrong and looked right. A cold wire shows which."""
_UNREAD = 5
"""Missing readings from which the log says so, where the patience is longer: more than are lost by
chance."""
_BEHIND_FOR = 1.0
"""Seconds from which a wire behind a moving target is logged."""
_IDLE_LAGS = 4.0
"""Lags without current after which a wire above its target means surroundings that are too warm:
98 % of the heat have left it by then."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GuardLog:
    """What a guard logs."""

    limits: WireLimits
    """Of the wire."""
    sensor: SensorWatch
    """Checks of the sensor."""
    lag: float
    """Time constant of the wire, in seconds."""

    def step(
        self, old: GuardState, new: GuardState, notes: Mapping[Cause, str], hot: float | None
    ) -> GuardState:
        """Return the new state with its log; a persistent cause is logged when it begins.

        Parameters
        ----------
        old, new : GuardState
            Before and after the step.
        notes : mapping of str to str
            Causes that the guard has found, and their sentences.
        hot : float, optional
            Temperature in degrees Celsius that limits the current; None if none does.
        """
        present = dict(notes)
        unread = not new.fault and math.isnan(new.sensed.value)
        if unread and new.sensed.missing >= _UNREAD:
            present["unread"] = "there is no reading; the wire goes by its model"
        elif unread and new.sensed.odd >= _UNREAD:
            present["unread"] = f"{self._odd(new.belief)}; the wire goes by its model"
        if new.fault:
            present["sensor"] = self._faulty(new)
        if new.unreachable is not None:
            present["unreachable"] = str(new.unreachable)
        if hot is not None:
            present["hot"] = f"the wire may be {hot:.0f} degrees Celsius; less current"
        if new.behind > _BEHIND_FOR:
            present["behind"] = "the target moves faster than the wire can follow"
        if new.idle > _IDLE_LAGS * self.lag:
            present["warm"] = (
                f"without a current it stays above {new.reference:.1f} degrees: the surroundings "
                "are too warm"
            )
        if self.limits.stressed(new.estimate.angle):
            present["stress"] = (
                f"the stress of the wire is above {self.limits.stress / 1e6:.0f} MPa"
            )
        known = old.active if new.fault == old.fault else old.active - {"sensor"}
        fresh = [(cause, text) for cause, text in present.items() if cause not in known]
        if "sensor" in old.active and "sensor" not in present:
            fresh.append(("sensor back", "the sensor is trusted again"))
        if "unread" in old.active and "unread" not in present and not new.fault:
            fresh.append(("read again", "there are readings again"))
        if "unreachable" in old.active and "unreachable" not in present:
            fresh.append(("reachable", "targets are tried again"))
        events = tuple(Event(new.steps, cause, text) for cause, text in fresh)
        if not events and present.keys() == old.active:
            return new
        log = _newest((*old.log, *events)) if events else old.log
        return replace(new, active=frozenset(present), log=log)

    def _faulty(self, state: GuardState) -> str:
        """Return what is wrong with the sensor, and what the wire does."""
        if state.fault == "implausible":
            return (
                f"the sensor is implausible: {self._odd(state.belief)}; the wire goes by its model"
            )
        if state.fault == "late":
            return (
                f"readings show where the wire was {state.lateness.late:.1f} s before: they are "
                "late, or a load sways the wire; it goes by its model for a while"
            )
        if state.fault == "reversed":
            return (
                "readings fall while the wire is heated: the sign of the sensor is reversed, or "
                "the picture is mirrored; the wire cools until it is begun anew"
            )
        if state.fault == "unconfirmed":
            return (
                f"readings have contradicted the model for {ASTRAY:g} s, and one of both is "
                "wrong; the wire cools until they agree"
            )
        return f"the sensor is {state.fault}; the wire cools"

    def _odd(self, belief: Belief) -> str:
        """Return what is wrong with readings that are not believed."""
        if belief.believed:
            return f"readings are not from {self.sensor.low:g} to {self.sensor.high:g} degrees"
        return f"readings jumped by {belief.jumped:.3g} degrees, which no wire can"


def _newest(log: tuple[Event, ...]) -> tuple[Event, ...]:
    """Return the newest events; a frequent cause does not displace others."""
    kept: list[Event] = []
    alike: dict[Cause, int] = {}
    for event in reversed(log):
        alike[event.cause] = alike.get(event.cause, 0) + 1
        if alike[event.cause] <= MOST_ALIKE:
            kept.append(event)
    return tuple(reversed(kept[:MOST_EVENTS]))
