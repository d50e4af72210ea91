"""Candidates for defects: found in frames under switched lights, stored by place on the wall."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop_head.console.messages import Spot
from minorloop_head.console.units import Position, to_si
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.trace import nearest
from minorloop_head.vision.defects import Findings, Hole, find_holes, strongest
from minorloop_head.vision.reflectance_map import LitFrame

_REST_TICKS = 12
"""Ticks at rest before a search, half a second."""
_REST = to_si((0.4, 0.4, 0.2, 0.5))
"""Range of the position within which the head counts as at rest."""
_NEW = to_si((5.0, 5.0, 2.0, 6.0))
"""Change of the position after which the view is searched again."""
_MOST_KNOWN, _MOST_SHOWN = 60, 8
"""Largest numbers of stored candidates, and of candidates shown in a picture."""
_LEAST_PIXELS = 6.0
"""Smallest diameter of a shown candidate, in pixels."""


@dataclass(eq=False)
class Finder:
    """Candidates on the wall."""

    view: HeadCalibration

    def __post_init__(self) -> None:
        self.known: tuple[Hole, ...] = ()
        self._recent: deque[Position] = deque(maxlen=_REST_TICKS)
        self._searched: Position | None = None
        self._frames: tuple[LitFrame, ...] = ()

    def note(self, position: Position) -> None:
        """Store the position of the head in a tick."""
        self._recent.append(position)

    @property
    def at_rest(self) -> bool:
        """Whether the head has not moved for half a second."""
        return len(self._recent) == _REST_TICKS and not (np.ptp(self._recent, axis=0) > _REST).any()

    def has_searched(self, position: Position) -> bool:
        """Return whether the view from a position is the last searched one."""
        return self._searched is not None and bool(
            (np.abs(np.subtract(position, self._searched)) <= _NEW).all()
        )

    def searched(self, position: Position) -> None:
        """Store a position whose view is searched."""
        self._searched, self._frames = position, ()

    def keep(self, frames: tuple[LitFrame, ...]) -> None:
        """Store the frames of the searched acquisition."""
        self._frames = frames

    def frames_with(self, now: LitFrame, position: Position) -> tuple[LitFrame, ...]:
        """Return the frames under other lights from the same place, then one under all lights."""
        if self._searched is None or (np.abs(np.subtract(position, self._searched)) > _REST).any():
            return (now,)
        return (*self._frames[:-1], now)

    def find(self, frames: Sequence[LitFrame], position: Position) -> Findings:
        """Search the frames of an acquisition for defects; takes a tenth of a second."""
        return find_holes(frames, self.view.camera_at(position[2:]))

    def add(self, found: Findings) -> None:
        """Store candidates, each once."""
        every = strongest([*self.known, *found.holes], self.view.radius, -np.inf)
        self.known = every[:_MOST_KNOWN]

    def near(self, place: npt.ArrayLike) -> Hole | None:
        """Return the known candidate at phi and z."""
        return nearest(self.known, place, self.view.radius)

    def shown(self, position: Position) -> list[Spot]:
        """Return pixel, diameter in pixels and evidence of candidates in view, likeliest first."""
        if not self.known:
            return []
        camera, angles = self.view.camera_at(position[2:]), position[:2]
        places = np.array([hole.place for hole in self.known])
        pixels = camera.pixel(places, *angles)
        size = (camera.lens.width, camera.lens.height)
        shown = []
        for hole, pixel in zip(self.known, pixels, strict=True):
            if not ((pixel > 0) & (pixel < size)).all():  # NaN is behind the camera
                continue
            half = np.diag([hole.diameter / 2 / camera.radius, hole.diameter / 2])
            rim = camera.pixel(hole.place + half, *angles)  # around the pipe, and along it
            across = 2 * float(np.hypot(*(rim - pixel).T).max())
            if across > _LEAST_PIXELS:
                shown.append((float(pixel[0]), float(pixel[1]), across, float(hole.evidence)))
        return sorted(shown, key=lambda spot: -spot[3])[:_MOST_SHOWN]
