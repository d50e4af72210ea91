"""The profile of the flooded wall from a sweep of bursts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.ultrasound.echoes import Burst, Echo, find_echoes
from minorloop_head.ultrasound.field import CalibratedProbe

_LEAST, _SLACK = 6.0, 1.5e-3
"""Least echo of the wall over the noise, and its largest distance from nominal, in metres. Noise
alone has peaks of 4 to 5 within that distance, and one above the water puts its surface there."""
_JITTER = 7e-9
"""Scatter of the time of an echo at a signal-to-noise ratio of 1, in seconds."""
_AIM = 5e-6
"""Error of the distance by the aim of the beam, in metres."""


@dataclass(frozen=True, eq=False)
class Profile:
    """Distance of the wall beyond the nominal radius, echo by echo."""

    spots: FloatArray
    """Shape (K, 2). Phi and z where each beam meets the nominal wall."""
    depths: FloatArray
    sds: FloatArray
    """Shape (K,). In metres; NaN without an echo of the wall."""
    detected: BoolArray
    """Shape (K,). Where there is an echo of the wall."""
    offset: FloatArray
    """Shape (2,). Estimated error of the place of the pivot, along x and y, in metres."""


def wall_profile(bursts: Sequence[Burst], probe: CalibratedProbe) -> Profile:
    """Return the profile of the wall from the bursts of one sweep.

    ``bursts``: those with a verdict count as without an echo. ``probe``: the probe and its mount,
    which contains the roll. For a sweep round the pipe, make one profile for each roll, and join
    them with ``joined``.

    Notes
    -----
    The distance is that of the first echo near the wall, times the cosine of its incidence.
    ``centred`` corrects for an error of the place of the pivot.
    """
    angles = np.array([burst.angles for burst in bursts]).reshape(-1, 2)
    sane = np.where(np.isfinite(angles), angles, 0.0)
    spots = probe.spots(sane)
    _, axes = probe.beams(sane)
    normals = np.stack([np.cos(spots[:, 0]), np.sin(spots[:, 0]), np.zeros(len(spots))], axis=1)
    facing = (axes * normals).sum(axis=1)
    depths, sds = np.full(len(spots), np.nan), np.full(len(spots), np.nan)
    for n, burst in enumerate(bursts):
        gate = tuple(2 * (spots[n, 2] + side) / probe.speed for side in (-_SLACK, _SLACK))
        echoes = () if burst.verdict else _echoes(burst, (gate[0], gate[1]))
        if echoes and echoes[0].snr >= _LEAST:
            depths[n] = facing[n] * (echoes[0].time * probe.speed / 2 - spots[n, 2])
            sds[n] = np.hypot(_JITTER / echoes[0].snr * probe.speed / 2, _AIM)
    return Profile(spots[:, :2], depths, sds, np.isfinite(depths), np.zeros(2))


def joined(profiles: Sequence[Profile]) -> Profile:
    """Join several profiles into one; it is empty without any."""
    empty = Profile(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0, bool), np.zeros(2))
    parts = [empty, *profiles]
    return Profile(
        np.concatenate([p.spots for p in parts]),
        np.concatenate([p.depths for p in parts]),
        np.concatenate([p.sds for p in parts]),
        np.concatenate([p.detected for p in parts]),
        np.zeros(2),
    )


def centred(profile: Profile) -> Profile:
    """Return the profile without the effect of a misplaced pivot: a + b cos(phi) + c sin(phi).

    Notes
    -----
    Fitted by least absolute deviations, so that dents and pits stay. The profile is unchanged if
    there are fewer than eight echoes, or if they cover less than a quarter turn.
    """
    phi, values = profile.spots[profile.detected, 0], profile.depths[profile.detected]
    spread = 1 - abs(np.exp(1j * phi).mean()) if phi.size else 0.0
    if phi.size < 8 or spread < 0.03:
        return profile
    design = np.stack([np.ones(phi.size), np.cos(phi), np.sin(phi)], axis=1)
    weights = np.ones(phi.size)
    solution = np.zeros(3)
    for _ in range(20):
        root = np.sqrt(weights)
        solution = np.linalg.lstsq(design * root[:, None], values * root, rcond=None)[0]
        weights = 1 / np.maximum(np.abs(values - design @ solution), 1e-6)
    around = profile.spots[:, 0]
    waves = solution[0] + solution[1] * np.cos(around) + solution[2] * np.sin(around)
    return Profile(
        profile.spots, profile.depths - waves, profile.sds, profile.detected, -solution[1:]
    )


def _echoes(burst: Burst, gate: tuple[float, float]) -> tuple[Echo, ...]:
    return find_echoes(burst.trace, burst.sample_interval, gate=gate)
