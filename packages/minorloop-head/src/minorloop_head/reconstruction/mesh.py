"""Meshes of a depth map, for viewers of PLY and glTF."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import OutputError, ParameterError
from minorloop_head.reconstruction.depth_map import BOTH, CAMERA, ECHOES, UNSEEN, DepthMap

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


def colours_of(wall: DepthMap) -> npt.NDArray[np.uint8]:
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
        vertex_colors=colours_of(wall).reshape(-1, 4),
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
