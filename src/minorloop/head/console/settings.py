"""What the processes of the console are told when they start."""

from __future__ import annotations

from dataclasses import dataclass

from minorloop.head.console.head_pose import HeadPoseMap
from minorloop.head.console.joystick import StickMap
from minorloop.head.console.modes import TeleopConfig

_SAFE_AFTER = 0.16
"""Four ticks of 40 ms: a loop that stops after a command has 40 ms to spare of 200 ms."""
_BLIND_AFTER = 0.12
"""Three pictures of 40 ms: a camera that stops after a picture is noticed within 160 ms; a picture
is ready after 30 ms, and has 90 ms to spare on a machine that is busy."""
_MOST_PATIENT = 1.0


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """What the loop steers, and where it records.

    Parameters
    ----------
    address : str
    specimen : int, optional
    seed : int
    folder : str
        Of recordings.
    timeout : float
        Age in seconds of the operator's pose and page beyond which the head holds.
    """

    address: str = "twin:pipe"
    specimen: int | None = None
    seed: int = 0
    folder: str = "console"
    timeout: float = 0.1

    @property
    def patience(self) -> float:
        """Seconds without a command after which the plant is made safe."""
        return max(_SAFE_AFTER, min(self.timeout, _MOST_PATIENT))

    def seat(self) -> TeleopConfig:
        """The seat with that patience."""
        return TeleopConfig(
            gaze=HeadPoseMap(timeout=self.timeout),
            stick=StickMap(timeout=self.timeout),
            pictures=max(_BLIND_AFTER, min(self.timeout, _MOST_PATIENT)),
        )
