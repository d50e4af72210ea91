"""One map of a partly flooded pipe: the picture of the drained part, the echoes of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.reconstruction.depth_map import DepthMap, camera_map
from minorloop_head.ultrasound.c_scan import CScan


@dataclass(frozen=True, eq=False)
class PipeMap(CScan):
    """Echoes of the flooded part of a pipe, and a picture of the rest.

    Parameters
    ----------
    picture : (rows, columns) array
        Logarithm of the reflectance where the camera saw drained wall; NaN elsewhere.
    """

    picture: FloatArray


def pipe_map(scan: CScan, views: Sequence[FloatArray]) -> PipeMap:
    """Merge the map of a sweep with pictures.

    Parameters
    ----------
    scan : CScan
    views : sequence of (rows, columns) arrays
        Logarithms of the reflectance on the patch of the sweep, such as `resampled` returns; NaN
        where nothing is seen.

    Notes
    -----
    Under water a picture is refracted, so that the camera counts above the water line only. Echoes
    reach above it by the width of the beam, so that both sources meet there. Views
    under other lights differ by a constant, which is that of their medians.
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
    """Merge two maps of one patch: by inverse variance where both have data.

    Raises
    ------
    SignalError
        If the patches differ.
    """
    if first.patch != second.patch:
        raise SignalError("the maps are of different patches; lay both out on one")
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
