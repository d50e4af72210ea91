"""Pictures for a calibration, as a laboratory takes them, from the camera twin.

A printed target is held by hand before the camera for the lens; it stands at the end of the pipe
for the mount, while the joints turn; and for the LEDs a glossy one is held before the camera with
one LED on.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Mount, Pinhole, rotation_z
from minorloop_head.procedures.calibration import STRAIGHT
from minorloop_head.twins.camera import LENS
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.targets import CELLS, Target
from papers.catheter import scoring
from papers.catheter.target_view import TargetCamera

JOINT_SD = 0.1
"""Standard deviation of the read angles of the joints, in degrees."""
_HAND = 0.5e-3
"""Standard deviation of the velocity of a target in a hand, in m/s."""
_DARK = 2.5e-3
"""Exposure in s at which only reflections are white."""


@dataclass(frozen=True, eq=False)
class CalibrationTruth:
    """What a calibration should find. For scoring only."""

    lens: Pinhole
    mount: Mount
    straight: FloatArray
    """Shape (2,). Readings of pan and tilt in degrees at which the camera looks along the pipe."""
    camera_roll: float
    """Roll of the camera about its optical axis, in degrees."""
    leds: FloatArray
    """Shape (3, 3). In the camera, in metres."""


class CalibrationScene:
    """A head with a target before it.

    Parameters
    ----------
    target : Target
    specimen : int
        Seed of lens, mount, LEDs, and of how the target is held.
    optics : Pinhole
        The nominal lens.
    """

    def __init__(self, target: Target, specimen: int, optics: Pinhole = LENS) -> None:
        self.target = target
        self._rng = np.random.default_rng([specimen, 19])
        rng, options = self._rng, {"specimen": specimen, "seed": specimen}
        cells, cell = target.cells(), target.square / CELLS
        self._camera = TargetCamera(cells, cell, optics, glossy=False, **options)
        self._glossy = TargetCamera(cells, cell, optics, glossy=True, **options)
        leds = self._camera.leds + rng.normal(0.0, 0.1e-3, (3, 3))
        self._camera.leds = self._glossy.leds = leds
        self.truth = CalibrationTruth(
            scoring.true_lens(self._camera),
            Mount(
                lever=8e-3 * rng.uniform(0.9, 1.1),
                offset=tuple(rng.uniform(-1e-3, 1e-3, 2).tolist()),
                roll=float(rng.uniform(-0.3, 0.3)),
            ),
            np.degrees(STRAIGHT) + rng.uniform(-3.0, 3.0, 2),
            float(rng.uniform(-3.0, 3.0)),
            leds,
        )

    def lens(self, folder: Path, count: int = 16, *, tilts: float = 35.0) -> None:
        """Write pictures of the target all over the image, tilted up to an angle in degrees."""
        places = [(x, y) for y in (-1, 0, 1) for x in (-1, 0, 1)]
        for number in range(count):
            column, row = places[number % 9]
            tilt = self._rng.uniform(0.5, 1.0) * tilts
            aim = np.array([0.3 * column, 0.22 * row]) + self._rng.normal(0.0, 0.05, 2)
            self._hold(self._camera, aim, self._rng.uniform(0.75, 1.1) * self._distance, tilt)
            _write(folder / f"{number:02d}.png", self._camera)

    def mount(self, folder: Path, steps: int = 4) -> list[tuple[str, float, float]]:
        """Write pictures at pairs of joint angles; return names, and pan and tilt in degrees."""
        rows = []
        corner = np.array([*(-self.target.size / 2), 1.3 * self._distance])
        for pan in np.linspace(-15.0, 15.0, steps):
            for tilt in np.linspace(-12.0, 12.0, steps):
                pose = self.truth.mount.pose(np.radians(pan), np.radians(tilt))
                turn = pose.rotation @ rotation_z(np.radians(self.truth.camera_roll))
                self._camera.hold(turn.T, turn.T @ (corner - pose.position))
                read = np.array([pan, tilt]) + self.truth.straight
                read += self._rng.normal(0.0, JOINT_SD, 2)
                name = f"pan{read[0]:.2f}_tilt{read[1]:.2f}.png"
                _write(folder / name, self._camera)
                rows.append((name, float(read[0]), float(read[1])))
        return rows

    def leds(self, folder: Path, count: int = 8) -> None:
        """Write pictures of the reflection of each LED alone in a glossy target."""
        camera = self._glossy
        camera.expose(_DARK)
        for led in range(len(camera.leds)):
            camera.switch([led == other for other in range(len(camera.leds))])
            for number in range(count):
                distance = self._rng.uniform(0.6, 1.0) * self._distance
                self._hold(camera, self._rng.normal(0, 0.02, 2), distance, 8.0)
                _write(folder / f"{led + 1}" / f"{number:02d}.png", camera)

    @property
    def _distance(self) -> float:
        """Distance at which the target fills most of the image."""
        lens = self.truth.lens
        width, height = self.target.size
        return float(max(width / lens.width, height / lens.height) * lens.focal * 1.25)

    def _hold(self, camera: TargetCamera, aim: FloatArray, distance: float, tilt: float) -> None:
        """Hold the target tilted in a random direction, with its middle at a place."""
        way, roll = self._rng.uniform(-np.pi, np.pi), self._rng.normal(0.0, 0.15)
        tilted = Rotation.from_rotvec(np.radians(tilt) * np.array([np.cos(way), np.sin(way), 0]))
        turn = (tilted * Rotation.from_rotvec([0.0, 0.0, roll])).as_matrix()
        place = distance * np.array([*aim, 1.0]) - turn @ np.array([*self.target.size / 2, 0.0])
        camera.hold(turn, place, self._rng.normal(0.0, _HAND, 3))


def _write(path: Path, camera: TargetCamera) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    opencv().imwrite(str(path), camera.frame().image)
