"""Open loop: the inverse of the operator after the inverse of the heating lag."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from minorloop_head.control.controller import Loop, heating
from minorloop_head.heated_wire import HeatedState, HeatedWire


@dataclass(frozen=True, eq=False)
class FeedforwardState:
    """State of open loop: the simulated wire, and the present current."""

    wire: HeatedState
    applied: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Feedforward(Loop):
    """Open-loop control by the model, without a sensor.

    References
    ----------
    Boudjabi, Ferreira and Krupa, Proc. IEEE ICRA 2003, Fig. 7; the order of lag and operator is
    that of the physics, and the model follows the current that was applied.
    """

    wire: HeatedWire
    response: float = 0.4
    """Time constant in seconds with which the angle follows, within the limits of the current."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> FeedforwardState:
        """Return the state of a wire that has settled at an angle under a current."""
        return FeedforwardState(self.wire.found(current**2, measurement), current)

    def step(
        self, state: FeedforwardState, reference: float, measurement: float = math.nan
    ) -> tuple[float, FeedforwardState]:
        """Return the current for the next interval and the next state, without the measurement."""
        wire = self.wire.step(state.wire, state.applied**2, self.interval)
        current = self.current(heating(self.wire, wire, reference, response=self.response))
        return current, replace(state, wire=wire, applied=current)
