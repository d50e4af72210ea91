"""The inverse of the operator as feedforward, beside proportional and integral feedback."""

from __future__ import annotations

from dataclasses import dataclass

from minorloop.operators.preisach import Preisach
from minorloop.operators.tracker import Tracker
from minorloop_head.heated_wire import HeatedWire
from papers.catheter.control.pi import Feedback, ProportionalIntegralState


@dataclass(frozen=True, eq=False)
class FeedforwardPIState(ProportionalIntegralState):
    """State of the feedback, and the memory of the inverse operator, which follows the targets.

    The tracker is copied and never pushed.
    """

    tracker: Tracker[Preisach]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedforwardPI(Feedback):
    """Feedforward by the inverse operator with proportional and integral feedback.

    u^2 = Gamma^-1[r] + k_p e + k_i times the integral of e, e = r - y.

    Parameters
    ----------
    wire : HeatedWire
        Its operator is inverted; its lag is left to the feedback.
    proportional, integral, unwinding
        As in `Feedback`.
    interval, delay, highest
        As in `Loop`.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    References
    ----------
    Ge and Jouaneh, Precision Engineering 20, 1997, pp. 91-111, for a piezoceramic actuator;
    Boudjabi, Ferreira and Krupa (2003) name it beside their own controller.

    Notes
    -----
    With twice the gains of the loop without feedforward, circles and a warming ambient are followed
    best; a step settles no sooner with others (specimens 1000 to 1002).
    """

    wire: HeatedWire
    proportional: float = 0.012
    integral: float = 0.0024

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> FeedforwardPIState:
        """Return a state that keeps the present current if the reference is the measurement."""
        power = current**2
        tracker = self.wire.found(power, measurement).tracker.copy()
        ahead = tracker.aim(measurement, "clip")
        tracker.push(ahead)
        return FeedforwardPIState(power - ahead, power, current, tracker)

    def step(
        self, state: FeedforwardPIState, reference: float, measurement: float
    ) -> tuple[float, FeedforwardPIState]:
        """Return the next current and state; a missing reading keeps the present current."""
        tracker = state.tracker.copy()
        ahead = tracker.aim(reference, "clip")
        tracker.push(ahead)
        current, integral, wanted = self.follow(state, reference - measurement, ahead)
        return current, FeedforwardPIState(integral, wanted, current, tracker)
