"""The profile of the flooded wall from a sweep of bursts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.ultrasound.echoes import Burst, Echo, find_echoes
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.spectra import least_deviations

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

    @property
    def detected(self) -> BoolArray:
        """(K,) whether there is an echo of the wall."""
        return np.isfinite(self.depths)


def wall_profile(bursts: Sequence[Burst], probe: CalibratedProbe) -> Profile:
    """Return the profile of the wall from the bursts of one sweep.

    ``bursts``: those with a verdict count as without an echo. ``probe``: the probe and its mount,
    which contains the roll. For a sweep round the pipe, make one profile for each roll, and join
    them with ``joined``.

    Notes
    -----
    The distance is that of the first echo near the wall, times the cosine of its incidence.
    `centred` corrects for an error of the place of the pivot.
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
    return Profile(spots[:, :2], depths, sds)


def joined(profiles: Sequence[Profile]) -> Profile:
    """Join several profiles into one; it is empty without any."""
    parts = [Profile(np.empty((0, 2)), np.empty(0), np.empty(0)), *profiles]
    return Profile(
        np.concatenate([p.spots for p in parts]),
        np.concatenate([p.depths for p in parts]),
        np.concatenate([p.sds for p in parts]),
    )


def centred(profile: Profile) -> Profile:
    """Return the profile without the effect of a misplaced pivot."""
    found, around = profile.detected, profile.spots[:, 0]
    wave = pivot_wave(around[found], profile.depths[found], around)
    return Profile(profile.spots, profile.depths - wave, profile.sds)


def pivot_wave(phi: FloatArray, depths: FloatArray, around: FloatArray) -> FloatArray:
    """Return the depths (N,) that a misplaced pivot adds at angles around (N,), in metres.

    Notes
    -----
    a + b cos(phi) + c sin(phi), fitted to depths (K,) of echoes at phi (K,) by least absolute
    deviations, so that dents and pits stay. It is zero if there are fewer than eight echoes, or if
    they cover less than a quarter turn.
    """
    spread = 1 - abs(np.exp(1j * phi).mean()) if phi.size else 0.0
    if phi.size < 8 or spread < 0.03:
        return np.zeros(len(around))
    waves: FloatArray = _waves(around) @ least_deviations(_waves(phi), depths)
    return waves


def _waves(phi: FloatArray) -> FloatArray:
    return np.stack([np.ones(phi.size), np.cos(phi), np.sin(phi)], axis=1)


def _echoes(burst: Burst, gate: tuple[float, float]) -> tuple[Echo, ...]:
    return find_echoes(burst.trace, burst.sample_interval, gate=gate)
