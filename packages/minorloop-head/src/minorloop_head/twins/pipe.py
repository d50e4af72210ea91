"""A metal pipe of 20 mm with its defects: the truth behind images and echoes.

Places on the wall are phi in radians and z in metres along the pipe; sizes are in metres along
the wall. All classes are frozen values. They are for twins, and for scoring after a run; estimators
must not read them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from minorloop.arrays import FloatArray, as_finite, check_option
from minorloop.errors import ParameterError
from minorloop_head.geometry import wrapped

INSIDES = ("dark", "backlit", "white")


@dataclass(frozen=True)
class Bore:
    """A round hole through the wall, or a pit that ends in it.

    Raises a `ParameterError` if a size is not positive or the inside is unknown.
    """

    phi: float
    z: float
    """Place of its centre."""
    diameter: float
    """Diameter of its mouth, without the chamfer."""
    depth: float = math.inf
    """Depth of its floor below the wall; infinite for a through-hole."""
    inside: str = "dark"
    """One of "dark", "backlit", "white": a hole shows no light, light from behind, or a white
    deposit that fills the mouth."""
    brightness: float = 0.3
    """Brightness of the light from behind, or albedo of the deposit or of the floor of a pit."""
    chamfer: float = 0.0
    """Width of the broken edge."""
    chamfer_slope: float = 0.5
    """Its slope, into the bore."""
    lining: float = 0.2
    """Albedo of the wall of the bore."""
    floor_tilt: tuple[float, float] = (0.0, 0.0)
    """Slopes of the floor of a pit around and along the pipe."""
    dish: float = 0.0
    """Depth of the floor in the middle less that at its rim."""

    def __post_init__(self) -> None:
        check_option("inside", self.inside, INSIDES)
        _check_place(self.phi, self.z)
        _check_positive("diameter of a bore", self.diameter)
        if not self.depth > 0:
            raise ParameterError(f"depth of a bore is {self.depth}; give a positive depth in m")
        if not self.chamfer >= 0:
            raise ParameterError(f"chamfer of a bore is {self.chamfer}; give a width >= 0 in m")

    @property
    def through(self) -> bool:
        """Whether it is a through-hole."""
        return math.isinf(self.depth)


@dataclass(frozen=True)
class Crack:
    """A narrow line with corners: dark, or a groove whose flanks return light.

    Raises a `ParameterError` if there are fewer than two corners, or not one width for each corner.
    """

    points: tuple[tuple[float, float], ...]
    """Phi and z of its corners, at least two."""
    widths: tuple[float, ...]
    """Widths at the corners."""
    depth: float = 1e-3
    """Depth below the wall."""
    albedo: float = 0.05
    """Albedo of its visible inside; that of flanks is relative to the metal."""
    flanks: float = 0.0
    """Slope of its two visible flanks of metal; 0 without."""

    def __post_init__(self) -> None:
        if len(self.points) < 2 or len(self.points) != len(self.widths):
            raise ParameterError(
                f"a crack has {len(self.points)} corners and {len(self.widths)} widths; give at "
                "least two corners and a width for each"
            )
        for (phi, z), width in zip(self.points, self.widths, strict=True):
            _check_place(phi, z)
            _check_positive("width of a crack", width)


@dataclass(frozen=True)
class Dent:
    """A smooth bump, or a dimple where its height is negative: height * exp(-r^2 / 2 size^2)."""

    phi: float
    z: float
    size: float
    height: float

    def __post_init__(self) -> None:
        _check_place(self.phi, self.z)
        _check_positive("size of a dent", self.size)
        as_finite("height of a dent", self.height)


@dataclass(frozen=True)
class Scratch:
    """A shallow groove: ``angle`` from the direction around the pipe, ``slope`` of its flanks.

    ``bend`` is the curvature of its course in 1/m.
    """

    phi: float
    z: float
    angle: float
    length: float
    width: float
    slope: float = 0.5
    albedo: float = 1.0
    bend: float = 0.0

    def __post_init__(self) -> None:
        _check_place(self.phi, self.z)
        _check_positive("length of a scratch", self.length)
        _check_positive("width of a scratch", self.width)


@dataclass(frozen=True)
class Dirt:
    """A patch that is darker and duller than the metal."""

    phi: float
    z: float
    """Place of its centre."""
    size: float
    """Mean radius."""
    albedo: float
    """Relative to the metal."""
    softness: float = 1e-4
    """Width of its edge."""
    raggedness: float = 0.4
    """Relative depth of the lobes of its outline; 0 is a disc."""
    seed: int = 0
    """Seed of the lobes."""

    def __post_init__(self) -> None:
        _check_place(self.phi, self.z)
        _check_positive("size of dirt", self.size)
        _check_positive("softness of dirt", self.softness)


@dataclass(frozen=True)
class Weld:
    """A weld bead with ripples: arcs that end in sharp valleys, as the pool froze.

    Raises a `ParameterError` if a size is not positive.
    """

    phi: float
    z: float
    """Place of its middle."""
    angle: float
    """Angle from the direction around the pipe."""
    length: float
    width: float
    """Along and across the bead."""
    height: float = 0.1e-3
    """Height of its crown."""
    pitch: float = 0.5e-3
    """Between ripples."""
    ripple: float = 0.2
    """Steepest slope of a ripple."""

    def __post_init__(self) -> None:
        _check_place(self.phi, self.z)
        for name in ("length", "width", "height", "pitch"):
            _check_positive(f"{name} of a weld", getattr(self, name))


@dataclass(frozen=True)
class Finish:
    """Optical properties of the metal."""

    roughness_around: float = 0.22
    roughness_along: float = 0.12
    """Widths of the distribution of slopes around and along the pipe (Trowbridge and Reitz)."""
    diffuse: float = 0.55
    specular: float = 0.35
    """Weights of the two parts of the reflection."""
    brush: float = 0.05
    """Standard deviation of the slope of the brush marks, which run along the pipe."""
    streak: float = 0.06
    stain: float = 0.12
    """Standard deviations of the logarithm of the albedo: along brush marks, and in patches."""
    ambient: float = 0.08
    """Share of light reflected by the other walls."""
    seed: int = 0
    """Seed of the texture."""

    def __post_init__(self) -> None:
        _check_positive("roughness around the pipe", self.roughness_around)
        _check_positive("roughness along the pipe", self.roughness_along)


@dataclass(frozen=True)
class Pipe:
    """A straight pipe from z = 0.

    Raises a `ParameterError` if a size is not positive, or the water is outside the pipe.
    """

    radius: float = 10e-3
    length: float = 51.2e-3
    thickness: float = 2e-3
    """Inner radius and length of the pipe, and thickness of its wall, in metres."""
    finish: Finish = field(default_factory=Finish)
    """Optical properties of the metal."""
    bores: tuple[Bore, ...] = ()
    cracks: tuple[Crack, ...] = ()
    dents: tuple[Dent, ...] = ()
    scratches: tuple[Scratch, ...] = ()
    dirt: tuple[Dirt, ...] = ()
    welds: tuple[Weld, ...] = ()
    """Defects and marks on the wall."""
    water: float | None = None
    """Height of the surface of the water that fills the bottom, as y in the pipe, in metres; y
    points down, so that 0 is half full and 5e-3 a quarter of the way up. None when dry."""

    def __post_init__(self) -> None:
        for name in ("radius", "length", "thickness"):
            _check_positive(f"{name} of the pipe", getattr(self, name))
        if self.water is not None and not abs(self.water) < self.radius:
            raise ParameterError(
                f"water at y = {self.water} m is outside a pipe of radius {self.radius} m; "
                "give a height inside it, or None"
            )

    @classmethod
    def draw(
        cls,
        seed: int,
        *,
        length: float = 51.2e-3,
        holes: int = 0,
        pits: int = 0,
        cracks: int = 0,
        water: float | None = None,
    ) -> Pipe:
        """Draw a pipe with dents, beads, scratches and dirt, and a number of defects.

        ``seed``: seed of the pipe. ``length``: of the pipe, in metres. ``holes``, ``pits``,
        ``cracks``: number of each; holes of 0.85 to 1.15 mm, pits of 0.85 to 1.5 mm by 0.2 to 1 mm.
        ``water``: as in the class.
        """
        rng = np.random.default_rng(seed)
        area = 2 * np.pi * 10e-3 * length
        bores = [draw_hole(rng, *_position(rng, length)) for _ in range(holes)]
        bores += [draw_pit(rng, *_position(rng, length)) for _ in range(pits)]
        return cls(
            length=length,
            finish=draw_finish(rng),
            bores=tuple(bores),
            cracks=tuple(draw_crack(rng, *_position(rng, length)) for _ in range(cracks)),
            dents=tuple(
                draw_dent(rng, *_position(rng, length)) for _ in range(rng.poisson(area * 1.2e4))
            ),
            scratches=tuple(
                draw_scratch(rng, *_position(rng, length)) for _ in range(rng.poisson(area * 1.5e4))
            ),
            dirt=tuple(
                draw_dirt(rng, *_position(rng, length)) for _ in range(rng.poisson(area * 1.5e4))
            ),
            water=water,
        )

    def depth(self, phi: FloatArray, z: FloatArray) -> FloatArray:
        """Return the depth at places (...), in metres; infinite in holes. For scoring only."""
        phi, z = np.broadcast_arrays(np.asarray(phi, float), np.asarray(z, float))
        deepest = np.zeros(phi.shape)
        for bore in self.bores:
            x, y = self.radius * wrapped(phi - bore.phi), z - bore.z
            square = (x * x + y * y) / (bore.diameter / 2) ** 2
            floor = bore.depth + bore.floor_tilt[0] * x + bore.floor_tilt[1] * y
            floor = floor - bore.dish * np.minimum(square, 1.0)
            deepest = np.where(square <= 1, np.maximum(deepest, floor), deepest)
        for crack in self.cracks:
            deepest = np.where(
                self._in_crack(crack, phi, z), np.maximum(deepest, crack.depth), deepest
            )
        return deepest

    def _in_crack(self, crack: Crack, phi: FloatArray, z: FloatArray) -> FloatArray:
        """Return whether places are within half a width of a crack."""
        hit = np.zeros(phi.shape, dtype=bool)
        corners = zip(crack.points, crack.points[1:], crack.widths, crack.widths[1:], strict=False)
        for (phi0, z0), (phi1, z1), width0, width1 in corners:
            along = np.array([self.radius * float(wrapped(phi1 - phi0)), z1 - z0])
            x, y = self.radius * wrapped(phi - phi0), z - z0
            share = np.clip((x * along[0] + y * along[1]) / (along @ along), 0.0, 1.0)
            off = np.hypot(x - share * along[0], y - share * along[1])
            hit |= off <= 0.5 * (width0 + share * (width1 - width0))
        return hit


def draw_finish(rng: np.random.Generator) -> Finish:
    """Draw a brushed finish, from dull to polished."""
    around = rng.uniform(0.12, 0.3)
    return Finish(
        roughness_around=around,
        roughness_along=around * rng.uniform(0.35, 0.8),
        diffuse=rng.uniform(0.4, 0.7),
        specular=rng.uniform(0.2, 0.5),
        brush=rng.uniform(0.02, 0.08),
        streak=rng.uniform(0.03, 0.1),
        stain=rng.uniform(0.05, 0.2),
        ambient=rng.uniform(0.04, 0.12),
        seed=int(rng.integers(2**31)),
    )


def draw_hole(rng: np.random.Generator, phi: float, z: float) -> Bore:
    """Draw a hole of 0.85 to 1.15 mm, dark, back-lit or white, with or without a chamfer."""
    inside = INSIDES[int(rng.integers(3))]
    brightness = {"dark": 0.0, "backlit": rng.uniform(0.5, 2.0), "white": rng.uniform(1.6, 2.4)}
    return Bore(
        phi,
        z,
        rng.uniform(0.85e-3, 1.15e-3),
        inside=inside,
        brightness=float(brightness[inside]),
        chamfer=float(rng.choice([0.0, rng.uniform(0.02e-3, 0.12e-3)])),
        chamfer_slope=rng.uniform(0.3, 1.0),
        lining=rng.uniform(0.05, 0.35),
    )


def draw_pit(
    rng: np.random.Generator, phi: float, z: float, sizes: tuple[float, float] = (0.85e-3, 1.5e-3)
) -> Bore:
    """Draw a pit 0.2 to 1 mm deep, with a floor that is tilted by up to 4 degrees.

    ``sizes`` are the least and the largest diameter, in metres.
    """
    tilt, way = math.tan(math.radians(rng.uniform(0, 4))), rng.uniform(0, 2 * np.pi)
    return Bore(
        phi,
        z,
        rng.uniform(*sizes),
        depth=rng.uniform(0.2e-3, 1e-3),
        brightness=rng.uniform(0.2, 0.5),
        chamfer=rng.uniform(0.0, 0.06e-3),
        lining=rng.uniform(0.1, 0.35),
        floor_tilt=(tilt * math.cos(way), tilt * math.sin(way)),
    )


def draw_crack(rng: np.random.Generator, phi: float, z: float) -> Crack:
    """Draw a crack of 3 to 8 mm with 8 corners, 0.1 to 0.3 mm wide and narrower at its ends."""
    heading, step = rng.uniform(0, np.pi), rng.uniform(3e-3, 8e-3) / 7
    ways = heading + np.cumsum(rng.normal(0, 0.35, 7))
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(ways))])
    y = np.concatenate([[0.0], np.cumsum(step * np.sin(ways))])
    widest = rng.uniform(0.1e-3, 0.3e-3)
    taper = 0.4 + 0.6 * np.sin(np.linspace(0, np.pi, 8))
    return Crack(
        tuple((phi + float(a) / 10e-3, z + float(b)) for a, b in zip(x, y, strict=True)),
        tuple(float(widest * t) for t in taper),
        depth=rng.uniform(0.2e-3, 1.5e-3),
        albedo=rng.uniform(0.02, 0.12),
    )


def draw_dent(rng: np.random.Generator, phi: float, z: float) -> Dent:
    """Draw a shallow dent or a steep bead of spatter; both make glints."""
    if rng.random() < 0.6:
        size = rng.uniform(0.4e-3, 1.5e-3)
        return Dent(phi, z, size, -size * rng.uniform(0.1, 0.45))
    size = rng.uniform(0.15e-3, 0.5e-3)
    return Dent(phi, z, size, size * rng.uniform(0.3, 1.2))


def draw_scratch(rng: np.random.Generator, phi: float, z: float) -> Scratch:
    """Draw a scratch of 1 to 8 mm in any direction."""
    return Scratch(
        phi,
        z,
        rng.uniform(0, np.pi),
        rng.uniform(1e-3, 8e-3),
        rng.uniform(0.04e-3, 0.12e-3),
        slope=rng.uniform(0.1, 0.8),
        albedo=rng.uniform(0.5, 1.3),
    )


def draw_dirt(
    rng: np.random.Generator, phi: float, z: float, sizes: tuple[float, float] = (0.2e-3, 2e-3)
) -> Dirt:
    """Draw a patch of dirt of albedo 0.4 or more, sharp or soft, ragged or nearly round.

    ``sizes`` are the least and the largest, in metres.
    """
    low, high = sizes
    return Dirt(
        phi,
        z,
        math.exp(rng.uniform(math.log(low), math.log(high))),
        rng.uniform(0.4, 0.9),
        softness=math.exp(rng.uniform(math.log(0.05e-3), math.log(0.4e-3))),
        raggedness=rng.uniform(0.05, 0.6),
        seed=int(rng.integers(2**31)),
    )


def _position(rng: np.random.Generator, length: float) -> tuple[float, float]:
    return float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0, length))


def _check_place(phi: float, z: float) -> None:
    as_finite("phi", phi)
    as_finite("z", z)


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise ParameterError(f"{name} is {value}; give a positive number in m")


def open_pipe(specimen: int | None, noise: float, seed: int, **options: object) -> NoReturn:
    """Refuse to open the pipe as an actuator: the head in it has a camera and a probe.

    Raises a `ParameterError` always.
    """
    raise ParameterError(
        "twin:pipe is opened only by minorloop head identify, drive, inspect and sweep, and "
        "minorloop console; give twin:head for a head without camera"
    )
