"""A head stays where it is while it is not read, and goes back after some time.

A model takes a head to its target without readings, past everything that was seen before: by a
camera, it is not found again there. Where the wall was never seen, no search finds it. The way back
to the cold head leads past wall that was. Without a picture of anything, it would lead nowhere. A
head that had to go back turns more slowly from then on, so that it sees the wall in smaller steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import within

_LEARNED, _MOST = 0.25, 25.0
"""Share by which a gap between readings changes the usual one, and most steps of a gap that counts:
those of a camera with one picture a second."""
_USUAL = 2.0
"""Times the usual gap from which a gap is an unusual one."""
_BACK = 0.015
"""Share of the angles by which an interval takes the head back: at 25 a second it is half way in
2 s."""
_SLOWEST = 4
"""Times by which a head turns more slowly, at most."""
_NEAR = 0.5
"""Degrees about where it was: as accurate as the model is in a moment, so that a head at its target
keeps it."""


@dataclass(frozen=True)
class Unread:
    """State of a head with respect to missing readings."""

    gap: int = 0
    """Steps without a usable reading."""
    usual: float = 0.0
    """Steps between two readings, lately."""
    kept: FloatArray | None = None
    """Shape (axes,). Readings in degrees by the model when the gap became an unusual one, None
    before; after some time those on the way back."""
    dark: int = 0
    """Steps of the gap in which there was nothing to look for the view in."""
    lost: int = 0
    """Gaps in which the head went back."""

    @property
    def slower(self) -> int:
        """Times by which the head turns more slowly."""
        return min(1 + self.lost, _SLOWEST)


@dataclass(frozen=True, kw_only=True)
class UnreadWatch:
    """Keeps a head where it is after some steps without a reading.

    Raises
    ------
    ParameterError
        If the number is out of its range.
    """

    after: int = 3
    """Steps, at least; for a sensor that has fewer readings than the loop has steps, it is twice
    the usual gap between them."""
    stays: int = 50
    """Intervals for which it stays while its view is looked for: a search has tried all angles
    where the wall was seen in fewer."""
    takes: int = 1
    """Intervals of the loop that a step takes."""

    def __post_init__(self) -> None:
        within("after", self.after, 1, 10_000)
        within("stays", self.stays, 1, 10_000)
        within("takes", self.takes, 1, 10_000)

    def step(self, before: Unread, gap: int, read: FloatArray, *, searched: bool = True) -> Unread:
        """Return the state one step later.

        Parameters
        ----------
        before : Unread
        gap : int
            Steps without a usable reading, now.
        read : (axes,) array
            Present readings in degrees, as the model expects them.
        searched : bool
            Whether the view was looked for: not in a black picture, which shows nothing anywhere.
        """
        if not gap:
            usual = before.usual + _LEARNED * (min(float(before.gap), _MOST) - before.usual)
            return Unread(0, usual, lost=before.lost + self._goes(before))
        more = gap - before.gap
        state = replace(before, gap=gap, dark=before.dark + (0 if searched else more))
        if gap < max(self.after, _USUAL * before.usual):
            return replace(state, kept=None)
        kept = read if before.kept is None else before.kept
        back = self.takes * more if searched and self._goes(state) else 0
        return replace(state, kept=(1.0 - _BACK) ** back * kept)

    def _goes(self, state: Unread) -> bool:
        """Whether the view has been looked for as long as the head stays."""
        return self.takes * (state.gap - state.dark) > self.stays

    def near(self, state: Unread, wanted: FloatArray) -> FloatArray:
        """Return wanted readings (axes,) in degrees, near those that are kept."""
        if state.kept is None:
            return wanted
        return np.clip(wanted, state.kept - _NEAR, state.kept + _NEAR)
