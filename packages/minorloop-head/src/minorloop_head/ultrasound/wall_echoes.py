"""Echoes of the wall in the bursts of a sweep: their depths and amplitudes; profile of the wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.geometry import wall_point
from minorloop_head.ultrasound.echoes import (
    DEAD_TIME,
    Burst,
    Echo,
    Pulse,
    find_echoes,
    matched,
    vertex,
)
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.spectra import least_deviations

Indices = npt.NDArray[np.intp]
PULSE = 0.1e-3
"""Length of a pulse in metres of depth, two standard deviations of its envelope: nearer echoes
merge."""
_BEFORE, _BEYOND = 0.8e-3, 1.4e-3
"""Window of the strongest echo before and beyond the wall in metres, for beads and for the deepest
measured pit."""
_LEAST_SNR = 5.0
"""Least amplitude of an echo over the noise: noise alone reaches it once in 5,000 bursts."""
_RINGING = 0.15
"""Least amplitude of the echo of a surface over that of a plain wall. The echo of the back of a
steel wall is (1 - R^2) / R = 0.13 of it, with the reflection coefficient R of steel in water."""
_ABOUT = 36
"""Number of bursts whose median is the wall about one of them: a disc 1.6 mm wide, of which a crack
of 0.3 mm takes a quarter."""
_FLAT, _MOST = 0.04e-3, 0.75
"""Largest depth in metres of the wall about a crack, a quarter of a wavelength, and least share of
the wall below it. The flanks of dents and beads weaken the echo too."""
BESIDE = 9
"""Bursts within 0.4 mm of one of them."""


@dataclass(frozen=True, eq=False)
class SweptBurst:
    """A burst of a sweep."""

    t: float
    """Its time, in seconds."""
    place: FloatArray
    """Shape (2,). Measured advance and roll of the catheter, in metres and radians."""
    spot: FloatArray
    """Shape (3,). Phi and z where the beam meets the nominal wall, and its distance along the beam,
    by the measured angles."""
    burst: Burst
    """Mean of its shots, with measured pan and tilt."""


@dataclass(frozen=True, eq=False)
class WallEchoes:
    """Echoes of the bursts of a sweep."""

    spots: FloatArray
    """Shape (N, 2). Phi and z."""
    depth: FloatArray
    """Shape (N,). Depth of the strongest echo below the wall, in metres; NaN without one loud
    enough for a surface."""
    amplitude: FloatArray
    """Shape (N,). Amplitude of the echo at the distance of the wall about it, over the usual one;
    NaN if the trace is too short."""
    strongest: FloatArray
    snr: FloatArray
    """Shape (N,). Amplitude of the strongest echo over the usual one, and over noise."""
    near: Indices
    """Shape (N, K). The nearest bursts to each, itself first."""

    @property
    def lost(self) -> FloatArray:
        """(N,) missing share of the amplitude about each."""
        return 1 - self.amplitude / np.maximum(_quantile(self.amplitude[self.near]), _RINGING)

    @property
    def flat(self) -> BoolArray:
        """(N,) whether most of the wall about each has no depth."""
        return _quantile(np.abs(self.depth[self.near]), _MOST) < _FLAT

    @property
    def scattered(self) -> BoolArray:
        """(N,) whether the wall reflects the beam elsewhere, or is the top of a bead.

        Neither is so at a crack, which is narrower than the beam.
        """
        return np.isnan(self.depth) | (self.depth < -_FLAT)

    @property
    def texture(self) -> FloatArray:
        """(N,) depth of each less the median depth of its neighbours."""
        return self.depth - _quantile(self.depth[self.near[:, :BESIDE]])


def beam_width(probe: CalibratedProbe, pulse: Pulse | None = None) -> float:
    """Return the width of the beam on the wall at half the amplitude of an echo, in metres.

    Notes
    -----
    1.02 c F / (f D) in the focus of a lens (Krautkraemer, Ultrasonic Testing of Materials, 1990);
    without a lens the width of the disc.
    """
    disc, frequency = probe.transducer, (pulse or Pulse()).frequency
    return min(1.02 * probe.speed * disc.focus / (frequency * disc.aperture), disc.aperture)


def wall_echoes(swept: Sequence[SweptBurst], probe: CalibratedProbe) -> WallEchoes:
    """Return the strongest echo of each burst, and the amplitude at the distance of the wall.

    Notes
    -----
    `pivot_wave` is subtracted from the distance of the wall: a misplaced pivot is no depth. The
    waves of a focused beam travel at angles t up to arctan(D / 2F), with the delay 2 d cos(t) / c;
    the mean over the disc is 1 - t^2 / 4.
    """
    spots = np.array([one.spot for one in swept]).reshape(-1, 3)
    heard = [_strongest(one, probe.speed) for one in swept]
    depth, loudest, snr = np.array([each[:3] for each in heard]).reshape(-1, 3).T
    found = snr >= _LEAST_SNR
    wave = pivot_wave(spots[found, 0], depth[found], spots[:, 0])
    if found.any():
        wave += np.median((depth - wave)[found])
    usual = float(np.median(loudest[found])) if found.any() else 1.0
    clear = found & (loudest >= _RINGING * usual)
    depth = np.where(clear, depth - wave, np.nan)
    near = _nearest(spots, probe.radius)
    about = np.nan_to_num(_quantile(depth[near]))
    wall = np.array(
        [
            _amplitude_at(one, each[3], distance, probe.speed) / usual
            for one, each, distance in zip(swept, heard, spots[:, 2] + wave + about, strict=True)
        ]
    ).reshape(-1)
    steepest = np.arctan(0.5 * probe.transducer.aperture / probe.transducer.focus)
    depth /= 1 - 0.25 * steepest**2
    return WallEchoes(spots[:, :2], depth, wall, loudest / usual, snr, near)


def _nearest(spots: FloatArray, radius: float) -> Indices:
    """Return the nearest bursts (N, K) to each, itself among them."""
    if not len(spots):
        return np.empty((0, 0), dtype=np.intp)
    points = wall_point(spots[:, 0], spots[:, 1], radius)
    count = min(_ABOUT, len(points))
    return np.asarray(cKDTree(points).query(points, k=count)[1]).reshape(len(points), count)


def _quantile(values: FloatArray, share: float = 0.5) -> FloatArray:
    """Return the median, or another quantile, of the finite values of each row; NaN without any."""
    some = np.isfinite(values).any(axis=1)
    found = np.full(len(values), np.nan)
    found[some] = np.nanquantile(values[some], share, axis=1)
    return found


def _strongest(one: SweptBurst, speed: float) -> tuple[float, float, float, FloatArray | None]:
    """Return depth, amplitude and ratio to noise of the strongest echo, and the envelope."""
    burst, distance = one.burst, float(one.spot[2])
    loud = np.abs(matched(burst.trace, burst.sample_interval, Pulse()))
    step = 0.5 * speed * burst.sample_interval
    first, last = (int((distance + side) / step) for side in (-_BEFORE, _BEYOND))
    quiet = loud[int(DEAD_TIME / burst.sample_interval) : first]
    if last > loud.size - 2 or quiet.size == 0:
        return np.nan, 0.0, 0.0, None
    noise = float(np.median(quiet)) / 1.1774  # of a Rayleigh distribution
    place, height = vertex(loud, first + int(np.argmax(loud[first:last])))
    return place * step - distance, height, height / max(noise, 1e-12), loud


def _amplitude_at(one: SweptBurst, loud: FloatArray | None, distance: float, speed: float) -> float:
    """Return the greatest amplitude within a pulse of a distance; NaN without an envelope."""
    if loud is None:
        return np.nan
    step = 0.5 * speed * one.burst.sample_interval
    first, last = (int((distance + side) / step) for side in (-PULSE, PULSE))
    return float(loud[first : last + 1].max(initial=0.0))


_LEAST, _SLACK = 6.0, 1.5e-3
"""Least echo of the wall over the noise, and its largest distance from nominal, in metres. Noise
alone has peaks of 4 to 5 within that distance; one above the water would set a wrong level."""
_JITTER = 7e-9
"""Scatter of the time of an echo at a signal-to-noise ratio of 1, in seconds."""
_AIM = 5e-6
"""Error of the distance from the aim of the beam, in metres."""


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
    which contains the roll. For a sweep round the pipe, make a profile for each roll, and join the
    profiles with ``joined``.

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
