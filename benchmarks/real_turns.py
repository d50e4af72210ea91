"""Recorded turns of people's heads, replayed into the console by UDP and as a page sends them.

``python -m benchmarks.real_turns`` prints where the head held, whether it left its limits, how well
it follows, and how far it is behind, by stage. The clock is stepped: five minutes take one or two.
"""

from __future__ import annotations

import math
import socket
import struct
import sys
import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks._timing import Row
from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraReport
from minorloop_head.console.head_pose import turn
from minorloop_head.console.identified_head import head_of
from minorloop_head.console.plant import open_plant, open_tip
from minorloop_head.console.session import Session
from minorloop_head.console.tracker import UdpTracker, listening_for

FOLDER = Path(__file__).parents[2] / "shared" / "data" / "real" / "headset"
ADDRESS = "twin:pipe"
PACKET = struct.Struct("<6d")
PICTURE = 2
"""Ticks by which pictures are behind here: they are scripted."""


@dataclass(frozen=True, eq=False)
class Turns:
    """Recorded poses."""

    t: np.ndarray
    poses: np.ndarray
    """(N, 4) quaternions x, y, z, w with x to the right, y up and z backward."""

    @property
    def fastest(self) -> float:
        """Fastest turn from one row to the next, in degrees a second."""
        turned = (
            Rotation.from_quat(self.poses[:-1]).inv() * Rotation.from_quat(self.poses[1:])
        ).magnitude()
        return float(np.degrees(turned / np.diff(self.t)).max())

    def faster(self, times: float) -> Turns:
        return Turns(self.t / times, self.poses)


def read_turns(path: Path) -> Turns:
    """Read time, viewpoint, w, x, y, z with x ahead, y to the left and z up."""
    rows = np.loadtxt(path, skiprows=1)
    w, ahead, left, up = rows[:, 2:].T
    return Turns(rows[:, 0], np.stack([-left, up, -ahead, w], axis=1))


class ScriptedCamera:
    """Pictures that are always in time."""

    def __init__(self) -> None:
        self.problem, self.number = "", 0

    def send(self, request) -> None:
        self.number = request.number

    def reports(self) -> list[CameraReport]:
        return [CameraReport(number=max(self.number - PICTURE, 0))]


@dataclass(eq=False)
class Replay:
    """What came of a replay."""

    holds: list[tuple[float, float, str]] = field(default_factory=list)
    """Time, longest silence of the tracker before in seconds, and reason."""
    beyond: int = 0
    """Ticks with a command outside the cone, or faster than the wires."""
    off: list[float] = field(default_factory=list)
    """Command less what the pose asks for, while it is within reach, in degrees."""
    stages: dict[str, float] = field(default_factory=dict)
    ticks: int = 0


def replay(turns: Turns, *, udp: bool, seconds: float = math.inf) -> Replay:
    """Step a console through recorded turns; after each hold a key goes on."""
    plant = open_plant(ADDRESS)
    session = Session(plant, open_tip(ADDRESS)[1], head_of(ADDRESS, None), ScriptedCamera())
    found, config = Replay(), session.config.gaze
    with (
        closing(listening_for("udp:0")) as receiving,
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sending,
    ):
        sending.connect(receiving.getsockname())
        if udp:
            session.tracker = UdpTracker(receiving)
        angles = Rotation.from_quat(turns.poses).as_euler("YXZ", degrees=True) * (-1, 1, 1)
        silent, n, now, seq = 0.0, 0, 0.0, 0
        end = min(float(turns.t[-1]), seconds)
        while now < end:
            began = n
            while n < len(turns.t) and turns.t[n] <= now:
                if udp:
                    sending.send(PACKET.pack(0, 0, 0, *angles[n]))
                n += 1
            silent = now - turns.t[n - 1] if n == began else 0.0
            gap = max(turns.t[n - 1] - turns.t[n - 2] if n > 1 else 0.0, silent)
            pose = tuple(turns.poses[n - 1].tolist())
            age = now - float(turns.t[n - 1])
            seq += 1
            drive = messages.Drive(
                seq=seq, t=now, grant=1, pose=pose, age=age, stick=(0.0, 0.0), clutch=False
            )
            session.receive(drive, now)
            mode, before = session.state.mode, session.state.command
            if mode == "HOLD" and (n > began or not udp):
                session.receive(messages.SetMode(seq=seq, t=now, grant=1, mode="HEAD"), now)
            session.tick(now)
            found.ticks += 1
            state = session.state
            if mode == "HEAD" and state.mode == "HOLD":
                found.holds.append((now, gap, state.reason))
            change = np.abs(np.subtract(state.command, before)).max()
            found.beyond += math.hypot(*state.command) > config.cone * (1 + 1e-9)
            found.beyond += change > 2 * config.heating * session.interval + 1e-9
            if state.mode == "HEAD" and state.gaze.reference is not None:
                _follow(found, config, state, pose)
            if len(session.latency._ticks) == session.latency._ticks.maxlen:
                found.stages = session.latency.stages()
            now += session.interval
    return found


def _follow(found, config, state, pose):
    """Note by how much the command is off what a pose within reach asks for."""
    yaw, pitch = turn(state.gaze.reference, pose)
    wanted = np.add(state.gaze.base, np.multiply(config.scale, (yaw, pitch)))
    if np.hypot(*wanted) < config.cone:
        found.off.append(float(np.degrees(np.hypot(*np.subtract(state.command, wanted)))))


def loopback(count: int = 200) -> float:
    """Return the median time of a packet through the network of this machine, in seconds."""
    with (
        closing(listening_for("udp:0")) as receiving,
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sending,
    ):
        sending.connect(receiving.getsockname())
        receiving.settimeout(1.0)
        taken = []
        for _ in range(count):
            began = time.perf_counter()
            sending.send(PACKET.pack(*[0.0] * 6))
            receiving.recv(PACKET.size)
            taken.append(time.perf_counter() - began)
    return float(np.median(taken))


def rows(quick: bool = False) -> list[Row]:
    """Return the rows of the report; none without the recordings."""
    found = []
    for path in sorted(FOLDER.glob("*.txt")):
        turns = read_turns(path)
        for udp in (True, False):
            name = f"{path.stem.split('_')[0]} by {'UDP' if udp else 'page'}"
            began = time.perf_counter()
            seen = replay(turns, udp=udp, seconds=20.0 if quick else 300.0)
            taken = time.perf_counter() - began
            limit = 0.1
            wrong = [each for each in seen.holds if each[1] <= limit]
            gaps = ", ".join(f"{gap:.2f} s" for _, gap, _ in seen.holds)
            stages = {**seen.stages, "network": loopback()}
            lag = ", ".join(f"{name} {1e3 * stages[name]:.2f}" for name in stages)
            found += [
                Row(
                    f"{name}: {seen.ticks * 0.04:.0f} s, up to {turns.fastest:.0f} deg/s",
                    taken,
                    required="no hold but at gaps above 0.1 s; 0 beyond limits",
                    met=not wrong and seen.beyond == 0,
                    accuracy=f"{len(seen.holds)} holds at gaps of {gaps or '-'}; {len(wrong)} "
                    f"others; {seen.beyond} beyond limits; within reach {np.median(seen.off):.1f} "
                    f"(90 %: {np.quantile(seen.off, 0.9):.1f}) degrees behind",
                ),
                Row(f"{name}: lag in ms", 0.0, required="said", met=True, accuracy=lag),
            ]
            for _, gap, reason in wrong:
                print(f"{name}: held after {gap:.3f} s: {reason}", file=sys.stderr)
    return found


def main() -> None:
    """Print the figures, or that there are no recordings."""
    measured = rows(quick="--quick" in sys.argv)
    if not measured:
        print(f"SKIPPED: no recordings in {FOLDER}")
    for row in measured:
        print(
            f"{'ok  ' if row.met else 'MISS'} {row.what}: {row.accuracy} (required: {row.required})"
        )


if __name__ == "__main__":
    main()
