"""The wall of the pipe, unrolled, as it fills with what the camera has seen."""

from __future__ import annotations

import math

import numpy as np

from minorloop.teleop.imaging import opencv
from minorloop.teleop.plant import View
from minorloop.teleop.sight import Image, turned

STEP = 0.25e-3
"""Size of a texel, in metres."""
_NEAR, _FAR = 6e-3, 46e-3
_SHOWN = 0.1


class Wall:
    """A map of the wall: rows along the pipe, columns around it.

    Parameters
    ----------
    view : View
        Of the camera.
    length : float
        Of the pipe that is mapped, in metres.
    """

    def __init__(self, view: View, length: float = 1.6) -> None:
        self.view = view
        columns = round(2 * math.pi * view.radius / STEP)
        self.grey = np.zeros((round(length / STEP), columns), dtype=np.uint8)
        self._quality = np.zeros(self.grey.shape, dtype=np.float32)
        self._phi = 2 * math.pi * (np.arange(columns) + 0.5) / columns

    def paint(self, image: Image, where: tuple[float, float, float, float]) -> None:
        """Add an image that was taken at pan, tilt, advance and roll, in degrees and mm.

        A texel keeps the image that saw it nearest and most squarely, and fades to a newer one
        that sees it nearly as well.
        """
        pan, tilt, advance, roll = where
        rows = self._rows(advance)
        if rows.start >= rows.stop:
            return
        view, turn = self.view, turned(pan, tilt)
        z = STEP * (np.arange(rows.start, rows.stop) + 0.5) - 1e-3 * advance
        phi = self._phi - math.radians(roll)
        wall = np.stack(
            [
                np.broadcast_to(view.radius * np.cos(phi), (z.size, phi.size)),
                np.broadcast_to(view.radius * np.sin(phi), (z.size, phi.size)),
                np.broadcast_to(z[:, None], (z.size, phi.size)),
            ],
            axis=-1,
        ).astype(np.float32)
        sight = wall - (view.lever * turn[:, 2]).astype(np.float32)
        seen = sight @ turn.astype(np.float32)
        depth = np.maximum(seen[..., 2], 1e-4)
        u = (view.focal / depth * seen[..., 0] + (view.width - 1) / 2).astype(np.float32)
        v = (view.focal / depth * seen[..., 1] + (view.height - 1) / 2).astype(np.float32)
        inside = (
            (seen[..., 2] > 1e-3) & (u > 1) & (u < view.width - 2) & (v > 1) & (v < view.height - 2)
        )
        far = np.linalg.norm(sight, axis=-1)
        facing = (wall[..., 0] * sight[..., 0] + wall[..., 1] * sight[..., 1]) / (view.radius * far)
        quality = np.where(inside, facing / far**2, 0.0).astype(np.float32)
        fresh = opencv().remap(image, u, v, opencv().INTER_LINEAR)
        grey, known = self.grey[rows], self._quality[rows]
        better = inside & (quality > 0.9 * known)
        mixed = np.where(known > 0, 0.5 * grey + 0.5 * fresh, fresh)
        grey[better] = mixed[better].astype(np.uint8)
        known[better] = np.maximum(known, quality)[better]

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
