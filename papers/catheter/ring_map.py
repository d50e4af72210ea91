"""The map of the pipe once round: camera, profile by echoes, and findings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from minorloop.errors import SignalError
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
from minorloop_head.ultrasound.profile import Profile
from minorloop_head.vision.reflectance_map import ReflectanceMap
from papers.catheter.pipe_map import blend

LENGTH, MARGIN = 9.6e-3, 1e-3
"""Least length of the map round the pipe, and margin about a finding, in metres."""


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
    spots: npt.ArrayLike,
    depths: npt.ArrayLike,
    sds: npt.ArrayLike,
    *,
    footprint: float = 0.25e-3,
) -> DepthMap:
    """Return the map of the wall from echoes along a sweep.

    Parameters
    ----------
    patch : Patch
        The texels of the map.
    spots : (K, 2) array_like
        Phi and z of each echo.
    depths, sds : (K,) array_like
        Distance beyond the nominal wall and its standard deviation, in metres; NaN without an
        echo.
    footprint : float
        Standard deviation of the footprint of an echo, in metres.

    Notes
    -----
    Means are weighted by footprint and inverse variance; texels farther than two footprints from
    every echo stay unseen.
    """
    where = np.asarray(spots, dtype=np.float64).reshape(-1, 2)
    values, widths = np.asarray(depths, dtype=np.float64), np.asarray(sds, dtype=np.float64)
    if not len(where) == values.size == widths.size:
        raise SignalError(f"{len(where)} spots, {values.size} depths, {widths.size} deviations")
    empty = unseen_map(patch)
    weight, total, nearest = (np.zeros_like(empty.depth) for _ in range(3))
    for spot, value, width in zip(where, values, widths, strict=True):
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
