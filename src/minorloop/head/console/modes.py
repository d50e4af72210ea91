"""Who moves the head: the operator, what the camera tracks, a scan, or nobody.

HEAD follows the operator's head, TRACK keeps a point of the image where it belongs and does not
know the operator's head, SCAN brings the probe over a finding, point by point, HOLD stands still
and stops the catheter. A change of mode never moves anything: each mode begins at the command
that is on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

from minorloop.head.console.head_pose import (
    HeadPoseMap,
    HeadPoseState,
    Pair,
    Quaternion,
    anchored,
    gaze,
    into_cone,
    slewed,
)
from minorloop.head.console.joystick import Rates, StickMap, push
from minorloop.head.procedures.scan import RasterScan

Mode: TypeAlias = Literal["HEAD", "TRACK", "SCAN", "HOLD"]
MODES: tuple[Mode, ...] = ("HEAD", "TRACK", "SCAN", "HOLD")


@dataclass(frozen=True, kw_only=True)
class TeleopConfig:
    """How the seat is set.

    Parameters
    ----------
    gaze : HeadPoseMap
    stick : StickMap
    blind : float
        For how long in seconds a target may be out of sight before TRACK gives up.
    reach : float
        Half-angle of the cone in which a scan may turn the head, in degrees.
    pictures : float
        For how long in seconds no picture may come.
    """

    gaze: HeadPoseMap = field(default_factory=HeadPoseMap)
    stick: StickMap = field(default_factory=StickMap)
    blind: float = 0.6
    reach: float = round(math.degrees(RasterScan.reach), 9)
    pictures: float = 0.12


@dataclass(frozen=True, kw_only=True)
class TickInput:
    """What came from the operator and the camera since the last tick.

    Parameters
    ----------
    request : str, optional
        Mode that was asked for; None where none was.
    pose : quaternion, optional
        Newest pose of the operator's head.
    pose_age, link_age : float
        How old the pose is, and when the operator's page was last heard of, in seconds;
        infinite where never.
    stick : (float, float)
        Forward and right, -1 to 1.
    clutch : bool
        Whether the clutch is pressed.
    pictures : bool
        Whether the camera gives pictures.
    servo : (float, float), optional
        Rates of pan and tilt that bring the target where it belongs, in degrees per second;
        None where the target is not seen.
    scan : ((float, float), (float, float)), optional
        Pan and tilt in degrees and rates of the catheter in mm/s and degrees/s that a scan asks
        for; None where none is on.
    """

    request: Mode | None = None
    pose: Quaternion | None = None
    pose_age: float = math.inf
    link_age: float = math.inf
    stick: Pair = (0.0, 0.0)
    clutch: bool = False
    pictures: bool = True
    servo: Pair | None = None
    scan: tuple[Pair, Rates] | None = None


@dataclass(frozen=True)
class TeleopState:
    """Mode, and what is commanded.

    Parameters
    ----------
    mode : str
    reason : str
        Why the mode is on, where it was not asked for; empty otherwise.
    gaze : HeadPoseState
        Its ``command`` is that of the head, in degrees about the middle of the cone.
    rates : (float, float)
        Of the catheter, in mm/s and degrees/s.
    unseen : float
        For how long the target has been out of sight, in seconds.
    """

    mode: Mode = "HOLD"
    reason: str = "nobody has taken the controls yet"
    gaze: HeadPoseState = field(default_factory=HeadPoseState)
    rates: Rates = (0.0, 0.0)
    unseen: float = 0.0

    @property
    def command(self) -> Pair:
        """Pan and tilt in degrees about the middle of the cone."""
        return self.gaze.command


def advance(
    seat: TeleopConfig, state: TeleopState, heard: TickInput, interval: float
) -> TeleopState:
    """State after one tick."""
    state = _entered(seat, state, heard)
    if state.mode == "HOLD":
        return replace(state, rates=(0.0, 0.0))
    if state.mode == "SCAN":
        return _scanned(seat, state, heard.scan, interval)
    rates = push(seat.stick, state.rates, heard.stick, interval)
    if state.mode == "HEAD":
        after = gaze(seat.gaze, state.gaze, heard.pose, interval, clutch=heard.clutch)
        return replace(state, gaze=after, rates=rates)
    unseen = 0.0 if heard.servo is not None else state.unseen + interval
    moved = _servoed(seat, state.command, heard.servo, interval)
    return replace(state, gaze=anchored(state.gaze, moved), rates=rates, unseen=unseen)


def held(state: TeleopState, reason: str) -> TeleopState:
    """The same state, holding."""
    return TeleopState("HOLD", reason, anchored(state.gaze))


def _entered(seat: TeleopConfig, state: TeleopState, heard: TickInput) -> TeleopState:
    """The mode that is on in this tick."""
    wanted = heard.request or state.mode
    refusal = _refusal(seat, state, heard, wanted)
    if refusal:
        return held(state, refusal) if state.mode != "HOLD" or heard.request else state
    if wanted == state.mode and not (heard.request and state.reason):
        return state
    return TeleopState(wanted, "", anchored(state.gaze), state.rates)


def _refusal(seat: TeleopConfig, state: TeleopState, heard: TickInput, wanted: Mode) -> str:
    """Why a mode cannot be on; empty where it can."""
    if wanted == "HOLD":
        return ""
    # Not above the timeout, so that a page that is never heard of is never above it either.
    if not heard.link_age <= seat.stick.timeout:
        return (
            f"the operator's page was not heard of for {seat.stick.timeout:g} s; press a mode to "
            "go on, or start with a longer --timeout"
        )
    if not heard.pictures:
        return "no picture comes from the camera; press a mode when pictures come again"
    if wanted == "HEAD" and (heard.pose is None or not heard.pose_age <= seat.gaze.timeout):
        return "the pose of the operator's head was lost; press HEAD to go on"
    entering = heard.request is not None and state.mode != "TRACK"
    if wanted == "TRACK" and entering and heard.servo is None:
        return "there is no target in sight; pick one, then press TRACK"
    if wanted == "SCAN" and heard.scan is None:
        return "there is nothing to scan; measure a finding first"
    if wanted == "TRACK" and state.mode == "TRACK" and state.unseen > seat.blind:
        return "the target was lost from sight; press TRACK when it is back, or pick it again"
    return ""


def _servoed(seat: TeleopConfig, command: Pair, servo: Pair | None, interval: float) -> Pair:
    if servo is None or not math.isfinite(servo[0] + servo[1]):
        return command
    wanted = command[0] + interval * servo[0], command[1] + interval * servo[1]
    return slewed(seat.gaze, command, into_cone(wanted, seat.gaze.cone), interval)


def _scanned(
    seat: TeleopConfig, state: TeleopState, asked: tuple[Pair, Rates] | None, interval: float
) -> TeleopState:
    assert asked is not None
    how = replace(seat.gaze, cone=seat.reach)
    moved = slewed(how, state.command, into_cone(asked[0], seat.reach), interval)
    return replace(state, gaze=anchored(state.gaze, moved), rates=asked[1])
