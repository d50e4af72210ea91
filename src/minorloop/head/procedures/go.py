"""Bring the catheter to a place, and then the head to a line of sight."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.procedures.values import NOTHING, Reading, Request, passed

GoStage: TypeAlias = Literal["travel", "rest", "turn"]


@dataclass(frozen=True, eq=False, kw_only=True)
class GoState:
    """Where to go: a place (2,), advance and roll, and angles (2,), pan and tilt; None stays.

    ``since`` is when the stage began, ``near_since`` from when on the head has been at its angles
    without a break; ``reached`` is False where something took too long.
    """

    place: FloatArray | None
    angles: FloatArray | None
    stage: GoStage
    since: float | None = None
    near_since: float | None = None
    reached: bool = True
    done: bool = False


@dataclass(frozen=True, kw_only=True)
class Go:
    """Travel of the catheter, a rest, and a turn of the head.

    Parameters
    ----------
    gain : float
        Rate of the catheter over what it is off, in 1/s. More overshoots, since the tip follows
        its motor late.
    fastest : (float, float)
        Rates of advance in m/s and of roll in rad/s that are never exceeded.
    near : (float, float)
        How near the place the catheter is sent: 0.05 mm and 0.3 degrees, as its sensors resolve.
    patience : float
        After how many seconds the catheter is left where it is: friction may hold it off.
    rest : float
        Seconds that the tip is given to come to rest after its travel.
    close : float
        How near its angles the head is to come: 0.15 degrees, three deviations of a joint's
        sensor.
    still : float
        For how many seconds the head is to be that near.
    turning : float
        After how many seconds the head is left where it is; a wire cools slowly.
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
        """State of a head that is to go to an advance and a roll, to a pan and a tilt, or both."""
        return GoState(
            place=None if place is None else np.asarray(place, dtype=np.float64),
            angles=None if angles is None else np.asarray(angles, dtype=np.float64),
            stage="turn" if place is None else "travel",
        )

    def step(self, state: GoState, reading: Reading) -> tuple[GoState, Request]:
        """The next state, and the angles and rates that are asked for."""
        if state.done:
            return state, NOTHING
        since = reading.t if state.since is None else state.since
        state = replace(state, since=since)
        if state.stage == "travel" and state.place is not None:
            return self._travel(state, state.place, reading)
        if state.stage == "rest":
            if passed(since, reading.t, self.rest):
                state = replace(state, stage="turn", since=reading.t, done=state.angles is None)
            return state, Request(angles=state.angles)
        return self._turn(state, reading)

    def _travel(
        self, state: GoState, place: FloatArray, reading: Reading
    ) -> tuple[GoState, Request]:
        off = place - reading.place
        there = bool((np.abs(off) < self.near).all())
        if there or passed(state.since or 0.0, reading.t, self.patience):
            state = replace(state, stage="rest", since=reading.t, reached=there)
            return state, Request(angles=state.angles)
        limits = np.array(self.fastest)
        rates = np.nan_to_num(np.clip(self.gain * off, -limits, limits))
        return state, Request(angles=state.angles, rates=rates)

    def _turn(self, state: GoState, reading: Reading) -> tuple[GoState, Request]:
        if state.angles is None:
            return replace(state, done=True), NOTHING
        near = bool((np.abs(reading.angles - state.angles) < self.close).all())
        since = (reading.t if state.near_since is None else state.near_since) if near else None
        still = since is not None and passed(since, reading.t, self.still)
        late = passed(state.since or 0.0, reading.t, self.turning)
        reached = state.reached and (near or not late)
        state = replace(state, near_since=since, reached=reached, done=still or late)
        return state, Request(angles=state.angles)


GO = Go()
