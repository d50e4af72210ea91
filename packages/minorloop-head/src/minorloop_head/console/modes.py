"""Modes of the console: the source of the motion of the head.

In HEAD the head follows the operator's head. In TRACK the camera keeps a point of the image in the
middle, independently of the operator's head. In SCAN the probe visits the points of a scan. In HOLD
head and catheter stand still. A change of mode moves nothing: each mode starts at the present
command. A stick moves the catheter: forward pushes it into the pipe, right rolls it to the right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TypeAlias, get_args

from minorloop_head.console.head_pose import (
    HeadPoseMap,
    HeadPoseState,
    Quaternion,
    anchored,
    gaze,
    into_cone,
    slewed,
)
from minorloop_head.console.messages import Mode, Pair

Rates: TypeAlias = tuple[float, float]
MODES: tuple[Mode, ...] = get_args(Mode)


@dataclass(frozen=True, kw_only=True)
class StickMap:
    """Parameters of the map from a stick to rates.

    Notes
    -----
    The rates are such that the motors, with 40 mm/s^2 and 180 degrees/s^2, stop in 0.15 s.
    """

    advance: float = 6e-3
    roll: float = math.radians(27.0)
    """Rates at full deflection, in m/s and rad/s."""
    dead_band: float = 0.05
    """Share of the deflection without effect, from 0 to below 1."""
    expo: float = 0.6
    """Shape of the response, from 0, linear, to 1, cubic."""
    advance_acceleration: float = 12e-3
    roll_acceleration: float = math.radians(60.0)
    """Fastest changes of the rates, in m/s^2 and rad/s^2."""
    timeout: float = 0.1
    """Age of a deflection in seconds beyond which the catheter stops."""

    def shaped(self, deflection: float) -> float:
        """Return the share of the full rate, -1 to 1, for a deflection from -1 to 1; 0 for NaN."""
        if not math.isfinite(deflection):
            return 0.0
        beyond = (min(abs(deflection), 1.0) - self.dead_band) / (1.0 - self.dead_band)
        if beyond <= 0:
            return 0.0
        return math.copysign((1 - self.expo) * beyond + self.expo * beyond**3, deflection)


@dataclass(frozen=True, kw_only=True)
class TeleopConfig:
    """Settings of the teleoperation."""

    gaze: HeadPoseMap = field(default_factory=HeadPoseMap)
    stick: StickMap = field(default_factory=StickMap)
    blind: float = 0.6
    """Longest seconds without sight of the target in TRACK."""
    pictures: float = 0.12
    """Longest seconds without a picture."""


@dataclass(frozen=True, kw_only=True)
class TickInput:
    """Input of a tick from operator and camera."""

    request: Mode | None = None
    """Requested mode; None without a request."""
    pose: Quaternion | None = None
    """Quaternion. Newest pose of the operator's head."""
    pose_age: float = math.inf
    link_age: float = math.inf
    """Age of the pose and of the last message of the operator's page, in seconds; infinite if there
    was none."""
    stick: Pair = (0.0, 0.0)
    """Forward and right, -1 to 1."""
    lost: str = "the pose of the operator's head was lost"
    """Message if there is no pose, or an old one."""
    clutch: bool = False
    """Whether the clutch is pressed."""
    blind: str = ""
    """Message if the camera gives no pictures, or no angles; empty otherwise."""
    servo: Pair | None = None
    """Rates of pan and tilt that centre the target, in rad/s; None while the target is not
    visible."""
    scan: tuple[Pair, Rates] | None = None
    """Pan and tilt in radians and rates of the catheter in m/s and rad/s that a scan requests; None
    without a scan."""


@dataclass(frozen=True)
class TeleopState:
    """Mode and commands."""

    mode: Mode = "HOLD"
    reason: str = "no mode has been chosen yet; take the controls and press one"
    """Reason of a mode that was not requested; empty otherwise."""
    gaze: HeadPoseState = field(default_factory=HeadPoseState)
    """Its ``command`` is that of the head, in radians about the middle of the cone."""
    rates: Rates = (0.0, 0.0)
    """Rates of the catheter, in m/s and rad/s."""
    unseen: float = 0.0
    """Seconds that the target has been out of sight."""

    @property
    def command(self) -> Pair:
        """Pan and tilt in radians about the middle of the cone."""
        return self.gaze.command


def advance(
    config: TeleopConfig, state: TeleopState, inputs: TickInput, interval: float
) -> TeleopState:
    """Return the state after one tick."""
    state = _enter(config, state, inputs)
    if state.mode == "HOLD":
        return replace(state, rates=(0.0, 0.0))
    if state.mode == "SCAN":
        return _scan(config, state, inputs.scan, interval)
    rates = push(config.stick, state.rates, inputs.stick, interval)
    if state.mode == "HEAD":
        after = gaze(config.gaze, state.gaze, inputs.pose, interval, clutch=inputs.clutch)
        return replace(state, gaze=after, rates=rates)
    unseen = 0.0 if inputs.servo is not None else state.unseen + interval
    moved = _servo(config, state.command, inputs.servo, interval)
    return replace(state, gaze=anchored(state.gaze, moved), rates=rates, unseen=unseen)


def held(state: TeleopState, reason: str) -> TeleopState:
    """Return the state in HOLD with the same command."""
    return TeleopState("HOLD", reason, anchored(state.gaze))


def _enter(config: TeleopConfig, state: TeleopState, inputs: TickInput) -> TeleopState:
    """Return the state in the mode of this tick."""
    wanted = inputs.request or state.mode
    refusal = _refusal(config, state, inputs, wanted)
    if refusal:
        return held(state, refusal) if state.mode != "HOLD" or inputs.request else state
    if wanted == state.mode and not (inputs.request and state.reason):
        return state
    return TeleopState(wanted, "", anchored(state.gaze), state.rates)


def _refusal(config: TeleopConfig, state: TeleopState, inputs: TickInput, wanted: Mode) -> str:
    """Return the reason why a mode is impossible; empty if it is possible."""
    if wanted == "HOLD":
        return ""
    # Written so that an infinite timeout does not accept a page that never sent a message.
    if not inputs.link_age <= config.stick.timeout:
        return (
            f"no message came from the operator's page for {config.stick.timeout:g} s; press a "
            "mode to continue, or start the console with a longer --timeout"
        )
    if inputs.blind:
        return inputs.blind
    if wanted == "HEAD" and (inputs.pose is None or not inputs.pose_age <= config.gaze.timeout):
        return f"{inputs.lost}; press HEAD to continue"
    entering = inputs.request is not None and state.mode != "TRACK"
    if wanted == "TRACK" and entering and inputs.servo is None:
        return "there is no target in sight; pick one, wait until it is marked, then press TRACK"
    if wanted == "SCAN" and inputs.scan is None:
        return "there is nothing to scan; measure a finding first"
    if wanted == "TRACK" and state.mode == "TRACK" and state.unseen > config.blind:
        return "the target was lost from sight; press TRACK when it is back, or pick it again"
    return ""


def _servo(config: TeleopConfig, command: Pair, servo: Pair | None, interval: float) -> Pair:
    if servo is None or not math.isfinite(servo[0] + servo[1]):
        return command
    wanted = command[0] + interval * servo[0], command[1] + interval * servo[1]
    return slewed(config.gaze, command, into_cone(wanted, config.gaze.cone), interval)


def _scan(
    config: TeleopConfig, state: TeleopState, requested: tuple[Pair, Rates] | None, interval: float
) -> TeleopState:
    assert requested is not None
    wanted = into_cone(requested[0], config.gaze.cone)
    moved = slewed(config.gaze, state.command, wanted, interval)
    return replace(state, gaze=anchored(state.gaze, moved), rates=requested[1])


def push(
    config: StickMap, before: Rates, deflection: tuple[float, float] | None, interval: float
) -> Rates:
    """Return rates of advance and roll after an interval, in m/s and rad/s.

    ``before``: present rates. ``deflection``: forward and right, each from -1 to 1; None stops as
    fast as the motors can. ``interval``: in seconds.
    """
    if deflection is None:
        return 0.0, 0.0
    advance = _towards(
        before[0],
        config.advance * config.shaped(deflection[0]),
        config.advance_acceleration * interval,
    )
    roll = _towards(
        before[1], config.roll * config.shaped(deflection[1]), config.roll_acceleration * interval
    )
    return advance, roll


def _towards(before: float, wanted: float, most: float) -> float:
    return before + min(max(wanted - before, -most), most)
