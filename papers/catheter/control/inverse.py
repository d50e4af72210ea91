"""What the laws around the inverse operator share."""

from __future__ import annotations

from dataclasses import dataclass

from minorloop.operators.preisach import Preisach
from minorloop.operators.tracker import Tracker
from minorloop_head.control.controller import Loop


@dataclass(frozen=True, eq=False, kw_only=True)
class InverseLoop(Loop):
    """A loop around the inverse of an operator."""

    def inverse(self, tracker: Tracker[Preisach], angle: float) -> float:
        """Return the current in A whose power brings an operator to an angle in degrees.

        It is the largest for angles at the end of the range and beyond: where the plane is flat
        there, the inverse would give the least input that reaches it.
        """
        beyond = angle >= tracker.model.range[1]
        return self.highest if beyond else self.current(tracker.aim(angle, "clip"))
