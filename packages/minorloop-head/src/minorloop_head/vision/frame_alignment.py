"""Turns of the head between the frames of an acquisition, from what they show of the wall.

A sensor of the joints has an error in each frame. Maps of frames that do not lie on each other
have their edges twice, so that a hole looks larger than it is. The marks of the wall are the same
under every light, and say by how much the frames are off from each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.patch_pictures import PatchPictures
from minorloop_head.vision.reflectance_map import LitFrame

_SIZE, _LEAST, _COLUMNS = 1.2e-3, 0.5, 320.0
"""Side of a patch in metres, its least correlation, and columns of the largest picture compared. In
acquisitions of twelve views (seeds 1000 to 1011) with errors of 0.15 degrees, 0.003 degrees are
left in the median view and 0.012 in the worst."""
_LEVELS = (2, 2, 1, 1, 0)
_FEWEST = 4
"""Least number of patches that agree."""
_WIDEST, _FARTHEST = math.radians(0.1), math.radians(1.0)
"""Largest standard deviation of a turn, and largest turn, that counts: that of a poor sensor is
0.15 degrees."""


def aligned(frames: Sequence[LitFrame], camera: CalibratedCamera) -> tuple[LitFrame, ...]:
    """Return frames whose angles agree with each other; their mean stays.

    ``frames``: good frames of an acquisition. Those without light keep their angles, and so do
    those in which too few patches of the frame with most light are found.
    """
    lit = [n for n, frame in enumerate(frames) if any(frame.lights)]
    if len(lit) < 2:
        return tuple(frames)
    first = max(lit, key=lambda n: sum(frames[n].lights))
    pictures, still = PatchPictures(camera, _SIZE, _LEAST, width=_COLUMNS), np.zeros(2)
    begun, pyramid = _angles(frames[first]), pictures.pyramid(frames[first].image)
    patches = pictures.new(pyramid, begun, pictures.none, still, still)
    turns = np.zeros((len(frames), 2))
    for n in set(lit) - {first} if len(patches.sd) >= _FEWEST else ():
        angles, pyramid = _angles(frames[n]), pictures.pyramid(frames[n].image)
        found = pictures.agreed(pyramid, patches, angles, still, _LEVELS)
        sure = found.sd is not None and found.sd.max() < _WIDEST
        near = np.abs(found.angles - angles).max() < _FARTHEST
        if sure and near and (found.scores >= _LEAST).sum() >= _FEWEST:
            turns[n] = found.angles - angles
    turns[lit] -= turns[lit].mean(axis=0)
    return tuple(
        replace(frame, pan=frame.pan + float(a), tilt=frame.tilt + float(b))
        for frame, (a, b) in zip(frames, turns, strict=True)
    )


def _angles(frame: LitFrame) -> FloatArray:
    return np.array([frame.pan, frame.tilt])
