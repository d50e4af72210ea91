"""Bursts from finite-difference echoes, through the estimator of depths, against the truth.

Twice, numbers differ from what the estimator assumes: disc, lens, pulse, speed and thickness of
the steel, temperature of the water, place of the head, and angles. The noise is that of the
receiver, the same for every pit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.judge import sound
from minorloop_head.geometry import Mount, Probe
from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.field import CalibratedProbe, sound_speed
from minorloop_head.ultrasound.pits import PitDepth, measure_pit, raster

RADIUS = 10e-3
DEPTHS, DIAMETERS = (0.3e-3, 0.5e-3, 0.75e-3, 0.99e-3), (0.6e-3, 0.9e-3, 1.2e-3, 1.5e-3)
"""Multiples of the cell of the grid, in metres."""
NOISE, SHOTS = 0.1, 16
"""Noise of a shot, as a share of the peak of the echo of a plain wall, and shots of a burst."""
SAMPLES, INTERVAL, STEPS, GAIN = 2048, 10e-9, 4096, 0.4
_ANGLE, _PIVOT, _PLACE, _SIZE = math.radians(0.05), 0.05e-3, 0.035e-3, 0.05
"""Standard deviations: of a reading of an angle in radians, of the known pivot and of the place by
the camera in metres, and of the size by the camera, relative."""
_FACET, _REACH = 0.055e-3, 1.5e-3
_WATER, _STEEL_DENSITY = 998.0, 7850.0
_LOSS = 25e-15
"""Absorption of water over the square of the frequency, in Np s^2/m (Pinkerton, 1949)."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What the estimator does not know."""

    temperature: float
    disc: sound.Disc
    frequency: float
    bandwidth: float
    skew: float
    steel: float
    damping: float
    thickness: float
    mount: Mount
    boresight: tuple[float, float]


def drawn(seed: int) -> Setup:
    """Draw a setup by seed."""
    rng = np.random.default_rng([seed, 2024])
    off = rng.uniform(-0.2e-3, 0.2e-3, 2)
    return Setup(
        temperature=20.0,
        disc=sound.Disc(
            aperture=5e-3 * float(rng.uniform(0.97, 1.0)),
            focus=8e-3 * float(rng.uniform(0.98, 1.02)),
            soft=float(rng.uniform(0.0, 0.3)),
        ),
        frequency=10e6 * float(rng.uniform(0.96, 1.04)),
        bandwidth=float(rng.uniform(0.54, 0.66)),
        skew=float(rng.uniform(-0.15, 0.15)),
        steel=float(rng.uniform(5700.0, 6000.0)),
        damping=float(rng.uniform(0.003, 0.015)),
        thickness=float(rng.uniform(1.8e-3, 4e-3)),
        mount=Mount(offset=(float(off[0]), float(off[1])), roll=float(rng.normal(0, 0.02))),
        boresight=(float(rng.normal(0, 2e-3)), float(rng.normal(0, 2e-3))),
    )


@dataclass(frozen=True, eq=False)
class Mouth:
    """Answer of a pit to pressures on its mouth: a matrix (N, N, F) for each order of waves."""

    radius: float
    degree: int
    matrices: tuple[np.ndarray, ...]


def mouth_of(radius: float, depth: float, speed: float, folder: Path | None = None) -> Mouth:
    """Return the answer of a pit, kept in a folder if one is given."""
    degree = math.ceil(2 * math.pi * 14e6 / speed * radius * 0.34) + 3
    path = None
    if folder is not None:
        path = folder / f"pit-{1e6 * radius:.0f}-{1e6 * depth:.0f}-{speed:.1f}.npz"
        if path.exists():
            with np.load(path) as kept:
                return Mouth(radius, degree, tuple(kept[f"m{n}"] for n in range(degree + 1)))
    found = tuple(sound.admittance(m, radius, depth, speed, degree) for m in range(degree + 1))
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, **{f"m{n}": each for n, each in enumerate(found)})
    return Mouth(radius, degree, found)


def pit_echo(mouth: Mouth, pressure: np.ndarray) -> np.ndarray:
    """Return the echo (F,) of a mouth for the pressure (Q, F) of the beam on `disc_points`."""
    echo = np.zeros(pressure.shape[1], dtype=complex)
    for order, matrix in enumerate(mouth.matrices):
        for form in _forms(order, mouth.degree):
            parts = 2 * mouth.radius * form @ pressure
            echo += np.einsum("nf,nmf,mf->f", parts, matrix, parts)
    return echo


@lru_cache(maxsize=64)
def _forms(order: int, degree: int) -> tuple[np.ndarray, ...]:
    """Return the polynomials times areas (N, Q) of an order, with cosine and sine."""
    _, weights, r, turn = disc_points()
    shapes = sound.polynomials(order, degree, r) * weights
    return tuple(shapes * wave(order * turn) for wave in (np.cos, np.sin)[: 2 if order else 1])


def disc_points() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return points (Q, 2) of the unit disc, their areas, radii and angles."""
    nodes, share = np.polynomial.legendre.leggauss(18)
    count = 60
    radii, turn = 0.5 * (nodes + 1), 2 * np.pi * np.arange(count) / count
    r, a = (g.ravel() for g in np.meshgrid(radii, turn, indexing="ij"))
    weights = np.repeat(0.5 * share * radii * 2 * np.pi / count, count)
    return np.stack([r * np.cos(a), r * np.sin(a)], axis=1), weights, r, a


def plate(thickness: float, setup: Setup) -> np.ndarray:
    """Return the reflection (F,) of a plate of steel with air behind it, at right angles."""
    f = sound.frequencies()
    ratio = _STEEL_DENSITY * setup.steel / (_WATER * sound_speed(setup.temperature))
    front = (ratio - 1) / (ratio + 1)
    turn = np.exp(-4j * np.pi * f * max(thickness, 0.1e-3) / setup.steel * (1 - 1j * setup.damping))
    return (front - turn) / (1 - front * turn)


def pulse(setup: Setup) -> np.ndarray:
    """Return the spectrum (F,) of the pulse after 16 mm of water."""
    f = sound.frequencies()
    width = setup.bandwidth * setup.frequency / 2 / math.sqrt(2 * math.log(2))
    x = (f - setup.frequency) / width
    ends = np.clip(np.minimum(f - sound.LOWEST, sound.HIGHEST - f) / 2e6, 0, 1)
    shape = np.exp(-0.5 * x * x - 1j * setup.skew * x * x - _LOSS * f * f * 16e-3)
    return shape * np.sin(np.pi / 2 * ends) ** 2


class Bench:
    """A disc before the wall of a pipe with one pit, or none.

    Parameters
    ----------
    setup : Setup
    pit : (Mouth, Mouth, float), optional
        The answers of the pit and of one without a floor, and its depth.
    """

    def __init__(self, setup: Setup, pit: tuple[Mouth, Mouth, float] | None) -> None:
        self.setup, self.pit = setup, pit
        self.speed = sound_speed(setup.temperature)
        self.field = sound.field_of(setup.disc, self.speed, 7.1e-3, 9.1e-3, 2.4e-3)
        self.probe = Probe()
        steps = np.arange(-_REACH, _REACH + _FACET / 2, _FACET)
        x, y = (g.ravel() for g in np.meshgrid(steps, steps))
        away = np.hypot(x, y)
        self._facets = x, y
        edge = np.clip((away / _REACH - 0.75) / 0.25, 0, 1)
        self._area = _FACET**2 * np.cos(np.pi / 2 * edge) ** 2  # no edge that would echo

    def echo(self, pan: float, tilt: float) -> np.ndarray:
        """Return the spectrum (F,) at true angles; phases count from ``field.grid[1]``."""
        aside = self.setup.boresight
        origin, axis = self.probe.beam(self.setup.mount, pan + aside[0], tilt + aside[1])
        b, a = origin[:2] @ axis[:2], axis[:2] @ axis[:2]
        s = (-b + math.sqrt(b * b - a * (origin[:2] @ origin[:2] - RADIUS**2))) / a
        spot = origin + s * axis
        phi, z = math.atan2(spot[1], spot[0]), spot[2]
        x, y = self._facets
        p, v = self._pressure(origin, axis, phi + x / RADIUS, z + y)
        wall = -2 * self._area @ (p * v)
        front = plate(self.setup.thickness, self.setup)
        if self.pit is None:
            return wall * front
        whole, hollow, depth = self.pit
        unit = disc_points()[0] * whole.radius
        p, _ = self._pressure(origin, axis, unit[:, 0] / RADIUS, unit[:, 1])
        open_ = pit_echo(hollow, p)
        floor = pit_echo(whole, p) - open_
        return (wall + open_) * front + floor * plate(self.setup.thickness - depth, self.setup)

    def _pressure(
        self, origin: np.ndarray, axis: np.ndarray, phi: np.ndarray, z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        out = np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=1)
        points = RADIUS * out
        points[:, 2] = z
        return self.field.at(origin, axis, points, out)

    def trace(self, spectrum: np.ndarray) -> np.ndarray:
        """Return the trace (T,) of a spectrum, without noise."""
        f, middle = sound.frequencies(), 2 * self.field.grid[1] / self.speed
        t = INTERVAL * np.arange(SAMPLES) - middle
        inside = (t > -0.7e-6) & (t < 1 / sound.RESOLUTION - 0.7e-6)
        found = np.zeros(SAMPLES)
        turn = np.exp(2j * np.pi * t[inside, None] * f)
        found[inside] = (turn @ (spectrum * pulse(self.setup))).real
        return found


def measured(
    seed: int, diameter: float, depth: float, folder: Path | None, noise: float = NOISE
) -> PitDepth:
    """Scan a pit at phi 0, z 0 with a setup by seed, and return its estimated depth."""
    setup = drawn(seed)
    rng = np.random.default_rng([seed, round(1e6 * diameter), round(1e6 * depth)])
    speed = sound_speed(setup.temperature)
    mouths = (mouth_of(diameter / 2, d, speed, folder) for d in (depth, math.inf))
    bench = Bench(setup, (*mouths, depth))
    straight = bench.probe.aim(setup.mount, np.array([RADIUS, 0.0, 0.0]))
    plain = Bench(setup, None)
    scale = np.abs(plain.trace(plain.echo(*straight))).max()
    known = replace(
        setup.mount,
        offset=tuple((np.array(setup.mount.offset) + _PIVOT * rng.standard_normal(2)).tolist()),
    )
    probe = CalibratedProbe(
        Probe(),
        known,
        radius=RADIUS,
        thickness=setup.thickness * float(rng.uniform(0.97, 1.03)),
        temperature=setup.temperature + float(rng.normal(0, 0.3)),
    )
    centre = tuple((_PLACE * rng.standard_normal(2) / [RADIUS, 1.0]).tolist())
    bursts = []
    for n, (pan, tilt) in enumerate(raster(probe, centre)):
        clean = bench.trace(bench.echo(float(pan), float(tilt))) / scale
        shots = []
        for k in range(SHOTS):
            noisy = GAIN * (clean + noise * rng.standard_normal(SAMPLES))
            counts = np.clip(np.round(noisy * STEPS / 2), -STEPS // 2, STEPS // 2 - 1)
            shots.append(Shot(1e-3 * (SHOTS * n + k), counts / (STEPS / 2), INTERVAL))
        read = np.array([pan, tilt]) + _ANGLE * rng.standard_normal(2)
        bursts.append(average(shots, np.tile(read, (SHOTS, 1)), np.zeros(SHOTS)))
    size = diameter * math.exp(_SIZE * rng.standard_normal())
    return measure_pit(bursts, probe, centre, size)


def figures(errors: Sequence[float | None]) -> dict[str, Any]:
    """Return bias and standard deviation of depths in micrometres; None is one not measured."""
    found = 1e6 * np.array([error for error in errors if error is not None])
    return {
        "bias_um": float(found.mean()) if found.size else math.nan,
        "sd_um": float(found.std(ddof=1)) if found.size > 1 else math.nan,
        "worst_um": float(np.abs(found).max()) if found.size else math.nan,
        "measured_fraction": found.size / len(errors),
        "scans": len(errors),
    }
