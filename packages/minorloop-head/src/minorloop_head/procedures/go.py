"""Bring the catheter to a place, and then the head to a line of sight."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop_head.procedures.values import NOW, Procedure, Request, held_since, passed

NEAR = (0.05e-3, math.radians(0.3))
"""Tolerance of advance in metres and of roll in radians: the resolution of their sensors."""
_GAIN = 2.0
"""Gain: rate of the catheter over its distance from the place, in 1/s. A higher gain overshoots,
since the tip follows its motor late."""
_FASTEST = np.array([8e-3, math.radians(40.0)])
"""Highest rates of advance in m/s and of roll in rad/s."""
_REST = 0.4
"""Seconds that the tip takes to come to rest after its travel."""
_CLOSE = math.radians(0.15)
"""Tolerance of the angles: three standard deviations of the sensor of a joint."""


def go(
    place: npt.ArrayLike | None = None,
    angles: npt.ArrayLike | None = None,
    *,
    patience: float = 16.0,
    still: float = 0.44,
    turning: float = 12.0,
) -> Procedure[bool]:
    """Travel with the catheter, let its tip rest, and turn the head; return whether both arrived.

    ``place`` (2,): advance and roll of the catheter; if None, it does not move. ``angles`` (2,):
    pan and tilt; if None, the head does not turn. It begins to turn while the catheter travels.
    ``patience``: longest seconds of the travel: friction may hold the catheter before its place.
    ``still``: seconds for which the head stays at its angles. ``turning``: longest seconds of the
    turn; a wire cools slowly.
    """
    wanted = None if angles is None else np.asarray(angles, dtype=np.float64)
    arrived, now = True, (yield NOW)
    began = now.t
    if place is not None:
        while True:
            off = np.asarray(place, dtype=np.float64) - now.place
            arrived = bool((np.abs(off) < NEAR).all())
            if arrived or passed(began, now.t, patience):
                break
            rates = np.nan_to_num(np.clip(_GAIN * off, -_FASTEST, _FASTEST))
            now = yield Request(angles=wanted, rates=rates)
        began = now.t
        now = yield Request(angles=wanted)
        while not passed(began, now.t, _REST):
            now = yield Request(angles=wanted)
        began = now.t
        if wanted is not None:
            now = yield Request(angles=wanted)
    if wanted is None:
        return arrived
    near_since = None
    while True:
        near = bool((np.abs(now.angles - wanted) < _CLOSE).all())
        near_since = held_since(near_since, now.t, near)
        late = passed(began, now.t, turning)
        if late or passed(near_since, now.t, still):
            return arrived and (near or not late)
        now = yield Request(angles=wanted)
