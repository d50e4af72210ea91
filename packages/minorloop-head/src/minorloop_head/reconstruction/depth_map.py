"""Maps of the depth of the wall, with standard deviations and sensors, and meshes of them."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from minorloop.arrays import BoolArray, FloatArray, as_finite
from minorloop.errors import OutputError, ParameterError, SignalError
from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import wrapped

STEP = 0.1e-3
"""Size of a texel in metres, a tenth of the footprint of an echo."""
UNSEEN, CAMERA, ECHOES, BOTH = 0, 1, 2, 3
"""Sources of a texel, as two bits: the bitwise or of two maps of sources has the source of both."""
_LOST, _FALSE = 0.02, 3e-4
"""Share of missing echoes below the water line, and of echoes of noise above it. On 28 simulated
pipes 1 in 100 is missing, where the flank of a dent reflects it elsewhere; noise gives an echo once
in some thousand bursts."""
WALL_SD = 0.05e-3
"""Standard deviation of a wall that only the camera shows, in metres: that of the radius of the
pipe, since images give no depth."""
_HEIGHTS = 2001
"""Number of compared heights of the surface, 10 um apart in a pipe of 20 mm."""
Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Patch:
    """A rectangle of the wall in even texels.

    Raises a `ParameterError` if it is empty, or goes round the pipe more than once.
    """

    phi: float
    z: float
    """Centre of its first texel, in radians and metres."""
    rows: int
    columns: int
    """Texels along and around the pipe."""
    radius: float = 10e-3
    """Radius of the pipe, in metres."""
    step: float = STEP
    """Size of a texel, in metres."""

    def __post_init__(self) -> None:
        as_finite("phi of a patch", self.phi)
        as_finite("z of a patch", self.z)
        if self.rows < 1 or self.columns < 1 or not (self.step > 0 and self.radius > 0):
            raise ParameterError(
                f"a patch of {self.rows} by {self.columns} texels of {self.step} m is empty"
            )
        if (self.columns - 1) * self.step > 2 * np.pi * self.radius:
            raise ParameterError(
                f"a patch of {self.columns} columns goes round a pipe of radius {self.radius} m "
                "more than once"
            )

    @classmethod
    def around(
        cls, phi: float, z: float, *, size: float, radius: float = 10e-3, step: float = STEP
    ) -> Patch:
        """Return a square patch of about ``size`` metres about a place."""
        half = round(size / 2 / step)
        count = 2 * half + 1
        return cls(phi - half * step / radius, z - half * step, count, count, radius, step)

    @classmethod
    def ring(cls, low: float, high: float, *, radius: float = 10e-3, step: float = STEP) -> Patch:
        """Return the patch once round the pipe between two z; its seam is at the top."""
        rows, columns = int((high - low) / step) + 1, int(2 * np.pi * radius / step)
        return cls(-np.pi / 2, low, rows, columns, radius, step)

    @property
    def places(self) -> FloatArray:
        """Phi and z (rows, columns, 2) of the texels."""
        phi = self.phi + np.arange(self.columns) * self.step / self.radius
        z = self.z + np.arange(self.rows) * self.step
        return np.stack(np.broadcast_arrays(phi[None, :], z[:, None]), axis=-1)

    def off(self, phi: float, z: float) -> FloatArray:
        """Return offsets (rows, columns, 2) from a place, around and along, in metres."""
        places = self.places
        around = wrapped(places[..., 0] - phi)
        return np.stack([self.radius * around, places[..., 1] - z], axis=-1)


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth of the wall below its nominal surface."""

    patch: Patch
    """Its texels."""
    depth: FloatArray
    sd: FloatArray
    """Shape (rows, columns). Depth and standard deviation in metres; NaN and infinite where
    unknown. In a through-hole the depth is infinite."""
    source: Bytes
    """Shape (rows, columns). ``UNSEEN``, ``CAMERA``, ``ECHOES`` or ``BOTH``."""

    def __post_init__(self) -> None:
        shape = (self.patch.rows, self.patch.columns)
        for name in ("depth", "sd", "source"):
            if getattr(self, name).shape != shape:
                raise SignalError(
                    f"{name} has shape {getattr(self, name).shape}; the patch has {shape}"
                )

    @property
    def unseen(self) -> float:
        """Share of the patch that no sensor has covered."""
        return float((self.source == UNSEEN).mean())


def unseen_map(patch: Patch) -> DepthMap:
    """Return a map without any data."""
    shape = (patch.rows, patch.columns)
    return DepthMap(
        patch, np.full(shape, np.nan), np.full(shape, np.inf), np.zeros(shape, dtype=np.uint8)
    )


def camera_map(patch: Patch, seen: BoolArray, defect: npt.ArrayLike) -> DepthMap:
    """Return the map of a camera: depth 0 where it sees the wall, unknown at a defect.

    ``patch``: the texels of the map. ``seen`` (rows, columns): where the camera has seen the wall.
    ``defect`` (rows, columns): probability of a defect, 0 to 1; the depth is unknown from 0.5 on.
    """
    open_to = seen & (np.asarray(defect, dtype=np.float64) < 0.5)
    depth = np.where(open_to, 0.0, np.nan)
    source = np.where(seen, CAMERA, UNSEEN).astype(np.uint8)
    return DepthMap(patch, depth, np.where(open_to, WALL_SD, np.inf), source)


def paste(wall: DepthMap, part: DepthMap) -> DepthMap:
    """Return a map in which the texels of a part with data replace its own.

    ``wall``: the map of the larger patch. ``part``: the map of a smaller patch; its nearest texel
    counts.
    """
    places, patch = wall.patch.places, part.patch
    middle = patch.phi + 0.5 * (patch.columns - 1) * patch.step / patch.radius
    around = wrapped(places[..., 0] - middle)
    column = np.rint(around * patch.radius / patch.step + 0.5 * (patch.columns - 1)).astype(int)
    row = np.rint((places[..., 1] - patch.z) / patch.step).astype(int)
    inside = (column >= 0) & (column < patch.columns) & (row >= 0) & (row < patch.rows)
    i, j = np.clip(row, 0, patch.rows - 1), np.clip(column, 0, patch.columns - 1)
    inside &= part.source[i, j] != UNSEEN
    depth, sd = (
        np.where(inside, part.depth[i, j], wall.depth),
        np.where(inside, part.sd[i, j], wall.sd),
    )
    source = np.where(inside, part.source[i, j] | wall.source, wall.source)
    return DepthMap(wall.patch, depth, sd, source.astype(np.uint8))


@dataclass(frozen=True)
class WaterLine:
    """The surface of the water in a pipe."""

    height: float
    """Height as y in the pipe, which points down, in metres: larger y is under water. NaN without
    data."""
    sd: float
    """Standard deviation in metres of a normal distribution with the same 90 % band."""
    wrong: float
    """Share of the directions that contradict it."""
    seen: bool = True
    """Whether places below and above it were measured, so that it is between them."""

    @property
    def words(self) -> str:
        """The height with its 90 % band, above or below the axis; or why it is unknown."""
        if math.isnan(self.height):
            return "not seen"
        if not self.seen:
            dry = (
                "no echo at any place: the probe is above the water; let in more, to above the axis"
            )
            return f"no surface: {'water at every place' if self.full else dry}"
        side, band = "above" if self.height < 0 else "below", PER_DEVIATION * self.sd
        return f"{1e3 * abs(self.height):.1f} ± {1e3 * band:.1f} mm (90 %) {side} the axis"

    @property
    def full(self) -> bool:
        """Whether every place is below the surface."""
        return not self.seen and self.height < 0

    def wet(self, phi: npt.ArrayLike, radius: float, *, margin: float = 0.0) -> BoolArray:
        """Return whether the wall at phi is under water, by a margin in metres."""
        y = radius * np.sin(np.asarray(phi, dtype=np.float64))
        under: BoolArray = y > self.height + margin
        return under


def coupled_at(
    phi: npt.ArrayLike, radius: float, *, face: float | None = None, offset: float = 0.0
) -> FloatArray:
    """Return the height, as y, below which water reaches both wall and probe.

    ``phi``, ``radius``, ``face`` and ``offset``: as of `find_water`.
    """
    down = np.sin(np.asarray(phi, dtype=np.float64))
    wall: FloatArray = radius * down
    return wall if face is None else np.asarray(np.minimum(wall, offset + face * down))


def find_water(
    phi: npt.ArrayLike,
    detected: Sequence[bool] | BoolArray,
    radius: float,
    *,
    face: float | None = None,
    offset: float = 0.0,
    place_sd: float = 0.0,
) -> WaterLine:
    """Return the water line by the places where a sweep round the pipe gave echoes.

    It is the middle of the 90 % band of its height. It is not seen if a full pipe, or one without
    water at any place, is likelier than a surface.

    ``phi`` (K,): where each beam meets the wall, in radians.
    ``detected`` (K,): whether there was an echo.
    ``radius``: of the pipe, in metres.
    ``face``: distance of the face of the probe from the axis, in metres. A probe works only with
    its face under water: below the axis, the height of the face counts and not that of the wall.
    ``offset``: height of the pivot of the probe, as y, in metres.
    ``place_sd``: standard deviation in metres of the common error of the heights of all places.

    Notes
    -----
    The likelihood of a height is that of the present and missing echoes, if a share `_LOST` of
    those below it are missing, and a share `_FALSE` of the places above it have one (Bayes). So a
    lost echo does not move the line, nor does a dent whose flanks reflect the beam elsewhere. Only
    places in the upper half of the radius distinguish a full pipe. Between two places the height
    is uniform; its band is narrower than that of a normal distribution of the same deviation.
    """
    y = coupled_at(phi, radius, face=face, offset=offset).ravel()
    wet = np.asarray(detected, dtype=bool).ravel()
    if y.size != wet.size:
        raise SignalError(f"{y.size} places and {wet.size} echoes; give one flag for each place")
    if y.size == 0:
        return WaterLine(np.nan, np.inf, np.nan, seen=False)
    heights = np.linspace(-radius, radius, _HEIGHTS)
    order = np.argsort(y)
    above = np.searchsorted(y[order], heights, side="right")  # the places above each height
    echoes = np.concatenate([[0], np.cumsum(wet[order])])[above]
    silent = above - echoes
    likely = (
        echoes * math.log(_FALSE)
        + silent * math.log(1 - _FALSE)
        + (wet.sum() - echoes) * math.log(1 - _LOST)
        + ((~wet).sum() - silent) * math.log(_LOST)
    )
    full = wet.sum() * math.log(1 - _LOST) + (~wet).sum() * math.log(_LOST)
    full = full if y.min() < -radius / 2 else -math.inf
    dry = wet.sum() * math.log(_FALSE) + (~wet).sum() * math.log(1 - _FALSE)
    share = np.exp(likely - likely.max())
    best = float(likely.max() + math.log(share.mean()))
    if max(full, dry) > best:
        end = -radius if full > dry else radius
        return WaterLine(end, np.inf, float((wet == (end > 0)).mean()), seen=False)
    sigma = place_sd / (heights[1] - heights[0])
    if sigma > 0:
        share = ndimage.gaussian_filter1d(share, sigma, mode="constant")
    until = np.cumsum(share) / share.sum()
    low, high = np.interp([0.05, 0.95], until, heights).tolist()
    height, half = (low + high) / 2, (high - low) / 2
    wrong = float((wet != (y > height)).mean())
    return WaterLine(height, half / PER_DEVIATION, wrong)


SUFFIXES = (".ply", ".glb", ".gltf")
_COLOURS = {
    UNSEEN: (60, 60, 60),
    CAMERA: (180, 180, 180),
    ECHOES: (110, 160, 200),
    BOTH: (200, 200, 190),
}
_DEEP = (200, 60, 30)
"""Colour of the deepest texel, in levels of red, green and blue: no source is red."""


def vertices_of(wall: DepthMap) -> FloatArray:
    """Return points (rows, columns, 3) of the wall in the pipe, in metres.

    Texels of unknown depth lie on the cylinder; ``faces_of`` leaves them and holes out.
    """
    places = wall.patch.places
    depth = np.where(np.isfinite(wall.depth), wall.depth, 0.0)
    r = wall.patch.radius + depth
    return np.stack(
        [r * np.cos(places[..., 0]), r * np.sin(places[..., 0]), places[..., 1]], axis=-1
    )


def faces_of(wall: DepthMap) -> npt.NDArray[np.int64]:
    """Return (N, 3) triangles that face the axis, none over holes or unknown depths."""
    rows, columns = wall.depth.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1], index[:-1, 1:]
    c, d = index[1:, :-1], index[1:, 1:]
    through = ~np.isfinite(wall.depth)
    solid = ~(through[:-1, :-1] | through[:-1, 1:] | through[1:, :-1] | through[1:, 1:])
    first = np.stack([a[solid], c[solid], b[solid]], axis=1)
    second = np.stack([b[solid], c[solid], d[solid]], axis=1)
    return np.concatenate([first, second]).astype(np.int64)


def _colours_of(wall: DepthMap) -> npt.NDArray[np.uint8]:
    """Return colours (rows, columns, 4): grey by sensor, red by depth, dark where unseen."""
    table = np.array([_COLOURS[n] for n in range(4)], dtype=np.float64)
    base = table[wall.source]
    depth = np.where(np.isfinite(wall.depth), np.maximum(wall.depth, 0.0), 0.0)
    share = np.minimum(depth / max(float(depth.max()), 0.1e-3), 1.0)[..., None]
    mixed = (1 - share) * base + share * np.array(_DEEP)
    opaque = np.full((*depth.shape, 1), 255.0)
    return np.concatenate([mixed, opaque], axis=-1).astype(np.uint8)


def mesh_of(wall: DepthMap) -> Any:
    """Return the wall as a ``trimesh.Trimesh`` with colours."""
    import trimesh

    return trimesh.Trimesh(
        vertices=vertices_of(wall).reshape(-1, 3),
        faces=faces_of(wall),
        vertex_colors=_colours_of(wall).reshape(-1, 4),
        process=False,
    )


def save_mesh(wall: DepthMap, path: str | os.PathLike[str]) -> Path:
    """Write the wall as PLY or glTF, by the suffix of the path, in metres.

    ``wall``: the depth map; ``path``: ends in ``.ply``, ``.glb``, or ``.gltf`` (which carries its
    data inside). Raises a `ParameterError` if the suffix is another; an `OutputError` if the place
    cannot be written.
    """
    place = Path(path)
    suffix = place.suffix.lower()
    if suffix not in SUFFIXES:
        raise ParameterError(f"cannot write {place.name}; give one of {', '.join(SUFFIXES)}")
    mesh = mesh_of(wall)
    options = {"embed_buffers": True} if suffix == ".gltf" else {}
    written = mesh.export(file_type=suffix[1:], **options)
    data = written["model.gltf"] if isinstance(written, dict) else written
    data = data if isinstance(data, bytes) else data.encode()
    if suffix == ".ply":
        data = data.replace(b"\nelement", b"\ncomment units: metres\nelement", 1)
    try:
        place.write_bytes(data)
    except OSError as error:
        raise OutputError(f"cannot write {place}: {error.strerror or error}") from None
    return place
