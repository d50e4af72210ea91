"""Selection of the bursts of a raster that fit together, and spectra of their echoes of a wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wrapped
from minorloop_head.ultrasound.echoes import Burst, Pulse, find_echoes
from minorloop_head.ultrasound.field import (
    HIGHEST,
    LOWEST,
    RESOLUTION,
    CalibratedProbe,
    ComplexArray,
)

WINDOW = 1 / RESOLUTION
LEAD = 0.6e-6
"""Time from the start of the window to the echo of the wall, in seconds."""
_TAPER = 0.2
"""Share of the window in its rising and falling flanks."""
FAR = 10
"""Number of traces far from a pit for the place of the wall and the pulse."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """Spectra of the traces of a raster."""

    received: ComplexArray
    """Shape (K, F). Spectra of the windows, phases counted from the expected echo of the wall."""
    noise: FloatArray
    """Shape (K,). Standard deviation of each part of a spectrum."""
    angles: FloatArray
    """Shape (K, 2). Pan and tilt, in radians."""
    beyond: FloatArray
    """Shape (K,). Distances behind the nominal wall, along the beams, from which phases count, in
    metres."""


def spectra_of(
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    *,
    after: float = 0.0,
) -> Spectra | None:
    """Return the spectra of bursts; None if there is no echo of the wall around the place.

    ``bursts``: as ``usable_bursts`` returns them. ``probe``: the probe in its pipe. ``centre``: phi
    and z. ``after``: delay of the window, in seconds; phases still count from the wall.

    Notes
    -----
    The distance of the wall is a plane over the raster, fitted to the bursts farthest from the
    place: over the pit itself the first echo may be that of its floor.
    """
    angles = np.array([burst.angles for burst in bursts])
    spots = probe.spots(angles)
    x = probe.radius * wrapped(spots[:, 0] - centre[0])
    y = spots[:, 1] - centre[1]
    expected = 2 * spots[:, 2] / probe.speed
    far = np.argsort(-np.hypot(x, y))[: max(FAR, len(bursts) // 3)]
    first = [first_echo(bursts[n], float(expected[n])) for n in far]
    delay = np.array(first) - expected[far]
    found = np.isfinite(delay)
    if found.sum() < 5:
        return None
    plane = np.stack([np.ones(len(x)), x, y], axis=1)
    chosen = far[found]
    fitted = least_deviations(plane[chosen], delay[found])
    delays = plane @ fitted
    spectra = np.array(
        [
            _spectrum(burst, float(t), after)
            for burst, t in zip(bursts, expected + delays, strict=True)
        ]
    )
    window = tapered(round(WINDOW / bursts[0].sample_interval))
    noise = np.array([burst.noise for burst in bursts]) * np.sqrt((window**2).sum() / 2)
    beyond = 0.5 * probe.speed * delays
    return Spectra(spectra, np.maximum(noise, 1e-9), angles, beyond)


def first_echo(burst: Burst, expected: float) -> float:
    """Return the time of the envelope of the first echo about a time; NaN without one."""
    gate = (expected - 1.2e-6, expected + 1.2e-6)
    echoes = find_echoes(burst.trace, burst.sample_interval, Pulse(), gate=gate, fine=False)
    return echoes[0].time if echoes else np.nan


def least_deviations(design: FloatArray, values: FloatArray) -> FloatArray:
    """Solve by least absolute deviations, with reweighted least squares."""
    weights = np.ones(len(values))
    solution: FloatArray = np.zeros(design.shape[1])
    for _ in range(12):
        root = np.sqrt(weights)
        solved = np.linalg.lstsq(design * root[:, None], values * root, rcond=1e-6)[0]
        solution = solved.astype(np.float64)
        weights = 1 / np.maximum(np.abs(values - design @ solution), 3e-9)
    return solution


def _spectrum(burst: Burst, at: float, after: float) -> ComplexArray:
    interval = burst.sample_interval
    count = round(WINDOW / interval)
    start = round((at - LEAD + after) / interval)
    piece = np.zeros(count)
    source = np.arange(start, start + count)
    inside = (source >= 0) & (source < burst.trace.size)
    piece[inside] = burst.trace[source[inside]]
    f = np.arange(LOWEST, HIGHEST + 1.0, RESOLUTION)
    t = source * interval - at
    turned: ComplexArray = (piece * tapered(count)) @ np.exp(2j * np.pi * t[:, None] * f)
    return turned


def tapered(count: int) -> FloatArray:
    """Return a Tukey window (count,), whose two cosine flanks are a share ``_TAPER`` of it."""
    last = count - 1
    flank = int(_TAPER * last / 2)
    n = np.arange(count, dtype=np.float64)
    window = np.ones(count)
    window[: flank + 1] = 0.5 * (1 + np.cos(np.pi * (-1 + 2 * n[: flank + 1] / _TAPER / last)))
    fall = n[last - flank :]
    window[last - flank :] = 0.5 * (
        1 + np.cos(np.pi * (-2 / _TAPER + 1 + 2 * fall / _TAPER / last))
    )
    return window


FROZEN = "frozen"
SHORT, FEW, SMALL, _MISSING = "too short", "too few echoes", "raster too small", "part missing"
ONE_PLACE, BESIDE = "all at one place", "raster beside the mouth"
_FEWEST_INSIDE, _FEWEST_OUTSIDE = 3, 5
_INSIDE, _BESIDE, _ONE = 0.4e-3, 0.2e-3, 0.1e-3
"""Smallest radius that counts as inside a mouth, least distance of plain wall from its rim, and
smallest distance between two places, in metres. A footprint is 1 mm wide."""


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

    ``bursts``: usable ones; ``probe``: the probe in its pipe; ``centre``: phi and z of the mouth;
    ``diameter``: of the mouth, in metres; ``whole``: whether these are all planned bursts.
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
