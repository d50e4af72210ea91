"""What passes between the control loop and the eyes of the seat.

The loop says where the head is and what it wishes; the eyes say what they saw, a tick later. They
are in processes of their own, so that no picture ever holds up the loop.
"""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias

import msgspec

Wish: TypeAlias = tuple[str, list[float]]
"""What the eyes are to do: a name of `Eyes.wishes` and numbers."""


class Look(msgspec.Struct, frozen=True, kw_only=True):
    """A tick of the control loop, for the eyes.

    Parameters
    ----------
    number : int
        Of the tick.
    t : float
        In seconds, on the clock of the loop.
    where : (float, float, float, float)
        Pan and tilt about the middle, advance and roll as measured, in degrees and mm.
    stance : tuple of float
        For a simulated tip only, see `Plant.stance`.
    wishes : list of Wish
    keep : bool
        Whether pictures are to come back, for a recording.
    """

    number: int
    t: float
    where: tuple[float, float, float, float]
    stance: tuple[float, ...] = ()
    wishes: list[Wish] = []
    keep: bool = False


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """What the eyes made of a tick.

    Parameters
    ----------
    number : int
        Of the tick.
    target : (float, float, float, bool), optional
        Pixel of the point that is followed, how well it was recognised, and whether it is seen;
        None where none is followed.
    spots : list of (float, float, float, float)
        Pixel, diameter in pixels and evidence of what could be a defect, the likeliest first.
    events : list of dict
        What was found out, each with a ``what``.
    """

    number: int
    target: tuple[float, float, float, bool] | None = None
    spots: list[tuple[float, float, float, float]] = []
    events: list[dict[str, Any]] = []


class Sight(Protocol):
    """What the control loop needs of the eyes; neither call waits."""

    def look(self, look: Look) -> None:
        """Say where the head is and what is wished."""

    def seen(self) -> list[Seen]:
        """What came since the last call."""
