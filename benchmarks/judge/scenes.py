"""Random scenes of a pipe wall, with and without a through-hole, as triangles and textures.

Nothing here is imported from the twins. Lengths are in millimetres. The pipe's axis is z, a place
of the wall is (phi, z). The camera looks along its own z axis, x right and y down; a head that
pans and tilts about its pivot turns it by Rz(roll) Ry(pan) Rx(tilt), as the documentation of
``minorloop_head.geometry`` defines it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import ndimage

RADIUS, THICKNESS = 10.0, 2.0
LEVER = 8.0
WIDTH, HEIGHT, FOCAL, K1, K2 = 640, 480, 520.0, -0.12, 0.02
LED_CIRCLE = 2.5
"""The documented pipe, head, lens and ring of LEDs."""
START, END = -15.0, 55.0
"""Ends of the wall that is modelled. The camera sees none of it from beyond."""
STEP = 0.1
"""Of the triangles. A dimple is at least 0.8 mm wide, and the chord of a step is 0.1 um off."""
TEXEL = 0.04
FINE = 0.01
"""Step of the course of a crack."""
LEAST_AXIS, MARGIN = 18.0, 70.0
"""Least minor axis of the image of a hole and its least distance from the edge, in pixels: those
for which the recall of our own scenes is required."""

METALS = {
    "steel": (2.9, 3.1),
    "chromium": (3.2, 3.3),
    "copper": (0.95, 2.6),
    "aluminium": (0.96, 6.7),
    "titanium": (2.4, 3.2),
}
"""Refractive index and extinction of clean metals near 550 nm (Rakic et al., Appl. Opt. 37, 5271,
1998; Johnson and Christy, Phys. Rev. B 9, 5056, 1974), rounded."""
KINDS = ("bare", "worn", "corroded")
INSIDES = ("dark", "backlit", "soil")
MARKED_INSIDES = (*INSIDES, "bright")
HOLE, NONE, MARKED_HOLE, MARKED, CRACK = "hole", "none", "marked-hole", "marked", "crack"
PLAIN, WITH_MARKS = (HOLE, NONE), (MARKED_HOLE, MARKED)
CONTENTS = (*PLAIN, *WITH_MARKS, CRACK)
"""What a scene shows: a hole or none; the same among marks that resemble holes and cracks; a crack,
on every other wall among such marks."""
NARROWEST, WIDEST = 0.03, 0.3
SHORTEST, LONGEST = 2.0, 15.0
"""Widths and lengths of cracks."""


@dataclass(frozen=True, eq=False)
class Hole:
    """A drilled hole: place, diameter of its mouth, chamfer, and what is in it."""

    phi: float
    z: float
    diameter: float
    inside: str
    chamfer: float = 0.0
    chamfer_depth: float = 0.0
    recess: float = 0.0
    unevenness: float = 0.0
    albedo: float = 0.1
    light: float = 0.0

    @property
    def mouth(self) -> float:
        """Diameter half way down the chamfer: both of its edges may be the one that is seen."""
        return self.diameter + self.chamfer


@dataclass(frozen=True, eq=False)
class Groove:
    """A crack: a groove with a V for its section, narrower at its tips."""

    course: np.ndarray
    """(N, 2) of phi and z."""
    widths: np.ndarray
    """(N,) at the surface."""
    slope: float
    """Depth over half of the width."""

    @property
    def width(self) -> float:
        """Median width."""
        return float(np.median(self.widths))


@dataclass(frozen=True, eq=False)
class Deposit:
    """A raised round deposit of one reflectance."""

    phi: float
    z: float
    radius: float
    height: float
    albedo: float
    ragged: float


@dataclass(frozen=True, eq=False)
class Bead:
    """A sphere of spatter that is partly sunk in the wall."""

    phi: float
    z: float
    radius: float
    height: float
    soiled: bool
    alpha: float


@dataclass(frozen=True, eq=False)
class Scene:
    """One view of a wall, and its truth."""

    seed: int
    kind: str
    metal: str
    hole: Hole | None
    place: tuple[float, float]
    pan: float
    tilt: float
    roll: float
    advance: float
    offset: tuple[float, float]
    focal: float
    centre: tuple[float, float]
    k1: float
    k2: float
    strengths: tuple[float, ...]
    focus: float
    brightness: float
    alphas: tuple[float, float]
    beads: tuple[Bead, ...] = ()
    dimples: tuple[tuple[float, float, float, float], ...] = ()
    texture_seed: int = 0
    groove: Groove | None = None
    deposits: tuple[Deposit, ...] = ()
    weld: tuple[float, float, float] | None = None
    """Distance of a weld round the pipe from the place, its width, and the pitch of its ripples."""
    blotches: int = 0
    content: str = HOLE
    known: dict[str, float] = field(default_factory=dict)

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) from the camera to the pipe."""
        return _turn_z(self.roll) @ _turn_y(self.pan) @ _turn_x(self.tilt)

    @property
    def lens(self) -> np.ndarray:
        """(3,) place of the lens."""
        return np.array([*self.offset, self.advance]) + LEVER * self.rotation[:, 2]

    @property
    def leds(self) -> np.ndarray:
        """(3, 3) places of the LEDs in the camera: the first below the lens, then every 120."""
        angle = np.pi / 2 + 2 * np.pi * np.arange(3) / 3
        return LED_CIRCLE * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of points (..., 3) of the pipe."""
        local = (points - self.lens) @ self.rotation
        plain = local[..., :2] / local[..., 2:]
        square = (plain**2).sum(axis=-1, keepdims=True)
        return self.focal * plain * (1 + self.k1 * square + self.k2 * square**2) + self.centre

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Return directions (..., 3) in the camera, with z = 1, of pixels (..., 2)."""
        wanted = (pixels - np.array(self.centre)) / self.focal
        plain = wanted.copy()
        for _ in range(12):  # converges by a factor of 5 a step for this lens
            square = (plain**2).sum(axis=-1, keepdims=True)
            plain = wanted / (1 + self.k1 * square + self.k2 * square**2)
        return np.concatenate([plain, np.ones((*plain.shape[:-1], 1))], axis=-1)


def wall(phi: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return points (..., 3) of the wall."""
    phi, z = np.broadcast_arrays(phi, z)
    return np.stack([RADIUS * np.cos(phi), RADIUS * np.sin(phi), z], axis=-1)


def meet(start: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return phi, z and distance where a ray from inside meets the wall."""
    a = (way[..., :2] ** 2).sum(axis=-1)
    b = (way[..., :2] * start[..., :2]).sum(axis=-1)
    c = (start[..., :2] ** 2).sum(axis=-1) - RADIUS**2
    s = (-b + np.sqrt(b * b - a * c)) / a
    point = start + s[..., None] * way
    return np.arctan2(point[..., 1], point[..., 0]), point[..., 2], s


def draw(seed: int, content: str) -> Scene:
    """Draw a scene by seed; kinds of wall follow each other."""
    with_hole = content in (HOLE, MARKED_HOLE)
    key = [seed, int(with_hole), 4711]
    rng = np.random.default_rng(key if content in PLAIN else [*key, CONTENTS.index(content)])
    insides = MARKED_INSIDES if content == MARKED_HOLE else INSIDES
    while True:
        scene = _try(rng, seed, KINDS[seed % 3], insides, with_hole)
        if scene is not None and content == CRACK:
            scene = _cracked(rng, scene)
        if scene is None:
            continue
        marked = content in WITH_MARKS or (content == CRACK and seed % 2)
        return replace(_marked(rng, scene) if marked else scene, content=content)


def _marked(rng: np.random.Generator, scene: Scene) -> Scene:
    """Return a scene with deposits, blotches and, in two of five, a weld."""
    deposits = []
    while len(deposits) < 3:
        radius = float(rng.uniform(0.3, 0.8))
        x, y = rng.uniform(-7, 7, 2)
        if math.hypot(x, y) < radius + 1.0:
            continue
        deposits.append(
            Deposit(
                scene.place[0] + x / RADIUS, scene.place[1] + y, radius,
                radius * float(rng.uniform(0.15, 0.6)), float(rng.uniform(0.2, 0.8)),
                float(rng.uniform(0.0, 0.2)),
            )
        )  # fmt: skip
    weld = None
    if rng.random() < 0.4:
        off = float(rng.choice([-1, 1]) * rng.uniform(2.5, 6.0))
        weld = (off, float(rng.uniform(1.5, 4.0)), float(rng.uniform(0.3, 1.0)))
    count = int(rng.integers(3, 9))
    return replace(scene, deposits=tuple(deposits), weld=weld, blotches=count)


def _cracked(rng: np.random.Generator, scene: Scene) -> Scene | None:
    """Return a scene with a crack near its place; None if less than 2 mm of it is seen."""
    length = float(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
    steps = max(round(length / 0.4), 5)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.12, steps))
    heading += rng.normal(0, 0.3, steps)
    corners = np.cumsum(0.4 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
    along = np.arange(0, 0.4 * (steps - 1), FINE)
    x, y = (np.interp(along, 0.4 * np.arange(steps), each) for each in corners.T)
    smooth = np.stack([ndimage.gaussian_filter1d(each, 0.2 / FINE) for each in (x, y)], axis=1)
    smooth -= smooth[len(smooth) // 2] + rng.uniform(-0.5, 0.5, 2)
    width = float(np.exp(rng.uniform(np.log(NARROWEST), np.log(WIDEST))))
    uneven = np.exp(0.15 * rng.standard_normal(steps))
    widths = width * np.interp(along, 0.4 * np.arange(steps), uneven)
    end = np.minimum(along, along[-1] - along)
    widths *= 0.3 + 0.7 * np.clip(end / 0.6, 0, 1)
    course = smooth / [RADIUS, 1.0] + scene.place
    points = wall(*course.T)
    pixels = scene.pixels(points)
    seen = ((pixels > 12) & (pixels < [WIDTH - 12, HEIGHT - 12])).all(axis=1)
    seen &= ((points - scene.lens) @ scene.rotation)[:, 2] > 1.0
    if seen.mean() < 0.5 or seen.sum() * FINE < SHORTEST:
        return None
    groove = Groove(course, widths, float(np.exp(rng.uniform(np.log(1.0), np.log(5.0)))))
    return replace(scene, groove=groove)


def _try(
    rng: np.random.Generator, seed: int, kind: str, insides: tuple[str, ...], with_hole: bool
) -> Scene | None:
    away, way = math.radians(rng.uniform(18, 30)), rng.uniform(0, 2 * np.pi)
    side, off = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1.0)
    pan, tilt = away * math.cos(way), away * math.sin(way)
    lens_error = rng.uniform(0.9, 1.1, 3)
    common = {
        "seed": seed,
        "kind": kind,
        "metal": str(rng.choice(list(METALS))),
        "pan": pan,
        "tilt": tilt,
        "roll": float(rng.uniform(-np.pi, np.pi)),
        "advance": float(rng.uniform(0, 4)),
        "offset": (float(off * np.cos(side)), float(off * np.sin(side))),
        "focal": FOCAL * float(lens_error[0]),
        "centre": (319.5 + float(rng.uniform(-6, 6)), 239.5 + float(rng.uniform(-6, 6))),
        "k1": K1 * float(lens_error[1]),
        "k2": K2 * float(lens_error[2]),
        "strengths": tuple(rng.uniform(0.9, 1.1, 3).tolist()),
        "brightness": float(np.exp(rng.uniform(np.log(0.7), np.log(1.4)))),
        "alphas": _alphas(rng, kind),
        "texture_seed": int(rng.integers(2**31)),
        "known": {
            "focal": float(rng.uniform(-1e-3, 1e-3)),
            "pivot": float(rng.uniform(0, 2 * np.pi)),
            "pan": math.radians(0.05) * float(rng.standard_normal()),
            "tilt": math.radians(0.05) * float(rng.standard_normal()),
        },
    }
    bare = Scene(**common, hole=None, place=(0.0, 0.0), focus=15.0)
    pixel = rng.uniform([MARGIN, MARGIN], [WIDTH - MARGIN, HEIGHT - MARGIN])
    phi, z, _ = (float(v) for v in meet(bare.lens, bare.rotation @ bare.rays(pixel)))
    hole = _hole(rng, phi, z, insides)
    if not START + 5 < z < END - 5 or _minor_axis(bare, hole) < LEAST_AXIS:
        return None
    focus = float(meet(bare.lens, bare.rotation[:, 2])[2]) * float(rng.uniform(0.9, 1.1))

    def nearby(least: float) -> tuple[float, float]:
        while True:
            x, y = rng.uniform(-9, 9), rng.uniform(-9, 9)
            if math.hypot(x, y) > least:
                return phi + x / RADIUS, float(np.clip(z + y, START + 2, END - 2))

    beads = []
    for _ in range(int(rng.integers(2, 8))):
        size = float(rng.uniform(0.15, 0.55))
        beads.append(
            Bead(
                *nearby(1.0 + size), size, size * float(rng.uniform(0.3, 1.3)),
                bool(rng.random() < 0.25), float(rng.uniform(0.06, 0.3)),
            )
        )  # fmt: skip
    dimples = tuple(
        (*nearby(0.0), size, -size * float(rng.uniform(0.03, 0.25)))
        for size in rng.uniform(0.4, 1.5, int(rng.integers(1, 6)))
    )
    return Scene(
        **common,
        hole=hole if with_hole else None,
        place=(phi, z),
        focus=focus,
        beads=tuple(beads),
        dimples=dimples,
    )


def _alphas(rng: np.random.Generator, kind: str) -> tuple[float, float]:
    """Return roughnesses around and along: drawn tube is smoother along its axis."""
    around = {"bare": (0.1, 0.25), "worn": (0.15, 0.35), "corroded": (0.25, 0.5)}[kind]
    alpha = float(rng.uniform(*around))
    return alpha, alpha * float(rng.uniform(0.5, 1.0))


def _hole(rng: np.random.Generator, phi: float, z: float, insides: tuple[str, ...]) -> Hole:
    shares = [0.4, 0.3, 0.3] if insides == INSIDES else [0.2, 0.2, 0.3, 0.3]
    inside = insides[int(rng.choice(len(insides), p=shares))]
    chamfer = float(rng.uniform(0.02, 0.12)) if rng.random() < 0.5 else 0.0
    scale = rng.random() < 0.3
    return Hole(
        phi,
        z,
        float(rng.uniform(0.85, 1.15)),
        inside,
        chamfer=chamfer,
        chamfer_depth=chamfer * float(rng.uniform(0.3, 1.0)),
        recess=float(rng.uniform(0.05, 0.4)) if inside in ("soil", "bright") else 0.0,
        unevenness=float(rng.uniform(0.0, 0.08)),
        # Soil and rust are dark; scale is white.
        albedo=float(
            rng.uniform(0.5, 0.85) if scale or inside == "bright" else rng.uniform(0.04, 0.3)
        ),
        light=float(np.exp(rng.uniform(np.log(0.3), np.log(3.0)))) if inside == "backlit" else 0.0,
    )


def _minor_axis(scene: Scene, hole: Hole) -> float:
    """Return the minor axis of the image of the mouth in pixels; 0 if it is not seen whole."""
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    rim = wall(*around_hole(hole, hole.diameter / 2, angle))
    if (((rim - scene.lens) @ scene.rotation)[:, 2] < 1.0).any():
        return 0.0
    pixels = scene.pixels(rim)
    if not ((pixels > 40) & (pixels < [WIDTH - 40, HEIGHT - 40])).all():
        return 0.0
    return (
        2 * math.sqrt(2) * float(np.linalg.svd(pixels - pixels.mean(axis=0))[1][1] / math.sqrt(32))
    )


def around_hole(hole: Hole, radius: float, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return phi and z where a drill of a radius cuts the wall, at angles about its axis."""
    return (
        hole.phi + np.arcsin(radius * np.cos(angle) / RADIUS),
        hole.z + radius * np.sin(angle),
    )


def _turn_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _turn_y(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def _turn_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
