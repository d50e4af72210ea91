"""Simulated pictures of a flat target, as a laboratory takes them to calibrate the head.

A printed target is held by hand before the camera for the lens; it stands at the end of the pipe
for the mount, while the joints turn; and for the LEDs a glossy one is held before the camera with
one LED on.

::

    camera = TargetCamera(cells, 0.4e-3, specimen=3)   # (rows, columns) of black and white
    camera.hold(turn, (0.0, 0.0, 0.04))                # the target, in the camera
    frame = camera.frame()
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import Mount, Pinhole, rotation_z
from minorloop_head.procedures.calibration import STRAIGHT
from minorloop_head.twins import _camera_kernels as kernels
from minorloop_head.twins.camera import LENS, Camera, _lens_dirt
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.targets import CELLS, Target
from papers.catheter import scoring

JOINT_SD = 0.1
"""Standard deviation of the read angles of the joints, in degrees."""
_HAND = 0.5e-3
"""Standard deviation of the velocity of a target in a hand, in m/s."""
_DARK = 2.5e-3
"""Exposure in s at which only reflections are white."""
_SAMPLES = 3
"""Samples of the pattern along each side of a pixel."""
_WHITE, _BLACK, _ROUND = 1.4, 0.06, 0.03
"""Radiance of paper, of ink, and of what is behind the target."""
_GLOSS, _LOBE = 25.0, 0.012
"""Radiance of the reflection of an LED in a glossy target, and its half-angle in radians."""


Floats = npt.NDArray[np.float32]


class TargetCamera(Camera):
    """The camera of the head before a flat target, which its LEDs light.

    Parameters
    ----------
    cells : (M, N) array of bool
        Pattern of the target: whether each cell is white. Around it is a white margin.
    cell : float
        Side of a cell, in metres.
    optics : Pinhole
    glossy : bool
        Whether the target reflects the LEDs like a mirror.
    margin : float
        Width of the margin, in metres.
    **options
        As for `Camera`.

    Notes
    -----
    A ray of the lens meets the plane of the target at ``H (x, y, 1)``, with a homography H of the
    pose. Each row of pixels is seen later than the one above it, while the target drifts.
    """

    def __init__(
        self,
        cells: npt.NDArray[np.bool_],
        cell: float,
        optics: Pinhole = LENS,
        *,
        glossy: bool = False,
        margin: float = 2e-3,
        **options: Any,
    ) -> None:
        if not cell > 0:
            raise ParameterError(f"cells of {cell} m; give a positive length")
        self._cell, self._glossy = cell, glossy
        self._rim = 1 + round(margin / cell)
        paper = np.pad(np.where(cells, _WHITE, _BLACK), self._rim - 1, constant_values=_WHITE)
        self._albedo = np.pad(paper, 1, constant_values=_ROUND).astype(np.float32)
        super().__init__(Pipe(), None, optics, **options)
        self.hold(np.eye(3), (0.0, 0.0, 0.04))

    def hold(
        self,
        rotation: npt.ArrayLike,
        position: npt.ArrayLike,
        drift: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Hold the target in front of the camera, and focus on it.

        Parameters
        ----------
        rotation : (3, 3) array_like
            From the target, with x along its rows, y down and z away from the camera, to the
            camera.
        position : (3,) array_like
            Of the upper left corner of its cells in the camera, in metres.
        drift : (3,) array_like
            Its velocity, in m/s.
        """
        self._turn = np.asarray(rotation, dtype=np.float64)
        self._place = np.asarray(position, dtype=np.float64)
        self._drift = np.asarray(drift, dtype=np.float64)
        rows, columns = self._albedo.shape
        half = self._cell * (0.5 * np.array([columns, rows, 0.0]) - [self._rim, self._rim, 0.0])
        middle = self._turn @ half + self._place
        self._focus = self._focus_wanted = 1 / float(middle[2])

    def _prepare(self) -> None:
        """Prepare what is the same for all frames: fine rays, and spots on the lens."""
        optics = self._optics
        rows, columns = optics.height // kernels.CELL + 1, optics.width // kernels.CELL + 1
        v, u = (np.arange(count) * float(kernels.CELL) for count in (rows, columns))
        nodes = optics.rays(np.stack(np.meshgrid(u, v), axis=-1))
        steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
        across = (np.arange(optics.width)[:, None] + steps).ravel()
        down = (np.arange(optics.height)[:, None] + steps).ravel()
        self._rays = nodes
        self._fine = np.stack(
            [RectBivariateSpline(v, u, nodes[..., k])(down, across) for k in (0, 1)]
        ).astype(np.float32)
        self._after = (self.sensor.readout * (down / optics.height - 0.5)).astype(np.float32)
        self._lens_dirt = _lens_dirt(optics, self.sensor.lens_dirt, self._rng)
        self._spare = np.empty((optics.height, optics.width), dtype=np.float32)

    def _radiance(self) -> npt.NDArray[np.float32]:
        """Return the light on the sensor (H, W), before glare."""
        middle = _SAMPLES // 2
        x, y = self._fine
        albedo = self._pattern(*self._meet(x, y, self._after)[:2])
        rows, columns = (size // _SAMPLES for size in albedo.shape)
        mean = albedo.reshape(rows, _SAMPLES, columns, _SAMPLES).mean(axis=(1, 3))
        x, y = (each[middle::_SAMPLES, middle::_SAMPLES] for each in (x, y))
        light, gloss = self._shading(x, y, self._meet(x, y, self._after[middle::_SAMPLES])[2])
        image = np.ascontiguousarray(mean * light + gloss, dtype=np.float32)
        kernels.blur(image, self._variances(), self._spare)
        return image

    def _meet(self, x: Floats, y: Floats, after: Floats) -> tuple[Floats, Floats, Floats]:
        """Return where rays (x, y, 1) meet the target, in metres from its corner, and how far."""
        turn = self._turn.astype(np.float32)
        start = (turn.T @ self._place).astype(np.float32)
        drift = (turn.T @ self._drift).astype(np.float32)
        # In the frame of the target a ray is length * along - start, and the target is z = 0.
        along = [turn[0, k] * x + turn[1, k] * y + turn[2, k] for k in range(3)]
        begin = [start[k] + after[:, None] * drift[k] for k in range(3)]
        length = begin[2] / along[2]
        return length * along[0] - begin[0], length * along[1] - begin[1], length

    def _pattern(self, across: Floats, down: Floats) -> Floats:
        """Return the albedo at places on the plane of the target, in metres from its corner."""
        cell, rim = np.float32(self._cell), self._rim
        rows, columns = self._albedo.shape
        i = np.clip(down / cell + rim, 0, rows - 1).astype(np.int32)
        j = np.clip(across / cell + rim, 0, columns - 1).astype(np.int32)
        albedo: Floats = self._albedo[i, j]
        return albedo

    def _shading(self, x: Floats, y: Floats, length: Floats) -> tuple[Floats, Floats]:
        """Return the light of the LEDs on the target, 1 near its middle, and their reflections."""
        normal = self._turn[:, 2].astype(np.float32)
        on = np.array(self._on)
        total, gloss = np.zeros_like(x), np.zeros_like(x)
        ray = np.stack([x, y, np.ones_like(x)])
        toward = np.tensordot(normal, ray, axes=1)
        mirrored = (ray - 2 * toward * normal[:, None, None]) / np.sqrt((ray**2).sum(axis=0))
        for led, strength in zip(self.leds[on], self._strengths[on], strict=True):
            way = led.astype(np.float32)[:, None, None] - length * ray
            apart = np.sqrt((way**2).sum(axis=0))
            facing = -np.tensordot(normal, way, axes=1) / apart
            total += np.float32(strength) * np.maximum(facing, 0.0) / apart**2
            if self._glossy:
                cosine = np.minimum((mirrored * way).sum(axis=0) / apart, 1.0)
                gloss += np.exp(np.float32(-2 / _LOBE**2) * (1 - cosine))
        return total * np.float32(1 / self._focus**2 / max(on.sum(), 1)), _GLOSS * gloss

    def _variances(self) -> npt.NDArray[np.float32]:
        """Return the variance of the blur at the nodes, in the place where `blur` reads it."""
        start = float(self._turn[:, 2] @ self._place)
        depth = start / (self._rays @ self._turn[:, 2])
        circle = self._optics.focal * self.sensor.aperture * np.abs(1 / depth - self._focus)
        fields = np.zeros((4, *depth.shape), dtype=np.float32)
        fields[3] = self.sensor.sharpest**2 + (circle / 4) ** 2
        return fields


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
