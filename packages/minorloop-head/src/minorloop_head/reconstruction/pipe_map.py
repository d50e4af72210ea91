"""One map of a partly flooded pipe: the picture of the drained part, the echoes of the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.reconstruction.depth_map import DepthMap, WaterLine, blend, camera_map

if TYPE_CHECKING:
    from minorloop_head.ultrasound.c_scan import CScan, EchoFind


@dataclass(frozen=True, eq=False)
class PipeMap:
    """Picture and echoes of a partly flooded pipe on one patch.

    Parameters
    ----------
    wall : DepthMap
        Depth, its standard deviation, and the source of each texel: camera, echoes, both or none.
    picture : (rows, columns) array
        Logarithm of the reflectance where the camera saw drained wall; NaN elsewhere.
    amplitude : (rows, columns) array
        Of the echo of the wall, as a share of that of a plain one; NaN elsewhere.
    water : WaterLine
    finds : tuple of EchoFind
        By the echoes.
    """

    wall: DepthMap
    picture: FloatArray
    amplitude: FloatArray
    water: WaterLine
    finds: tuple[EchoFind, ...] = ()


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
    return PipeMap(blend(camera, scan.wall), picture, scan.amplitude, scan.water, scan.finds)
