"""A plain picture of a pipe's inside: what a camera on the head would see, without its troubles.

One light sits at the lens; the wall is brushed metal with a white hole, a stain and a bright
reflection that is not a defect. It has no blur, no glare and no rolling shutter.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.lab.actuator import Frame

WIDTH, HEIGHT, FOCAL = 320, 240, 260.0
LEVER, RADIUS = 8e-3, 10e-3
_TEXEL = 0.05e-3
_LENGTH = 0.12
_REFERENCE = 26e-3  # distance at which the wall has its full brightness
_HOLES = ((0.35, 0.030, 0.5e-3), (3.6, 0.048, 0.5e-3))  # phi, z, radius
_STAINS = ((2.2, 0.036, 2.2e-3), (5.4, 0.028, 1.6e-3))


class Picture:
    """320 by 240 grey pixels of a 20 mm pipe, 25 times a second.

    Parameters
    ----------
    seed : int
        Of the metal and the noise.
    """

    width, height, focal, lever, radius = WIDTH, HEIGHT, FOCAL, LEVER, RADIUS
    interval = 0.04

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng([seed, 7])
        self._wall = _wall(self._rng)
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        x, y = (u - (WIDTH - 1) / 2) / FOCAL, (v - (HEIGHT - 1) / 2) / FOCAL
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        self._rays = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3)
        self._noise = self._rng.normal(0.0, 1.2, (8, HEIGHT * WIDTH)).astype(np.float32)
        self._pan, self._tilt, self._advance, self._roll = 0.0, 0.0, 0.0, 0.0
        self._clock = 0.0

    def look(self, pan: float, tilt: float, *, rates: tuple[float, float] = (0.0, 0.0)) -> None:
        """Say where the head looks, in radians about the axis of the pipe."""
        self._pan, self._tilt = as_finite("pan", pan), as_finite("tilt", tilt)

    def place(self, advance: float, roll: float) -> None:
        """Say where the catheter is in the pipe, in metres, and how it is turned, in radians."""
        self._advance, self._roll = as_finite("advance", advance), as_finite("roll", roll)

    def focus_at(self, distance: float) -> None:
        """A pinhole is in focus everywhere."""

    def frame(self) -> Frame:
        """The next image."""
        turn = self._turn().astype(np.float32)
        rays = self._rays @ turn.T
        lens = (LEVER * turn[:, 2]).astype(np.float32)
        far = _to_wall(lens, rays)
        x, y = lens[0] + far * rays[:, 0], lens[1] + far * rays[:, 1]
        phi = np.arctan2(y, x) + np.float32(self._roll)
        z = lens[2] + far * rays[:, 2] + np.float32(self._advance)
        facing = np.maximum((x * rays[:, 0] + y * rays[:, 1]) / RADIUS, 0.0)
        rows, columns = self._wall.shape
        row = (z / _TEXEL).astype(np.int32) % rows
        column = (phi * (columns / (2 * math.pi))).astype(np.int32) % columns
        bright = self._wall[row, column] * np.sqrt(facing) * np.minimum(_REFERENCE / far, 1.6)
        bright += 90.0 * facing**40  # the light at the lens, mirrored
        grey = 12.0 + bright + self._noise[int(self._clock / self.interval) % len(self._noise)]
        t, self._clock = self._clock, self._clock + self.interval
        return Frame(t, np.clip(grey, 0, 255).astype(np.uint8).reshape(HEIGHT, WIDTH))

    def _turn(self) -> FloatArray:
        """(3, 3) from the camera to the pipe: first the tilt about x, then the pan about y."""
        cp, sp = math.cos(self._pan), math.sin(self._pan)
        ct, st = math.cos(self._tilt), math.sin(self._tilt)
        pan = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, ct, -st], [0.0, st, ct]])
        return np.asarray(pan @ tilt, dtype=np.float64)


def _to_wall(
    lens: npt.NDArray[np.float32], rays: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """How far the wall is along each ray, in metres, 0.3 at most."""
    a = np.maximum(rays[:, 0] ** 2 + rays[:, 1] ** 2, 1e-9)
    b = lens[0] * rays[:, 0] + lens[1] * rays[:, 1]
    c = lens[0] ** 2 + lens[1] ** 2 - RADIUS**2
    far: npt.NDArray[np.float32] = np.minimum(
        (-b + np.sqrt(np.maximum(b * b - a * c, 0.0))) / a, 0.3
    )
    return far


def _wall(rng: np.random.Generator) -> npt.NDArray[np.float32]:
    """Brightness of the wall, unrolled: rows along the pipe, columns around it."""
    rows, columns = round(_LENGTH / _TEXEL), round(2 * math.pi * RADIUS / _TEXEL)
    brushed = np.repeat(rng.normal(0.0, 7.0, (rows // 24, columns)), 24, axis=0)
    wall = 105.0 + brushed + rng.normal(0.0, 3.0, (rows, columns))
    for phi, z, radius in _STAINS:
        wall -= 55.0 * np.exp(-((_away(phi, z, rows, columns) / radius) ** 2))
    for phi, z, radius in _HOLES:
        edge = (radius - _away(phi, z, rows, columns)) / _TEXEL
        wall = np.where(edge > -3, 60.0, wall)
        wall += np.clip(edge + 0.5, 0.0, 1.0) * 620.0
    return wall.astype(np.float32)


def _away(phi: float, z: float, rows: int, columns: int) -> FloatArray:
    """Distance of each texel from a place of the wall, in metres."""
    along = _TEXEL * (np.arange(rows) + 0.5) - z
    around = 2 * math.pi * (np.arange(columns) + 0.5) / columns - phi
    around = RADIUS * ((around + math.pi) % (2 * math.pi) - math.pi)
    far: FloatArray = np.hypot(along[:, None], around[None, :])
    return far
