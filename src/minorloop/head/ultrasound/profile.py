"""The profile of the flooded wall from a sweep of bursts, and where the water ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.head.ultrasound.echoes import Burst, Echo, find_echoes
from minorloop.head.ultrasound.field import CalibratedProbe

_LEAST = 0.02
_SLACK = 1.5e-3
_JITTER = 7e-9
"""Scatter of the time of an echo at a signal-to-noise ratio of 1, in seconds."""
_AIM = 5e-6


@dataclass(frozen=True, eq=False)
class Profile:
    """Distance of the wall beyond nominal, echo by echo.

    Parameters
    ----------
    spots : (K, 2) array
        Phi and z where each beam met the nominal wall.
    depths, sds : (K,) arrays
        In metres; NaN where no wall was heard.
    heard : (K,) array of bool
        Where it was.
    offset : (2,) array
        How far the pivot was found off where it was thought, along x and y, in metres.
    """

    spots: FloatArray
    depths: FloatArray
    sds: FloatArray
    heard: BoolArray
    offset: FloatArray


def wall_profile(bursts: Sequence[Burst], ear: CalibratedProbe) -> Profile:
    """The profile of the wall from bursts of one sweep.

    Parameters
    ----------
    bursts : sequence of Burst
        Those with a verdict count as not heard.
    ear : CalibratedProbe
        The probe and how it is mounted, the roll included; give one ear a roll to ``joined``
        profiles of a sweep round the pipe.

    Notes
    -----
    The distance is that of the first echo near the wall, the beam taken as meeting the wall
    squarely up to the cosine of its incidence. The profile is as it comes: see ``centred`` for
    what a pivot off its place adds.
    """
    angles = np.array([burst.angles for burst in bursts]).reshape(-1, 2)
    sane = np.where(np.isfinite(angles), angles, 0.0)
    spots = ear.spots(sane)
    _, axes = ear.beams(sane)
    normals = np.stack([np.cos(spots[:, 0]), np.sin(spots[:, 0]), np.zeros(len(spots))], axis=1)
    facing = (axes * normals).sum(axis=1)
    depths, sds = np.full(len(spots), np.nan), np.full(len(spots), np.nan)
    for n, burst in enumerate(bursts):
        gate = tuple(2 * (spots[n, 2] + side) / ear.speed for side in (-_SLACK, _SLACK))
        echoes = () if burst.verdict else _echoes(burst, (gate[0], gate[1]))
        if echoes and echoes[0].amplitude >= _LEAST:
            depths[n] = facing[n] * (echoes[0].time * ear.speed / 2 - spots[n, 2])
            sds[n] = np.hypot(_JITTER / echoes[0].snr * ear.speed / 2, _AIM)
    return Profile(spots[:, :2], depths, sds, np.isfinite(depths), np.zeros(2))


def joined(profiles: Sequence[Profile]) -> Profile:
    """Several profiles as one."""
    return Profile(
        np.concatenate([p.spots for p in profiles]),
        np.concatenate([p.depths for p in profiles]),
        np.concatenate([p.sds for p in profiles]),
        np.concatenate([p.heard for p in profiles]),
        np.zeros(2),
    )


def centred(profile: Profile) -> Profile:
    """The profile without what a pivot off its place adds: a + b cos(phi) + c sin(phi).

    Notes
    -----
    Fitted by least absolute deviations, so that dents and pits stay. Left as it is where fewer
    than eight echoes, or less than a quarter turn, tell.
    """
    phi, values = profile.spots[profile.heard, 0], profile.depths[profile.heard]
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
    return Profile(profile.spots, profile.depths - waves, profile.sds, profile.heard, -solution[1:])


def _echoes(burst: Burst, gate: tuple[float, float]) -> tuple[Echo, ...]:
    return find_echoes(burst.trace, burst.sample_interval, gate=gate)
