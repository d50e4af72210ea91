"""What could be a defect: looked for with switched lights, and remembered on the wall."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.head.console.plant import PlantView, Where, angles_of
from minorloop.head.procedures.extract import nearest
from minorloop.head.vision.defects import Findings, Hole, find_holes, strongest
from minorloop.head.vision.reflectance_map import LitFrame

_REST_TICKS = 12
_REST = (0.4, 0.4, 0.2, 0.5)
_NEWS = (5.0, 5.0, 2.0, 6.0)
_MOST_KNOWN, _MOST_SHOWN = 60, 8
_LEAST_PIXELS = 6.0


@dataclass(eq=False)
class Finder:
    """Candidates on the wall.

    Parameters
    ----------
    view : PlantView
    """

    view: PlantView

    def __post_init__(self) -> None:
        self.known: tuple[Hole, ...] = ()
        self._lately: deque[Where] = deque(maxlen=_REST_TICKS)
        self._looked: Where | None = None

    def at_rest_somewhere_new(self, where: Where) -> bool:
        """Whether the head has come to rest where it was not looked for defects yet."""
        self._lately.append(where)
        if len(self._lately) < _REST_TICKS or (np.ptp(self._lately, axis=0) > _REST).any():
            return False
        return self._looked is None or bool(
            (np.abs(np.subtract(where, self._looked)) > _NEWS).any()
        )

    def looked(self, where: Where) -> None:
        """Remember that defects were looked for from here."""
        self._looked = where

    def find(self, looks: Sequence[LitFrame], where: Where) -> Findings:
        """Look for defects in the frames of an acquisition; takes a tenth of a second."""
        return find_holes(looks, self.view.eye(where))

    def add(self, found: Findings) -> None:
        """Remember what was found, each thing once."""
        every = strongest([*self.known, *found.holes], self.view.radius, -np.inf)
        self.known = every[:_MOST_KNOWN]

    def near(self, place: npt.ArrayLike) -> Hole | None:
        """The known one that is the same as what was picked at phi and z."""
        return nearest(self.known, place, self.view.radius)

    def shown(self, where: Where) -> list[tuple[float, float, float, float]]:
        """Pixel, diameter in pixels and evidence of those in view, the likeliest first."""
        if not self.known:
            return []
        eye, angles = self.view.eye(where), angles_of(where)
        places = np.array([hole.place for hole in self.known])
        pixels = eye.pixel(places, *angles)
        size = (eye.lens.width, eye.lens.height)
        shown = []
        for hole, pixel in zip(self.known, pixels, strict=True):
            if not ((pixel > 0) & (pixel < size)).all():  # NaN is behind the camera
                continue
            half = np.diag([hole.diameter / 2 / eye.radius, hole.diameter / 2])
            rim = eye.pixel(hole.place + half, *angles)  # round the pipe, and along it
            across = 2 * float(np.hypot(*(rim - pixel).T).max())
            if across > _LEAST_PIXELS:
                shown.append((float(pixel[0]), float(pixel[1]), across, float(hole.evidence)))
        return sorted(shown, key=lambda spot: -spot[3])[:_MOST_SHOWN]
