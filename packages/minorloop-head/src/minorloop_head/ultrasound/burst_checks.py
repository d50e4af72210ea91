"""Check which bursts of a raster can be used together, and give reasons for the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from minorloop_head.geometry import wrapped
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.spectra import LEAD, WINDOW

FROZEN = "frozen"
SHORT, FEW, SMALL, _MISSING = "too short", "too few echoes", "raster too small", "part missing"
ONE_PLACE, BESIDE = "all at one place", "raster beside the mouth"
_FEWEST_INSIDE, _FEWEST_OUTSIDE = 3, 5
_INSIDE, _BESIDE, _ONE = 0.4e-3, 0.2e-3, 0.1e-3
"""Smallest radius that counts as inside a mouth, distance from its rim from which on a spot is on
plain wall, and smallest distance between two places, in metres. A footprint is 1 mm wide."""


def usable_bursts(bursts: Sequence[Burst]) -> list[Burst]:
    """Return the bursts without a fault, of the most frequent length and sample interval."""
    return [burst for burst, reason in zip(bursts, rejections(bursts), strict=True) if not reason]


def rejections(bursts: Sequence[Burst]) -> list[str]:
    """Return for each burst why it cannot be used, or an empty string.

    A burst without noise between its shots, or equal to the one before, is ``frozen``.
    """
    found = [_reason(burst) for burst in bursts]
    for n in range(1, len(bursts)):
        if not found[n] and np.array_equal(bursts[n].trace, bursts[n - 1].trace):
            found[n] = FROZEN
    kinds = [(burst.trace.size, burst.sample_interval) for burst in bursts]
    good = [kind for kind, reason in zip(kinds, found, strict=True) if not reason]
    usual = max(set(good), key=lambda kind: (good.count(kind), kind), default=None)
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


def coverage_fault(
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
    *,
    whole: bool = True,
) -> str:
    """Return why usable bursts do not cover a mouth, or an empty string.

    ``bursts``: usable ones; ``probe``: the probe and what is known of the pipe; ``centre``: phi and
    z of the mouth; ``diameter``: of the mouth, in metres; ``whole``: whether these are all that
    were planned.
    """
    if not long_enough(bursts, probe):
        return SHORT
    spots = probe.spots(np.array([burst.angles for burst in bursts]))
    around = probe.radius * wrapped(spots[:, 0] - centre[0])
    off = np.stack([around, spots[:, 1] - centre[1]], axis=1)
    if np.linalg.norm(off - off.mean(axis=0), axis=1).max() < _ONE:
        return ONE_PLACE
    away = np.linalg.norm(off, axis=1)
    if (away < max(diameter / 2, _INSIDE)).sum() < _FEWEST_INSIDE:
        return BESIDE if whole else _MISSING
    outside = int((away > diameter / 2 + _BESIDE).sum())
    if outside >= _FEWEST_OUTSIDE:
        return ""
    # A raster is symmetric: half a raster that lacks wall may be completed by the other half.
    return SMALL if whole or 2 * outside < _FEWEST_OUTSIDE else _MISSING


def long_enough(bursts: Sequence[Burst], probe: CalibratedProbe) -> bool:
    """Return whether the traces of usable bursts last until the end of the window of the fit."""
    if not bursts:
        return True
    spots = probe.spots(np.array([burst.angles for burst in bursts]))
    needed = 2 * spots[:, 2] / probe.speed + WINDOW - LEAD
    lasted = np.array([burst.trace.size * burst.sample_interval for burst in bursts])
    return bool((lasted >= needed).all())
