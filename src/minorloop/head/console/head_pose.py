"""From the pose of the operator's head to pan and tilt of the catheter's head.

Poses are unit quaternions (x, y, z, w) that turn the operator's head into the room, with x to
the right, y up and z backward, as headsets and phones give them. Commands are pan and tilt in
degrees about the middle of the cone of visibility; positive pan looks right, positive tilt up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

from minorloop.arrays import as_finite
from minorloop.errors import ParameterError

Quaternion: TypeAlias = tuple[float, float, float, float]
Pair: TypeAlias = tuple[float, float]

_STEEPEST = 0.1  # cosine of the pitch below which a yaw means nothing
_LEAST_NORM = 0.5
_MOST_NORM = 1.5


@dataclass(frozen=True, kw_only=True)
class HeadPoseMap:
    """How a pose becomes a command.

    Parameters
    ----------
    cone : float
        Half-angle of the cone of visibility, in degrees, above 0 and up to 45.
    reach : float
        Turn of the operator's head that goes to the edge of the cone, in degrees.
    dead_band : float
        Turns up to this many degrees do nothing; larger ones count from there.
    calm, agility : float
        Cut-off of the filter at rest, in Hz, and what a degree per second adds to it.
    heating, cooling : float
        Fastest rise and fall of a command, in degrees per second: what the wires can follow.
    timeout : float
        Age of a pose in seconds beyond which it counts as lost.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    cone: float = 28.0
    reach: float = 45.0
    dead_band: float = 1.0
    calm: float = 1.5
    agility: float = 0.08
    heating: float = 12.0
    cooling: float = 8.0
    timeout: float = 0.1

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if as_finite(name, value) < 0:
                raise ParameterError(f"{name} is {value}; give a number of at least 0")
        for name in ("cone", "reach", "calm", "heating", "cooling", "timeout"):
            if getattr(self, name) == 0:
                raise ParameterError(f"{name} is 0; give a positive number")
        if self.cone > 45:
            raise ParameterError(f"cone is {self.cone} degrees; give at most 45")

    @property
    def scale(self) -> float:
        """Degrees of command for a degree of the operator's head."""
        return self.cone / self.reach


@dataclass(frozen=True)
class HeadPoseState:
    """What the map remembers.

    Parameters
    ----------
    command : (float, float)
        Pan and tilt now, in degrees.
    base : (float, float)
        Command at the reference pose.
    reference : quaternion, optional
        Pose that means ``base``; None until a pose comes.
    turned : (float, float)
        Newest yaw and pitch from the reference, in degrees, without jumps of 360.
    smooth, speed : (float, float)
        Filtered turn in degrees and its filtered rate in degrees per second.
    """

    command: Pair = (0.0, 0.0)
    base: Pair = (0.0, 0.0)
    reference: Quaternion | None = None
    turned: Pair = (0.0, 0.0)
    smooth: Pair = (0.0, 0.0)
    speed: Pair = (0.0, 0.0)


def anchored(state: HeadPoseState, command: Pair | None = None) -> HeadPoseState:
    """The next pose, whatever it is, means the command that is on: no jump.

    Parameters
    ----------
    state : HeadPoseState
    command : (float, float), optional
        The command that is on where it came from elsewhere, in degrees.
    """
    now = state.command if command is None else command
    return HeadPoseState(command=now, base=now)


def gaze(
    how: HeadPoseMap,
    state: HeadPoseState,
    pose: Quaternion | None,
    interval: float,
    *,
    clutch: bool = False,
) -> HeadPoseState:
    """State after an interval with a pose.

    Parameters
    ----------
    how : HeadPoseMap
    state : HeadPoseState
    pose : quaternion, optional
        Newest pose; None where there is none, and the command stands still.
    interval : float
        Since the last step, in seconds.
    clutch : bool
        Whether the operator has taken the head off: the command stands still, and the pose at
        release is the new reference.
    """
    if clutch:
        return anchored(state)
    if pose is None or not is_pose(pose):
        return state
    if state.reference is None:
        return replace(anchored(state), reference=pose)
    turned = _turned(state, pose)
    smooth, speed = _filtered(how, state, turned, interval)
    x, y = _beyond(smooth, how.dead_band)
    wanted = into_cone((state.base[0] + how.scale * x, state.base[1] + how.scale * y), how.cone)
    command = slewed(how, state.command, wanted, interval)
    return replace(state, turned=turned, smooth=smooth, speed=speed, command=command)


def is_pose(pose: Quaternion) -> bool:
    """Whether four numbers are near enough to a unit quaternion to be a pose."""
    return _LEAST_NORM <= math.hypot(*pose) <= _MOST_NORM


def turn(reference: Quaternion, pose: Quaternion) -> Pair:
    """Yaw to the right and pitch upward of a pose from a reference, in degrees.

    Where the head looks straight up or down from the reference, the yaw is NaN.
    """
    x, y, z, w = _times(_inverse(_unit(reference)), _unit(pose))
    # The direction of sight: what -z becomes.
    ahead = (-2 * (x * z + w * y), -2 * (y * z - w * x), -(1 - 2 * (x * x + y * y)))
    level = math.hypot(ahead[0], ahead[2])
    yaw = math.degrees(math.atan2(ahead[0], -ahead[2])) if level > _STEEPEST else math.nan
    return yaw, math.degrees(math.atan2(ahead[1], level))


def into_cone(angles: Pair, cone: float) -> Pair:
    """Angles in degrees, brought back along the radius where they lie outside the cone."""
    away = math.hypot(*angles)
    if away <= cone:
        return angles
    return angles[0] * cone / away, angles[1] * cone / away


def slewed(how: HeadPoseMap, before: Pair, wanted: Pair, interval: float) -> Pair:
    """The command nearest to a wish that the wires can follow."""
    up, down = how.heating * interval, how.cooling * interval
    pan, tilt = (
        old + min(max(new - old, -down), up) for old, new in zip(before, wanted, strict=True)
    )
    # Axes that slew at different rates could leave the cone on the way between two of its points;
    # a command that a scan left outside comes back at the rate of the wires, and not at once.
    return into_cone((pan, tilt), max(how.cone, math.hypot(*before)))


def _turned(state: HeadPoseState, pose: Quaternion) -> Pair:
    assert state.reference is not None
    yaw, pitch = turn(state.reference, pose)
    last = state.turned[0]
    if math.isnan(yaw):
        return last, pitch
    return last + (yaw - last + 180.0) % 360.0 - 180.0, pitch


def _beyond(turned: Pair, dead_band: float) -> Pair:
    away = math.hypot(*turned)
    if away <= dead_band:
        return 0.0, 0.0
    share = 1.0 - dead_band / away
    return turned[0] * share, turned[1] * share


def _filtered(
    how: HeadPoseMap, state: HeadPoseState, turned: Pair, interval: float
) -> tuple[Pair, Pair]:
    """The 1 euro filter of Casiez, Roussel and Vogel, Proc. ACM CHI 2012, on both axes.

    One cut-off for both, from the size of the rate, so that a diagonal turn stays one.
    """
    keep = _share(1.0, interval)
    rates = ((new - old) / interval for new, old in zip(turned, state.turned, strict=True))
    vx, vy = (old + keep * (rate - old) for old, rate in zip(state.speed, rates, strict=True))
    share = _share(how.calm + how.agility * math.hypot(vx, vy), interval)
    x, y = (old + share * (new - old) for old, new in zip(state.smooth, turned, strict=True))
    return (x, y), (vx, vy)


def _share(cutoff: float, interval: float) -> float:
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * interval))


def _unit(q: Quaternion) -> Quaternion:
    size = math.hypot(*q)
    return q[0] / size, q[1] / size, q[2] / size, q[3] / size


def _inverse(q: Quaternion) -> Quaternion:
    return -q[0], -q[1], -q[2], q[3]


def _times(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
