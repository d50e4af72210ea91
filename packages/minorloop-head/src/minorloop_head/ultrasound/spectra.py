"""Spectra of averaged traces, of the window that contains the echoes of a wall and a pit in it."""

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
"""Share of the window over which it rises and falls."""
FAR = 10
"""Number of traces far from a pit that give the place of the wall and the pulse."""


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

    ``bursts``: as ``usable_bursts`` returns them. ``probe``: the probe and what is known of the
    pipe. ``centre``: phi and z. ``after``: delay of the window, in seconds; phases count from the
    wall all the same.

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
    """Return a Tukey window (count,), whose cosine flanks are ``_TAPER`` of it together."""
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
