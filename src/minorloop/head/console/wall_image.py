"""The wall of the pipe, unrolled, as it fills with what the camera has seen."""

from __future__ import annotations

import math

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.console.plant import PlantView, Where, angles_of
from minorloop.head.vision.calibrated_camera import Image, Image32, Window, unroll

STEP = 0.25e-3
"""Size of a texel, in metres."""
_NEAR, _FAR = 6e-3, 46e-3
_SHOWN = 0.1
_LEAST = 3e3  # pixels for each metre of the wall


class WallImage:
    """A map of the wall: rows along the pipe, columns around it.

    Parameters
    ----------
    view : PlantView
        Of the camera.
    length : float
        Of the pipe that is mapped, in metres.
    """

    def __init__(self, view: PlantView, length: float = 1.6) -> None:
        self.view = view
        columns = round(2 * math.pi * view.radius / STEP)
        self.grey = np.zeros((round(length / STEP), columns), dtype=np.uint8)
        self._quality = np.zeros(self.grey.shape, dtype=np.float32)
        self._phi = 2 * math.pi * (np.arange(columns) + 0.5) / columns

    def paint(self, image: Image, where: Where) -> None:
        """Add an image that was taken at pan, tilt, advance and roll, in degrees and mm.

        A texel keeps the image that saw it nearest and most squarely, and fades to a newer one
        that sees it nearly as well.
        """
        rows = self._rows(where[2])
        if rows.start >= rows.stop:
            return
        view, (pan, tilt) = self.view, angles_of(where)
        eye = view.eye(where)
        z = STEP * (np.arange(rows.start, rows.stop) + 0.5)
        step = 2 * math.pi * view.radius / len(self._phi)
        # Rows and columns are of nearly the same size; columns close round the pipe.
        window = Window(self._phi[0], float(z[0]), step, z.size, len(self._phi))
        fresh = unroll(image, eye, window, pan, tilt, least=_LEAST)
        quality = self._quality_of(z, eye.mount.pose(pan, tilt).position)
        grey, known = self.grey[rows], self._quality[rows]
        better = np.isfinite(fresh) & (quality > 0.9 * known)
        mixed = np.where(known > 0, 0.5 * grey + 0.5 * fresh, fresh)
        grey[better] = np.clip(mixed[better], 1, 255).astype(np.uint8)
        known[better] = np.maximum(known, quality)[better]

    def _quality_of(self, z: FloatArray, lens: FloatArray) -> Image32:
        """How squarely and from how near each texel of some rows is seen."""
        radius = self.view.radius
        x, y = radius * np.cos(self._phi) - lens[0], radius * np.sin(self._phi) - lens[1]
        outward = np.cos(self._phi) * x + np.sin(self._phi) * y
        square = (x * x + y * y)[None, :] + ((z - lens[2]) ** 2)[:, None]
        return np.asarray(outward[None, :] / square**1.5, dtype=np.float32)

    def window(self, advance: float) -> tuple[Image, float, float]:
        """The map about an advance in mm: an image, and the z in mm of its first and last row."""
        first = max(0, round((1e-3 * advance - 0.02) / STEP))
        first = min(first, len(self.grey) - round(_SHOWN / STEP))
        last = first + round(_SHOWN / STEP)
        return self.grey[first:last], 1e3 * STEP * first, 1e3 * STEP * last

    @property
    def seen(self) -> Image:
        """The map up to the last row that was seen."""
        used = np.flatnonzero(self.grey.max(axis=1))
        return self.grey[: int(used[-1]) + 1 if used.size else 1]

    def _rows(self, advance: float) -> slice:
        first = max(0, math.floor((1e-3 * advance + _NEAR) / STEP))
        return slice(first, min(len(self.grey), math.ceil((1e-3 * advance + _FAR) / STEP)))
