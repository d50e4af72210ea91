"""Bring the catheter to a place, and then the head to a line of sight."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.procedures.values import (
    NOTHING,
    Procedure,
    Reading,
    Request,
    held_since,
    passed,
)

GoStage: TypeAlias = Literal["travel", "rest", "turn"]


@dataclass(frozen=True, eq=False, kw_only=True)
class GoState:
    """State of a move to a place (2,), advance and roll, and angles (2,); None stays.

    The stage began at ``since``. The head has been at its angles without a break from
    ``near_since``. ``reached`` is False if something took too long.
    """

    place: FloatArray | None
    angles: FloatArray | None
    stage: GoStage
    since: float | None = None
    near_since: float | None = None
    reached: bool = True
    done: bool = False


@dataclass(frozen=True, kw_only=True)
class Go(Procedure[GoState]):
    """Travel of the catheter, a rest, and a turn of the head.

    Parameters
    ----------
    gain : float
        Rate of the catheter over its distance from the place, in 1/s. A higher one overshoots,
        since the tip follows its motor late.
    fastest : (float, float)
        Highest rates of advance in m/s and of roll in rad/s.
    near : (float, float)
        Tolerance of the place: 0.05 mm and 0.3 degrees, the resolution of its sensors.
    patience : float
        Seconds after which the catheter stays where it is: friction may hold it off.
    rest : float
        Seconds in which the tip comes to rest after its travel.
    close : float
        Tolerance of the angles: 0.15 degrees, three standard deviations of a joint's sensor.
    still : float
        Seconds for which the head stays within that tolerance.
    turning : float
        Seconds after which the head stays where it is; a wire cools slowly.
    """

    gain: float = 2.0
    fastest: tuple[float, float] = (8e-3, math.radians(40.0))
    near: tuple[float, float] = (0.05e-3, math.radians(0.3))
    patience: float = 16.0
    rest: float = 0.4
    close: float = math.radians(0.15)
    still: float = 0.44
    turning: float = 12.0

    def begin(
        self, *, place: npt.ArrayLike | None = None, angles: npt.ArrayLike | None = None
    ) -> GoState:
        """Return the state of a move to an advance and a roll, to a pan and a tilt, or both."""
        return GoState(
            place=None if place is None else np.asarray(place, dtype=np.float64),
            angles=None if angles is None else np.asarray(angles, dtype=np.float64),
            stage="turn" if place is None else "travel",
        )

    def _next(self, state: GoState, reading: Reading) -> tuple[GoState, Request]:
        began = reading.t if state.since is None else state.since
        state = replace(state, since=began)
        if state.stage == "travel" and state.place is not None:
            return self._travel(state, state.place, began, reading)
        if state.stage == "turn":
            return self._turn(state, began, reading)
        if passed(began, reading.t, self.rest):
            state = replace(state, stage="turn", since=reading.t, done=state.angles is None)
        return state, Request(angles=state.angles)

    def _travel(
        self, state: GoState, place: FloatArray, began: float, reading: Reading
    ) -> tuple[GoState, Request]:
        off = place - reading.place
        there = bool((np.abs(off) < self.near).all())
        if there or passed(began, reading.t, self.patience):
            state = replace(state, stage="rest", since=reading.t, reached=there)
            return state, Request(angles=state.angles)
        limits = np.array(self.fastest)
        rates = np.nan_to_num(np.clip(self.gain * off, -limits, limits))
        return state, Request(angles=state.angles, rates=rates)

    def _turn(self, state: GoState, began: float, reading: Reading) -> tuple[GoState, Request]:
        if state.angles is None:
            return replace(state, done=True), NOTHING
        near = bool((np.abs(reading.angles - state.angles) < self.close).all())
        near_since = held_since(state.near_since, reading.t, near)
        still = near_since is not None and passed(near_since, reading.t, self.still)
        late = passed(began, reading.t, self.turning)
        reached = state.reached and (near or not late)
        state = replace(state, near_since=near_since, reached=reached, done=still or late)
        return state, Request(angles=state.angles)


GO = Go()
