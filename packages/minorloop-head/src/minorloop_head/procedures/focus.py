"""Sweep the focus about a guess and set it where a region of the image is sharpest."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.values import NOW, Procedure, Reading, Request, passed
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.focus import FLAT, FocusPeak, peak_of, sharpness

LEAST_TRIES = 5
"""Number of usable frames that a peak needs at least."""
_TRIES, _FRAMES, _SWEEPS = 9, 2, 3
"""Steps of a sweep, even in the inverse of the distance; frames at each; and most sweeps, each
about the best step of the one before."""
_SPREAD, _WIDEST = 0.3, 0.6
"""Relative width of a sweep on either side of its middle, and of the one after a sweep without a
peak: a far wall is sharp over most of a sweep. The guess is that of the calibrated wall, right
within some percent."""
_WAIT, _TRAVEL = 0.12, 0.32
"""Seconds for which the lens moves to a step, and in addition to the first one."""
_NEAREST, _FARTHEST = 4e-3, 60e-3
"""Limits of the focus, in metres."""


def focus(lens: Pinhole, pixel: npt.ArrayLike, guess: float) -> Procedure[FocusPeak]:
    """Focus on a pixel (2,) that shows something at about a distance in metres.

    Parameters
    ----------
    lens : Pinhole
        Its size is that of a frame.
    pixel : (2,) array_like
        Middle of the region.
    guess : float
        In metres.

    Raises
    ------
    ParameterError
        If the guess is not within the limits of the focus.
    """
    if not _NEAREST <= guess <= _FARTHEST:
        raise ParameterError(
            f"the guess {guess} m is not within the focus of the camera, "
            f"[{_NEAREST:g}, {_FARTHEST:g}] m"
        )
    region, steps, sweep = np.asarray(pixel, dtype=np.float64), _steps(1 / guess, _SPREAD), 0
    now = yield NOW
    while True:
        now, levels = yield from _swept(lens, region, steps, now)
        sweep += 1
        if np.isfinite(levels).sum() >= LEAST_TRIES and sweep < _SWEEPS:
            best = int(np.nanargmax(levels))
            at_limit = steps[best] in (1 / _FARTHEST, 1 / _NEAREST)
            if best in (0, _TRIES - 1) and not at_limit:
                steps = _steps(float(steps[best]), _SPREAD)
                continue
        found = peak_of(np.stack([1 / steps, levels], axis=1), guess, LEAST_TRIES)
        if found.verdict != FLAT or sweep >= _SWEEPS:
            yield Request(focus=found.distance, now=True)
            return found
        steps, sweep = _steps(1 / guess, _WIDEST), _SWEEPS - 1  # the last one


def _swept(
    lens: Pinhole, region: FloatArray, steps: FloatArray, now: Reading
) -> Procedure[tuple[Reading, FloatArray]]:
    """Return the last reading of a sweep, and the sharpness (tries,) at inverse distances.

    It is NaN where no frame was usable.
    """
    levels: list[float] = []
    for inverse in steps.tolist():
        sent, pause, values = now.t, _WAIT if levels else _TRAVEL + _WAIT, list[float]()
        now = yield Request(focus=1 / inverse)
        while not passed(sent, now.t, pause):
            now = yield Request(frame=passed(sent, now.t, pause - 0.05))
        while True:
            if now.image is not None:
                values.append(_sharpness(lens, now.image, region))
            if len(values) == _FRAMES:
                break
            now = yield Request(frame=True)
        good = [value for value in values if not math.isnan(value)]
        levels.append(float(np.mean(good)) if good else math.nan)
    return now, np.array(levels)


def _steps(middle: float, spread: float) -> FloatArray:
    """Return (tries,) inverse distances about one, nearest first."""
    ends = np.clip([middle * (1 - spread), middle * (1 + spread)], 1 / _FARTHEST, 1 / _NEAREST)
    return np.linspace(ends[1], ends[0], _TRIES)


def _sharpness(lens: Pinhole, image: Image, pixel: FloatArray) -> float:
    """Return the sharpness of the region, NaN if the frame is not usable."""
    good = frame_checks.check_frame(image, lens) == frame_checks.GOOD
    return sharpness(image, pixel) if good else math.nan
