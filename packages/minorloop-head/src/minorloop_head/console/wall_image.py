"""Map of the unrolled wall of the pipe, from the pictures of the camera."""

from __future__ import annotations

import math

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.console.units import Position
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.vision.calibrated_camera import Image, Window, unroll
from minorloop_head.vision.imaging import Image32

STEP = 0.25e-3
"""Size of a texel, in metres."""
_NEAR, _FAR = 6e-3, 46e-3
"""Range in metres ahead of the catheter; nearer wall is out of view, farther wall too oblique."""
_SHOWN, _BEHIND = 0.1, 0.02
"""Length of the shown window, and of its part behind the catheter, in metres."""
_LEAST = 3e3
"""Least resolution of a texel, in pixels per metre of the wall."""


class WallImage:
    """A map of the wall: rows along the pipe, columns around it.

    ``view``: of the camera; ``length``: of the pipe that is mapped, in metres.
    """

    def __init__(self, view: HeadCalibration, length: float = 1.6) -> None:
        self.view = view
        columns = round(2 * math.pi * view.radius / STEP)
        self.grey = np.zeros((round(length / STEP), columns), dtype=np.uint8)
        self._quality = np.zeros(self.grey.shape, dtype=np.float32)
        self._phi = 2 * math.pi * (np.arange(columns) + 0.5) / columns

    def paint(self, image: Image, position: Position) -> None:
        """Add an image that was taken at a position.

        A texel keeps the image with the nearest and squarest view of it, and fades to a newer image
        of nearly the same quality.
        """
        rows = self._rows(position[2])
        if rows.start >= rows.stop:
            return
        view, (pan, tilt) = self.view, position[:2]
        camera = view.camera_at(position[2:])
        z = STEP * (np.arange(rows.start, rows.stop) + 0.5)
        step = 2 * math.pi * view.radius / len(self._phi)
        # Rows and columns have nearly the same size; columns fill the circumference.
        window = Window(self._phi[0], float(z[0]), step, z.size, len(self._phi))
        fresh = unroll(image, camera, window, pan, tilt, least=_LEAST)
        quality = self._quality_of(z, camera.mount.pose(pan, tilt).position)
        grey, known = self.grey[rows], self._quality[rows]
        better = np.isfinite(fresh) & (quality > 0.9 * known)
        mixed = np.where(known > 0, 0.5 * grey + 0.5 * fresh, fresh)
        grey[better] = np.clip(mixed[better], 1, 255).astype(np.uint8)
        known[better] = np.maximum(known, quality)[better]

    def _quality_of(self, z: FloatArray, lens: FloatArray) -> Image32:
        """Return the quality of the view of each texel of some rows: how near and how square."""
        radius = self.view.radius
        x, y = radius * np.cos(self._phi) - lens[0], radius * np.sin(self._phi) - lens[1]
        outward = np.cos(self._phi) * x + np.sin(self._phi) * y
        square = (x * x + y * y)[None, :] + ((z - lens[2]) ** 2)[:, None]
        return np.asarray(outward[None, :] / square**1.5, dtype=np.float32)

    def window(self, advance: float) -> tuple[Image, float, float]:
        """Return the map about an advance, and z of its first and last row, in metres."""
        first = max(0, round((advance - _BEHIND) / STEP))
        first = min(first, len(self.grey) - round(_SHOWN / STEP))
        last = first + round(_SHOWN / STEP)
        return self.grey[first:last], STEP * first, STEP * last

    @property
    def seen(self) -> Image:
        """The map up to its last filled row."""
        used = np.flatnonzero(self.grey.max(axis=1))
        return self.grey[: int(used[-1]) + 1 if used.size else 1]

    def _rows(self, advance: float) -> slice:
        first = max(0, math.floor((advance + _NEAR) / STEP))
        return slice(first, min(len(self.grey), math.ceil((advance + _FAR) / STEP)))
