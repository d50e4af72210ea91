"""Which bursts of a raster can be used together, and why others cannot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop.head.geometry import wrapped
from minorloop.head.ultrasound.echoes import Burst
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.ultrasound.spectra import LEAD, WINDOW

FROZEN = "frozen"
SHORT, FEW, SMALL, MISSING = "too short", "too few echoes", "raster too small", "part missing"
ONE_PLACE, BESIDE = "all at one place", "raster beside the mouth"
_FEWEST_INSIDE, _FEWEST_OUTSIDE = 3, 5
_INSIDE, _BESIDE, _ONE = 0.4e-3, 0.2e-3, 0.1e-3
"""Least radius of the middle of a mouth, how far beside it the wall is told, and how far apart
places are at least, in metres."""


def usable(bursts: Sequence[Burst]) -> list[Burst]:
    """Bursts that can be used together: heard, finite, new, and of one length and interval."""
    return [burst for burst, reason in zip(bursts, reasons_of(bursts), strict=True) if not reason]


def reasons_of(bursts: Sequence[Burst]) -> list[str]:
    """Why each burst cannot be used, or nothing.

    Without noise between its shots, or with the very trace of the one before, a burst was not
    heard anew.
    """
    found = [_reason(burst) for burst in bursts]
    for n in range(1, len(bursts)):
        if not found[n] and np.array_equal(bursts[n].trace, bursts[n - 1].trace):
            found[n] = FROZEN
    kinds = [(burst.trace.size, burst.sample_interval) for burst in bursts]
    told = [kind for kind, reason in zip(kinds, found, strict=True) if not reason]
    usual = max(set(told), key=lambda kind: (told.count(kind), kind), default=None)
    return [
        reason or ("" if kind == usual else "not a trace")
        for kind, reason in zip(kinds, found, strict=True)
    ]


def _reason(burst: Burst) -> str:
    if burst.verdict:
        return burst.verdict
    trace, interval = burst.trace, burst.sample_interval
    numbers = trace.ndim == 1 and trace.size > 0 and np.isfinite(trace).all()
    if not (numbers and np.isfinite(interval) and interval > 0):
        return "not a trace"
    if not np.isfinite(burst.angles).all():
        return "no angles"
    if burst.noise == 0:
        return FROZEN
    return "" if 0 < burst.noise < np.inf else "not a trace"


def too_little(
    bursts: Sequence[Burst],
    ear: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    whole: bool = True,
) -> str:
    """Why usable bursts hold no depth of a mouth, or nothing.

    Parameters
    ----------
    bursts : sequence of Burst
        Usable ones.
    ear : CalibratedProbe
        The probe and what is known of the pipe.
    centre : (float, float)
        Of the mouth, phi and z.
    diameter : float
        Of the mouth, in metres.
    whole : bool
        Whether these are all that were planned.
    """
    if not covered(bursts, ear):
        return SHORT
    spots = ear.spots(np.array([burst.angles for burst in bursts]))
    around = ear.radius * wrapped(spots[:, 0] - centre[0])
    off = np.stack([around, spots[:, 1] - centre[1]], axis=1)
    if np.linalg.norm(off - off.mean(axis=0), axis=1).max() < _ONE:
        return ONE_PLACE
    away = np.linalg.norm(off, axis=1)
    if (away < max(diameter / 2, _INSIDE)).sum() < _FEWEST_INSIDE:
        return BESIDE if whole else MISSING
    outside = int((away > diameter / 2 + _BESIDE).sum())
    if outside >= _FEWEST_OUTSIDE:
        return ""
    # A raster is as wide on one side of its centre as on the other.
    return SMALL if whole or 2 * outside < _FEWEST_OUTSIDE else MISSING


def covered(bursts: Sequence[Burst], ear: CalibratedProbe) -> bool:
    """Whether the traces of usable bursts are long enough for the wall and all that is under it."""
    if not bursts:
        return True
    spots = ear.spots(np.array([burst.angles for burst in bursts]))
    needed = 2 * spots[:, 2] / ear.speed + WINDOW - LEAD
    lasted = np.array([burst.trace.size * burst.sample_interval for burst in bursts])
    return bool((lasted >= needed).all())
