"""Maps of a pipe by camera and echoes: of a partly flooded part, and once round."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.procedures.probe_steps import resampled
from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    STEP,
    UNSEEN,
    DepthMap,
    Patch,
    camera_map,
    paste,
    unseen_map,
)
from minorloop_head.ultrasound.c_scan import CScan
from minorloop_head.ultrasound.wall_echoes import Profile
from minorloop_head.vision.reflectance_map import ReflectanceMap

LENGTH, MARGIN = 9.6e-3, 1e-3
"""Least length of the map round the pipe, and margin about a finding, in metres."""


@dataclass(frozen=True, eq=False)
class PipeMap(CScan):
    """Echoes of the flooded part of a pipe, and a picture of the rest."""

    picture: FloatArray
    """Shape (rows, columns). Logarithm of the reflectance where the camera saw drained wall; NaN
    elsewhere."""


def pipe_map(scan: CScan, views: Sequence[FloatArray]) -> PipeMap:
    """Merge the map of a sweep with pictures.

    Views (rows, columns) are logarithms of the reflectance on the patch of the sweep, such as
    `resampled` returns; NaN where nothing is seen. Under water a picture is refracted, so that the
    camera counts above the water line only. Echoes reach above it by the width of the beam, so that
    both sources meet there. Views under other lights differ by the constant of their medians.
    """
    patch = scan.wall.patch
    total, count = (np.zeros(scan.amplitude.shape) for _ in range(2))
    drained = ~scan.water.wet(patch.places[..., 0], patch.radius)
    for view in views:
        seen = np.isfinite(view) & drained
        if seen.any():
            total[seen] += view[seen] - np.median(view[seen])
            count[seen] += 1
    picture = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    camera = camera_map(patch, count > 0, np.zeros(count.shape))
    fused = replace(scan, wall=blend(camera, scan.wall))
    return PipeMap(
        **{each.name: getattr(fused, each.name) for each in fields(fused)}, picture=picture
    )


def blend(first: DepthMap, second: DepthMap) -> DepthMap:
    """Merge two maps of one patch: by inverse variance where both have data."""
    assert first.patch == second.patch, "the maps are of different patches"
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = [np.where(np.isnan(m.depth), 0.0, 1 / m.sd**2) for m in (first, second)]
        total = weights[0] + weights[1]
        depth = sum(
            np.where(weight > 0, weight * np.nan_to_num(m.depth, posinf=0.0), 0.0)
            for weight, m in zip(weights, (first, second), strict=True)
        ) / np.where(total > 0, total, np.nan)
        sd = np.where(total > 0, 1 / np.sqrt(total), np.inf)
    through = np.isposinf(first.depth) | np.isposinf(second.depth)
    depth = np.where(through, np.inf, depth)
    source = (first.source | second.source).astype(np.uint8)
    return DepthMap(first.patch, depth, np.where(through, np.nan, sd), source)


def ring_of(
    profile: Profile,
    views: Sequence[ReflectanceMap],
    parts: Sequence[DepthMap],
    radius: float = 10e-3,
) -> DepthMap:
    """Map the pipe once round: camera, profile and findings."""
    low, high = _span(parts)
    rows, columns = int((high - low) / STEP) + 1, int(2 * np.pi * radius / STEP)
    patch = Patch(-np.pi, low, rows, columns, radius)
    seen = np.zeros((rows, columns), dtype=bool)
    for view in views:
        seen |= np.isfinite(resampled(view, patch))
    echoes = echo_map(patch, profile.spots, profile.depths, profile.sds, footprint=0.35e-3)
    ring = blend(camera_map(patch, seen, np.zeros(seen.shape)), echoes)
    for part in parts:
        ring = paste(ring, part)
    return ring


def _span(parts: Sequence[DepthMap]) -> tuple[float, float]:
    """Return the range along the pipe of a ring with these parts, in metres."""
    ends = [(part.patch.z, part.patch.z + part.patch.rows * part.patch.step) for part in parts]
    middle = 0.5 * sum(ends[0])
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    return min(low - MARGIN, middle - 0.5 * LENGTH), max(high + MARGIN, middle + 0.5 * LENGTH)


def echo_map(
    patch: Patch,
    spots: Sequence[npt.ArrayLike] | FloatArray,
    depths: Sequence[float] | FloatArray,
    sds: Sequence[float] | FloatArray,
    *,
    footprint: float = 0.25e-3,
) -> DepthMap:
    """Return the map of the wall from echoes along a sweep.

    ``spots`` (K, 2) are phi and z of each echo; ``depths`` and ``sds`` (K,) the distance beyond the
    nominal wall and its standard deviation, in metres, NaN without an echo; ``footprint`` is the
    standard deviation of that of an echo. Means are weighted by footprint and inverse variance;
    texels farther than two footprints from every echo stay unseen.
    """
    empty = unseen_map(patch)
    weight, total, nearest = (np.zeros_like(empty.depth) for _ in range(3))
    for spot, value, width in zip(spots, depths, sds, strict=True):
        if not (np.isfinite(value) and np.isfinite(width) and width > 0):
            continue
        square = (patch.off(*spot) ** 2).sum(axis=-1) / footprint**2
        share = np.where(square <= 4, np.exp(-0.5 * square), 0.0)
        weight += share / width**2
        total += share * value / width**2
        nearest = np.maximum(nearest, share)
    reached = nearest > 0
    depth = np.divide(total, weight, out=np.full_like(total, np.nan), where=reached)
    sd = np.sqrt(np.divide(1.0, weight, out=np.full_like(total, np.inf), where=reached))
    return DepthMap(patch, depth, sd, np.where(reached, ECHOES, UNSEEN).astype(np.uint8))
