"""Settings of the console's processes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from minorloop_head.console.head_pose import HeadPoseMap
from minorloop_head.console.modes import StickMap, TeleopConfig
from minorloop_head.procedures.values import NO_PROBE

PIPE = "twin:pipe"
"""Address of the simulated head in a simulated pipe, the only plant with its own tip."""
STATIC = Path(__file__).parent / "static"
"""Folder of the pages."""
_SAFE_AFTER = 0.16
"""Four ticks of 40 ms: this leaves 40 ms of the 200 ms in which the head must be safe."""
_BLIND_AFTER = 0.12
"""Three pictures of 40 ms: a camera that stops is noticed within 160 ms. A picture takes 30 ms,
which leaves 90 ms on a busy machine."""
_CAMERA_BLIND_AFTER = 0.16
"""Four pictures, for a real camera: it waits for a new picture where a simulated one draws it
at once, and for another one after its lights were switched."""
SAFE_WITHIN = 2.0
"""Longest time in seconds in which a plant may confirm that it is safe."""
_MOST_PATIENT = 1.0
"""Upper limit of both in seconds for any timeout."""


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Settings of the plant, its operator and its recordings."""

    address: str = PIPE
    specimen: int | None = None
    seed: int = 0
    folder: str = "console"
    """Folder of recordings."""
    timeout: float = 0.1
    """Age in seconds of the operator's pose and last message beyond which the head holds."""
    camera: str | None = None
    """Address of the camera, see `minorloop_head.vision.video`; that of the plant without it."""
    interval: float = 0.04
    """Tick of the plant in seconds."""
    sensors: bool = True
    """Whether the joints have sensors; without them the pictures give the angles."""

    @property
    def patience(self) -> float:
        """Seconds without a command after which the plant is made safe."""
        return max(_SAFE_AFTER, min(self.timeout, _MOST_PATIENT))

    @property
    def plant_patience(self) -> float:
        """Seconds without a heartbeat after which the process of the plant counts as hanging."""
        return 1.0 if is_pipe(self.address) else 2 * SAFE_WITHIN

    @property
    def no_probe(self) -> str:
        """Reason why no depth can be measured; empty for a plant with a probe."""
        return "" if is_pipe(self.address) else NO_PROBE

    def teleop_config(self) -> TeleopConfig:
        """Return the settings of the teleoperation."""
        blind = _BLIND_AFTER if self.camera is None else _CAMERA_BLIND_AFTER
        return TeleopConfig(
            gaze=HeadPoseMap(timeout=self.timeout),
            stick=StickMap(timeout=self.timeout),
            pictures=max(blind, min(self.timeout, _MOST_PATIENT)),
        )


def is_pipe(address: str) -> bool:
    """Return whether the plant at an address has its own camera and probe."""
    return address == PIPE
