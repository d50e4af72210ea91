"""Map from the pose of the operator's head to pan and tilt of the catheter's head.

Poses are unit quaternions (x, y, z, w) that rotate the frame of the operator's head into the
world, with x to the right, y up and z backward, as headsets and phones give them. Commands are pan
and tilt in radians about the middle of the cone of visibility; positive pan looks right, positive
tilt up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

from minorloop_head.console.messages import Pair
from minorloop_head.geometry import REACH, wrapped

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Quaternion: TypeAlias = tuple[float, float, float, float]

_STEEPEST = 0.1
"""Cosine of the pitch below which the yaw is undefined in practice."""
_LEAST_NORM, _MOST_NORM = 0.5, 1.5
"""Least and largest length of a quaternion that is accepted as a pose."""
_ROUND = math.radians(270.0)
"""Turn from the reference beyond which the way round the other side is shorter."""
_FASTEST, _LEAST_JUMP = math.radians(1000.0), math.radians(30.0)
"""Fastest turn of a head in rad/s, and least turn in rad that counts as a jump: after a repeated
pose the next one of a tracker catches up, and times of poses are known to a tick."""


@dataclass(frozen=True, kw_only=True)
class HeadPoseMap:
    """Parameters of the map from poses to commands."""

    cone: float = REACH
    """Half-angle of the cone of visibility in radians."""
    reach: float = math.radians(45.0)
    """Turn of the operator's head that corresponds to the edge of the cone, in radians."""
    dead_band: float = math.radians(1.0)
    """Turns up to this many radians have no effect; it is subtracted from larger ones."""
    calm: float = 1.5
    agility: float = 0.08 / math.radians(1.0)
    """Cut-off of the filter at rest in Hz, and its increase for each radian per second."""
    heating: float = math.radians(12.0)
    cooling: float = math.radians(8.0)
    """Fastest rise and fall of a command that the wires can follow, in rad/s."""
    timeout: float = 0.1
    """Age of a pose in seconds beyond which it counts as lost."""

    @property
    def scale(self) -> float:
        """Turn of the command over that of the operator's head."""
        return self.cone / self.reach


@dataclass(frozen=True)
class HeadPoseState:
    """State of the map."""

    command: Pair = (0.0, 0.0)
    """Pan and tilt now, in radians."""
    base: Pair = (0.0, 0.0)
    """Command at the reference pose."""
    reference: Quaternion | None = None
    """Quaternion. Pose that corresponds to ``base``; None until a pose comes."""
    turned: Pair = (0.0, 0.0)
    """Newest yaw and pitch from the reference in radians, without jumps of a whole turn."""
    smooth: Pair = (0.0, 0.0)
    speed: Pair = (0.0, 0.0)
    """Filtered turn in radians and its filtered rate in rad/s."""


def anchored(state: HeadPoseState, command: Pair | None = None) -> HeadPoseState:
    """Return a state whose next pose, any pose, corresponds to the present command.

    ``command``: the present command in radians, if another source set it.
    """
    now = state.command if command is None else command
    return HeadPoseState(command=now, base=now)


def gaze(
    config: HeadPoseMap,
    state: HeadPoseState,
    pose: Quaternion | None,
    interval: float,
    *,
    clutch: bool = False,
) -> HeadPoseState:
    """Return the state after an interval with a pose.

    ``pose``: newest pose; without one the command stays. ``interval``: since the last step, in
    seconds. ``clutch``: whether the clutch is pressed: the command stays, and the pose at its
    release is the new reference.
    """
    if clutch:
        return anchored(state)
    if pose is None or not _is_pose(pose):
        return state
    if state.reference is None:
        return replace(anchored(state), reference=pose)
    turned = _turned(state, pose)
    if abs(turned[0]) > _ROUND:
        # The head has come round: its direction counts, not the way there.
        turned = float(wrapped(turned[0])), turned[1]
        state = replace(state, turned=turned, smooth=turned)
    smooth, speed = _filtered(config, state, turned, interval)
    command = slewed(config, state.command, aimed(config, state, smooth), interval)
    return replace(state, turned=turned, smooth=smooth, speed=speed, command=command)


def aimed(config: HeadPoseMap, state: HeadPoseState, turned: Pair) -> Pair:
    """Return the command for a turn of the head from the reference, all in radians."""
    x, y = _beyond(turned, config.dead_band)
    return into_cone(
        (state.base[0] + config.scale * x, state.base[1] + config.scale * y), config.cone
    )


def _angle_between(one: Quaternion, other: Quaternion) -> float:
    """Return the angle of the turn from one pose to another, in radians."""
    return float(_between(one, other).magnitude())


def jumped(before: Quaternion, after: Quaternion, passed: float) -> bool:
    """Return whether a turn between two poses in a time in seconds is too fast for a head."""
    return _angle_between(before, after) > max(_LEAST_JUMP, _FASTEST * passed)


def pose_of(yaw: float, pitch: float, roll: float) -> Quaternion:
    """Return the pose of a head turned right by a yaw, then up by a pitch, then by a roll.

    All are in radians; a positive roll leans the head to the left.
    """
    from scipy.spatial.transform import Rotation  # slow to import; the supervisor needs no poses

    x, y, z, w = Rotation.from_euler("YXZ", (-yaw, pitch, roll)).as_quat().tolist()
    return x, y, z, w


def _is_pose(pose: Quaternion) -> bool:
    """Return whether four numbers are close enough to a unit quaternion to be a pose."""
    return _LEAST_NORM <= math.hypot(*pose) <= _MOST_NORM


def turn(reference: Quaternion, pose: Quaternion) -> Pair:
    """Return yaw to the right and pitch upward of a pose from a reference, in radians.

    If the head looks straight up or down from the reference, the yaw is NaN.
    """
    right, up, back = _between(reference, pose).apply((0.0, 0.0, -1.0)).tolist()  # line of sight
    level = math.hypot(right, back)
    yaw = math.atan2(right, -back) if level > _STEEPEST else math.nan
    return yaw, math.atan2(up, level)


def _between(one: Quaternion, other: Quaternion) -> Rotation:
    """Return the turn from one pose to another, in the frame of the first."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(one).inv() * Rotation.from_quat(other)


def into_cone(angles: Pair, cone: float) -> Pair:
    """Return angles; those outside the cone are moved radially to its edge."""
    away = math.hypot(*angles)
    if away <= cone:
        return angles
    return angles[0] * cone / away, angles[1] * cone / away


def slewed(config: HeadPoseMap, before: Pair, wanted: Pair, interval: float) -> Pair:
    """Return the command nearest to the wanted one that the wires can follow."""
    up, down = config.heating * interval, config.cooling * interval
    pan, tilt = (
        old + min(max(new - old, -down), up) for old, new in zip(before, wanted, strict=True)
    )
    # Axes with different rates could leave the cone between two of its points. A command that a
    # scan left outside comes back at the rate of the wires, and not at once.
    return into_cone((pan, tilt), max(config.cone, math.hypot(*before)))


def _turned(state: HeadPoseState, pose: Quaternion) -> Pair:
    assert state.reference is not None
    yaw, pitch = turn(state.reference, pose)
    last = state.turned[0]
    if math.isnan(yaw):
        return last, pitch
    return last + float(wrapped(yaw - last)), pitch


def _beyond(turned: Pair, dead_band: float) -> Pair:
    away = math.hypot(*turned)
    if away <= dead_band:
        return 0.0, 0.0
    share = 1.0 - dead_band / away
    return turned[0] * share, turned[1] * share


def _filtered(
    config: HeadPoseMap, state: HeadPoseState, turned: Pair, interval: float
) -> tuple[Pair, Pair]:
    """Filter a turn with the 1 euro filter of Casiez, Roussel and Vogel, Proc. ACM CHI 2012.

    Both axes have one cut-off, by the magnitude of the rate, so that a turn keeps its direction.
    """
    keep = _share(1.0, interval)
    rates = ((new - old) / interval for new, old in zip(turned, state.turned, strict=True))
    vx, vy = (old + keep * (rate - old) for old, rate in zip(state.speed, rates, strict=True))
    share = _share(config.calm + config.agility * math.hypot(vx, vy), interval)
    x, y = (old + share * (new - old) for old, new in zip(state.smooth, turned, strict=True))
    return (x, y), (vx, vy)


def _share(cutoff: float, interval: float) -> float:
    return 1.0 / (1.0 + 1.0 / (2.0 * math.pi * cutoff * interval))
